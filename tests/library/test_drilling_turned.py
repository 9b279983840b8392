"""A scene that is turned as a whole drills the same hole: space has no directions of its own.

The drill stands above the middle of the plate, where its tip is seen to be beside the axis by rounding errors only.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, structural
from acausal.library.drilling import DrillingForce
from acausal.library.multibody import Body, FixedRotation, Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY, Rotation, axis_rotation
from acausal.library.rotational import Speed
from acausal.library.translational import Force
from acausal.lower.compiled import CompiledModel

TURN = axis_rotation((0.3, 0.5, -0.2), math.radians(77.0))


class Turned(Component):
    """A drill of 5 kg is pushed with 300 N into a plate 1 mm below it; `R` turns all of it in the world."""

    R: Rotation = structural(default=IDENTITY)
    push: Real = parameter(default=300.0, unit="N")
    world: World = part()
    base: FixedRotation = part()
    slide: Prismatic = part()
    body: Body = part()
    spindle: Revolute = part()
    drill: DrillingForce = DrillingForce(t=0.05, k=1e8, d_c=2e4)
    force: Force = part()
    speed: Speed = part()

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.world, self.base, self.body = World(g=0.0), FixedRotation(R_rel=self.R), Body(m=5.0)
        self.slide = Prismatic(n=axis, s=fixed(-1e-3), v=fixed(0.0))
        self.spindle = Revolute(n=axis, phi=fixed(0.0))
        self.force, self.speed = Force(u=self.push), Speed(w_ref=2 * math.pi * 10.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.base.frame_a)
        yield connect(self.base.frame_b, self.slide.frame_a, self.drill.frame_w)
        yield connect(self.slide.frame_b, self.body.frame_a, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


@cache
def compiled(R: Rotation) -> CompiledModel:
    return acausal.compile(Turned(R=R))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk", "cvodes"])
def test_a_turned_scene_drills_the_same_hole(solver: str) -> None:
    straight, turned = (
        acausal.simulate(compiled(R), stop_time=2.0, tolerance=1e-8, solver=solver) for R in (IDENTITY, TURN)
    )
    assert straight.final("drill.s_tar") > 1e-4
    assert not turned.stats["notes"]
    for name in ("drill.s", "drill.s_tar", "drill.d_O"):
        np.testing.assert_allclose(turned.final(name), straight.final(name), atol=1e-10)
