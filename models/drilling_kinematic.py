"""Drilling through a thin plate at prescribed feed rate and rotation: the kinematic scene of the founding paper."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part
from acausal.library.drilling import KinematicDrillingForce, Workpiece
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.rotational import Speed as RotationalSpeed
from acausal.library.translational import Speed as TranslationalSpeed


class ThinPlate(Component):
    """A 16 mm drill with prescribed feed goes through a plate thinner than its cone.

    Section 3.1 of the founding paper: n = 9.28 1/s, v = 1.672 mm/s, 34CrMo4. The first touch is at time 0. While
    both ends of the engaged part of the cone move, the forces stay constant although the diameters grow.
    """

    n: Real = parameter(default=9.28, unit="1/s", doc="Rotational speed")
    v: Real = parameter(default=1.672e-3, unit="m/s", doc="Feed rate")

    world: World = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: KinematicDrillingForce = part()
    workpiece: Workpiece = part()
    feed: TranslationalSpeed = part()
    speed: RotationalSpeed = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, solver="rk2", step=1e-3)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("drill.F_c", "drill.F_f"), title="Forces", unit="N"),
        Panel(("drill.d_O", "drill.d_I"), title="Diameters", unit="mm"),
    )

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.slide = Prismatic(n=axis, s=fixed(0.0))
        self.spindle = Revolute(n=axis, phi=fixed(0.0))
        self.workpiece = Workpiece(t=1e-3)
        self.drill = KinematicDrillingForce(
            t=self.workpiece.t, width=self.workpiece.width, height=self.workpiece.height, axis_a=axis
        )
        self.feed = TranslationalSpeed(v_ref=self.v)
        self.speed = RotationalSpeed(w_ref=2.0 * math.pi * self.n)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)
