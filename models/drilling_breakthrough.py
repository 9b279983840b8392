"""Breakthrough under a constant force: the surge of the drill with and without a feed cap."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, minimum, parameter, part, tan
from acausal.library.drilling import EnergyBalance, FeedCap, FullDrillingForce, PlateLevel, Workpiece
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.rotational import Speed
from acausal.library.translational import ElastoGap, Fixed, Force

NO_CAP = 1e3
"""A feed rate [m/s] that no drill reaches."""


class ConstantForceDrilling(Component):
    """A drill under a constant force through a plate; the feed cap brakes it above `v_max`.

    It starts at rest inside the hole that it has already drilled, `depth_start` deep and at full diameter. Beyond the
    plate it hits a depth stop, `clearance` after the full diameter is through.
    """

    F: Real = parameter(default=2000.0, unit="N", min=0.0, doc="Force on the drill along its axis")
    v_max: Real = parameter(default=NO_CAP, unit="m/s", min=0.0, doc="Feed cap")
    n: Real = parameter(default=9.28, unit="1/s", min=0.0, doc="Rotational speed")
    m: Real = parameter(default=5.0, unit="kg", min=0.0, doc="Mass of the drill with its spindle")
    t: Real = parameter(default=10e-3, unit="m", min=1e-6, doc="Thickness of the plate")
    depth_start: Real = parameter(default=8e-3, unit="m", min=0.0, doc="Depth of the hole at the start")
    clearance: Real = parameter(default=0.2e-3, unit="m", min=0.0, doc="Travel from full diameter through to the stop")

    world: World = part()
    slide: Prismatic = part()
    joint: Revolute = part()
    body: Body = part()
    drill: FullDrillingForce = part()
    workpiece: Workpiece = part()
    force: Force = part()
    cap: FeedCap = part()
    stop: ElastoGap = part()
    bench: Fixed = part()
    speed: Speed = part()
    balance: EnergyBalance = part()

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(self.depth_start), v=fixed(0.0))
        self.joint = Revolute(n=axis, phi=fixed(0.0))
        self.body = Body(m=self.m)
        self.workpiece = Workpiece(t=self.t)
        self.drill = FullDrillingForce(
            level=PlateLevel("workpiece"),
            t=self.workpiece.t,
            k=1e8,
            d_c=2e4,
            s_start=self.depth_start,
            feed_force_factor=math.sin(math.radians(59.0)),
        )
        self.force = Force(u=self.F)
        self.cap = FeedCap(v_max=self.v_max)
        cone = self.drill.d / (2 * tan(self.drill.sigma / 2))
        self.stop = ElastoGap(c=1e7, d=1e4)
        self.bench = Fixed(s0=self.t + cone + self.clearance)
        self.speed = Speed(w_ref=2 * math.pi * self.n)
        self.balance = EnergyBalance(
            P_source=self.F * self.slide.v - self.speed.flange.tau * self.speed.w,
            P_cutting=self.drill.power_cutting,
            P_friction=self.drill.power_friction,
            P_damping=self.drill.power_damping + self.cap.power + self.stop.loss_power,
            E=self.drill.energy
            + self.stop.c / 2 * minimum(self.stop.s_rel, 0.0) ** 2
            + self.m / 2 * self.slide.v**2
            + self.body.I_33 / 2 * self.joint.w**2,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.force.flange, self.cap.flange, self.stop.flange_a, self.slide.axis)
        yield connect(self.stop.flange_b, self.bench.flange)
        yield connect(self.speed.flange, self.joint.axis)


class BreakthroughSurge(Component):
    """Two equal drills under the same force break through: `free`, and `capped` to a feed rate.

    As the cone leaves the plate, the same force acts on an ever smaller width. The free drill surges, limited only by
    its inertia, until it hits the depth stop.
    """

    F: Real = parameter(default=2000.0, unit="N", min=0.0, doc="Force on both drills along their axes")
    v_max: Real = parameter(default=2e-3, unit="m/s", min=0.0, doc="Feed cap of the second drill")

    free: ConstantForceDrilling = part()
    capped: ConstantForceDrilling = part()

    experiment: ClassVar[Experiment] = Experiment(
        stop_time=8.0, tolerance=1e-8, solver="rosenbrock", output_interval=2e-3
    )
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("free.drill.s", "capped.drill.s"), title="Depth of the tip", unit="mm"),
        Panel(("free.slide.v", "capped.slide.v"), title="Feed rate", unit="mm/s"),
        Panel(("free.drill.f_z", "capped.drill.f_z"), title="Feed per edge", unit="mm"),
        Panel(("free.drill.torque", "capped.drill.torque"), title="Cutting torque", unit="N.m"),
        Panel(("free.drill.thrust", "capped.drill.thrust", "capped.cap.f"), title="Thrust and brake", unit="N"),
    )

    def build(self) -> None:
        self.free = ConstantForceDrilling(F=self.F)
        self.capped = ConstantForceDrilling(F=self.F, v_max=self.v_max)

    def equations(self) -> Equations:
        yield from ()
