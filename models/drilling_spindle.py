"""A spindle that slows down and stalls under the cutting torque."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part
from acausal.library.drilling import EnergyBalance, FeedDrive, FullDrillingForce, PlateLevel, Spindle, Workpiece
from acausal.library.multibody import Body, Prismatic, Revolute, World


class SpindleStall(Component):
    """A drill at constant feed stalls, because the motor is too weak for the full diameter.

    While the cone enters, the torque grows with the square of the diameter. Once the motor reaches its limit, the
    spindle slows down; the same feed rate then means more feed per revolution, thicker chips and more torque, which
    slows it down further until it stops and the feed drive reaches its force limit. With
    `--set feed_rate=0.5mm/s` the torque stays below the limit and the spindle does not stall.
    """

    n: Real = parameter(default=9.28, unit="1/s", min=0.0, doc="Set point of the rotational speed")
    feed_rate: Real = parameter(default=1.5e-3, unit="m/s", doc="Set point of the feed rate")
    gap: Real = parameter(default=5e-4, unit="m", doc="Distance from the tip to the block at the start")
    m: Real = parameter(default=5.0, unit="kg", min=0.0, doc="Mass of the drill with its chuck")

    world: World = part()
    slide: Prismatic = part()
    joint: Revolute = part()
    body: Body = part()
    drill: FullDrillingForce = part()
    workpiece: Workpiece = part()
    spindle: Spindle = part()
    feed: FeedDrive = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=6.0, tolerance=1e-8, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("drill.n",), title="Rotation", unit="1/s"),
        Panel(("drill.total_torque", "spindle.tau"), title="Torque of the cut and of the motor", unit="N.m"),
        Panel(("drill.depth.f",), title="Feed per revolution", unit="mm"),
        Panel(("drill.thrust", "feed.f"), title="Thrust and force of the feed drive", unit="N"),
        Panel(("balance.W_source", "balance.W_cutting", "balance.W_friction"), title="Work", unit="J"),
    )

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(-self.gap), v=fixed(self.feed_rate))
        self.joint = Revolute(n=axis, phi=fixed(0.0), w=fixed(2 * math.pi * self.n))
        self.body = Body(m=self.m)
        self.workpiece = Workpiece(t=0.05)
        self.drill = FullDrillingForce(
            level=PlateLevel("workpiece"),
            t=self.workpiece.t,
            k=1e8,
            d_c=2e4,
            mu_margin=0.15,
            line_load=2e4,
            feed_force_factor=math.sin(math.radians(59.0)),
        )
        self.spindle = Spindle(tau_max=15.0, w_ref=2 * math.pi * self.n)
        self.feed = FeedDrive(f_max=12e3, v_ref=self.feed_rate)
        self.balance = EnergyBalance(
            P_source=self.spindle.power + self.feed.power,
            P_cutting=self.drill.power_cutting,
            P_friction=self.drill.power_friction,
            P_damping=self.drill.power_damping,
            E=self.drill.energy
            + self.spindle.energy
            + self.feed.energy
            + self.m / 2 * self.slide.v**2
            + self.body.I_33 / 2 * self.joint.w**2,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.spindle.flange, self.joint.axis)
        yield connect(self.feed.flange, self.slide.axis)
