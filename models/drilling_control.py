"""Force-controlled drilling through stacked plates, from the approach to the withdrawal."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    connect,
    fixed,
    parameter,
    part,
    signal_output,
    variable,
)
from acausal.library.drilling import (
    STEEL_34CRMO4,
    TWIST_DRILL_16MM,
    EnergyBalance,
    FeedDrive,
    ForceControl,
    FullDrillingForce,
    PlateLevel,
    Spindle,
    Workpiece,
    feed_rate_under,
)
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.translational import ForceSensor

SIN_KAPPA = math.sin(math.radians(59.0))


class ForceControlledDrilling(Component):
    """A controller drills through two plates with a gap between them at constant thrust.

    The controller approaches the first plate, holds the thrust, detects the breakthrough when the thrust collapses
    although the feed is at its cap, continues until the full diameter is through, and retracts. The drill is turned by
    a spindle drive, whose speed drops slightly under the torque of the cut. `process_time` is the total time, 0 until
    the drill is back.
    """

    F_set: Real = parameter(default=3000.0, unit="N", min=0.0, doc="Thrust to hold")
    n: Real = parameter(default=9.28, unit="1/s", min=0.0, doc="Set point of the rotational speed")
    t_1: Real = parameter(default=10e-3, unit="m", min=1e-6, doc="Thickness of the upper plate")
    t_2: Real = parameter(default=10e-3, unit="m", min=1e-6, doc="Thickness of the lower plate")
    plate_gap: Real = parameter(default=1e-3, unit="m", min=0.0, doc="Gap between the plates")
    gap: Real = parameter(default=2e-3, unit="m", doc="Distance from the tip to the upper plate at the start")
    m: Real = parameter(default=5.0, unit="kg", min=0.0, doc="Mass of the drill with its chuck")
    k_c11: Real = parameter(default=STEEL_34CRMO4.k_c11, unit="Pa", min=0.0, doc="Specific cutting force of the plates")
    z: Real = parameter(default=STEEL_34CRMO4.z, unit="1", min=0.0, max=1.0, doc="Exponent of the chip thickness")
    k_steel: Real = parameter(default=STEEL_34CRMO4.k_c11, unit="Pa", doc="Specific cutting force the controller knows")

    world: World = part()
    slide: Prismatic = part()
    joint: Revolute = part()
    body: Body = part()
    plates: list[Workpiece] = part()
    drills: list[FullDrillingForce] = part()
    spindle: Spindle = part()
    feed: FeedDrive = part()
    sensor: ForceSensor = part()
    control: ForceControl = part()
    balance: EnergyBalance = part()

    depth: Real = signal_output(unit="m", nominal=1e-3, doc="Depth of the tip behind the upper face")
    thrust: Real = signal_output(unit="N", nominal=1e3, doc="Force of both plates on the drill along its axis")
    engaged: Real = variable(unit="m", nominal=1e-2, doc="Engaged width of both plates; the diameter when it is full")
    process_time: Real = signal_output(unit="s", doc="Time of the whole process; 0 until the drill is back")

    experiment: ClassVar[Experiment] = Experiment(stop_time=28.0, tolerance=1e-7, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("depth",), title="Depth of the tip", unit="mm"),
        Panel(("thrust", "control.F_set"), title="Thrust", unit="N"),
        Panel(("feed.v",), title="Feed rate", unit="mm/s"),
        Panel(("spindle.tau",), title="Torque of the spindle", unit="N.m"),
        Panel(("control.phase",), title="Phase: approach, drilling, exit, retract, done"),
        Panel(("balance.W_source", "balance.W_cutting", "balance.W_friction"), title="Work", unit="J"),
    )

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(-self.gap), v=fixed(0.0))
        self.joint = Revolute(n=axis, phi=fixed(0.0), w=fixed(2 * math.pi * self.n))
        self.body = Body(m=self.m)
        below = self.t_1 + self.plate_gap
        self.plates = [Workpiece(t=self.t_1), Workpiece(t=self.t_2, r=(0.0, 0.0, below))]
        self.drills = [
            FullDrillingForce(
                level=PlateLevel(f"plates[{k}]"),
                t=plate.t,
                k=1e8,
                d_c=2e4,
                k_c11=self.k_c11,
                z=self.z,
                feed_force_factor=SIN_KAPPA,
                mu_margin=0.15,
                line_load=2e4,
            )
            for k, plate in enumerate(self.plates)
        ]
        self.spindle = Spindle(tau_max=40.0, w_ref=2 * math.pi * self.n)
        expected = feed_rate_under(self.F_set, self.n, tool=TWIST_DRILL_16MM, material=STEEL_34CRMO4, factor=SIN_KAPPA)
        # The thrust is proportional to k_c11 f**(1 - z); the exponent of steel is accurate enough for a gain.
        expected = expected * (self.k_steel / self.k_c11) ** (1 / (1 - STEEL_34CRMO4.z))
        self.control = ForceControl(F_set=self.F_set, v_nominal=expected, overrun=6e-3, s_start=-self.gap)
        self.feed = FeedDrive(f_max=10e3)
        self.sensor = ForceSensor()
        first, second = self.drills
        self.balance = EnergyBalance(
            P_source=self.spindle.power + self.feed.power,
            P_cutting=first.power_cutting + second.power_cutting,
            P_friction=first.power_friction + second.power_friction,
            P_damping=first.power_damping + second.power_damping,
            E=first.energy
            + second.energy
            + self.spindle.energy
            + self.feed.energy
            + self.m / 2 * self.slide.v**2
            + self.body.I_33 / 2 * self.joint.w**2,
        )

    def equations(self) -> Equations:
        first, second = self.drills
        yield connect(self.world.frame_b, self.slide.frame_a, *[plate.frame_a for plate in self.plates])
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a, first.frame_a, second.frame_a)
        for plate, drill in zip(self.plates, self.drills, strict=True):
            yield connect(plate.frame_b, drill.frame_w)
        yield connect(self.spindle.flange, self.joint.axis)
        yield connect(self.feed.flange, self.sensor.flange_a)
        yield connect(self.sensor.flange_b, self.slide.axis)
        yield connect(self.sensor.f, self.control.F)
        yield connect(self.depth, self.control.s)
        yield connect(self.control.v_ref, self.feed.v_ref)
        yield self.depth == first.s
        yield self.thrust == first.total_thrust + second.total_thrust
        yield self.engaged == first.d_O - first.d_I + second.d_O - second.d_I
        yield self.process_time == self.control.process_time
