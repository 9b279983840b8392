"""Drilling into a thick block with a prescribed force: the dynamic scene of the founding paper."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part, structural
from acausal.library.blocks import Gain, TimeTable
from acausal.library.drilling import DrillingForce, PlateLevel, Workpiece
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.rotational import Speed
from acausal.library.translational import Force

Points = tuple[tuple[float, float], ...]

FORCE: Points = (
    (0.0, 0.0),
    (1.0, 0.0),
    (2.0, 2000.0),
    (20.0, 2000.0),
    (22.0, 4000.0),
    (34.0, 4000.0),
    (35.0, 500.0),
    (40.0, 500.0),
)
"""Rows (time [s], force on the drill along its axis [N])."""

SPEED: Points = (
    (0.0, 0.0),
    (5.0, 0.0),
    (6.0, 9.28),
    (28.0, 9.28),
    (29.0, 4.64),
    (36.0, 4.64),
    (37.0, 0.0),
    (40.0, 0.0),
)
"""Rows (time [s], rotational speed of the drill [1/s])."""


class ThickBlock(Component):
    """A drill in a steel block under prescribed force and speed: pressed without rotation, drilling, at rest again.

    Composed as in Figure 5 of the founding paper, section 3.2: a force and an angular velocity source move the drill on
    a prismatic and a revolute joint; the drilling force acts between the drill and the block. The paper states neither
    mass, stiffness, damping nor the profiles; docs/drilling.md explains their choice. There is no gravity.
    """

    force_profile: Points = structural(default=FORCE, doc="Rows (time [s], force [N]), straight in between")
    speed_profile: Points = structural(default=SPEED, doc="Rows (time [s], rotational speed [1/s])")
    as_printed: bool = structural(default=False, doc="Contact force by equation (21) instead of (20)")
    m: Real = parameter(default=5.0, unit="kg", min=0.0, doc="Mass of the drill with its spindle")
    gap: Real = parameter(default=1e-3, unit="m", doc="Distance from the tip to the block at the start")

    world: World = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    body: Body = part()
    drill: DrillingForce = part()
    workpiece: Workpiece = part()
    force_table: TimeTable = part()
    force: Force = part()
    speed_table: TimeTable = part()
    turns_to_radians: Gain = part()
    speed: Speed = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=40.0, tolerance=1e-8, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("drill.s", "drill.s_tar"), title="Actual and target depth", unit="mm"),
        Panel(("force.u", "drill.F_f"), title="Force", unit="N"),
        Panel(("drill.F_c",), title="Cutting force", unit="N"),
        Panel(("drill.n",), title="Rotation", unit="1/s"),
        Panel(("drill.k_c",), title="Specific cutting force", unit="N/mm2"),
    )

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(-self.gap), v=fixed(0.0))
        self.spindle = Revolute(n=axis, phi=fixed(0.0))
        self.body = Body(m=self.m)
        self.workpiece = Workpiece(t=0.05)
        self.drill = DrillingForce(
            level=PlateLevel("workpiece"),
            t=self.workpiece.t,
            width=self.workpiece.width,
            height=self.workpiece.height,
            axis_a=axis,
            as_printed=self.as_printed,
            k=1e8,
            d_c=2e4,
        )
        self.force_table = TimeTable(table=self.force_profile)
        self.force = Force()
        self.speed_table = TimeTable(table=self.speed_profile)
        self.turns_to_radians = Gain(k=2.0 * math.pi)
        self.speed = Speed()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.force_table.y, self.force.u)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed_table.y, self.turns_to_radians.u)
        yield connect(self.turns_to_radians.y, self.speed.w_ref)
        yield connect(self.speed.flange, self.spindle.axis)
