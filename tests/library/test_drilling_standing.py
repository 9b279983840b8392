"""A drill that does not turn against its workpiece is pressed into it as a spring, and drills nothing.

Equation (20) of the founding paper with n = 0: F_N = k s + d_c v, at rest s = F / k. Only the rotation of the drill
against the workpiece counts, so both may as well turn together.
"""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part
from acausal.library.drilling import DrillingForce
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.rotational import Speed
from acausal.library.translational import Force

SOLVERS = ["idas", "rosenbrock"]  # which gave up where the damper begins to push
FORCE, K = 1500.0, 1e8


class Pressed(Component):
    """A drill of 5 kg on a guide is pushed with 1500 N into a plate 1 mm below it, without a spindle."""

    world: World = World(g=0.0)
    slide: Prismatic = Prismatic(n=(0.0, 0.0, 1.0), s=fixed(-1e-3), v=fixed(0.0))
    body: Body = Body(m=5.0)
    drill: DrillingForce = DrillingForce(t=0.05, k=K, d_c=2e4)
    force: Force = Force(u=FORCE)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.drill.frame_w)
        yield connect(self.slide.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.force.flange, self.slide.axis)


class TurningTogether(Component):
    """The same drill on a spindle with 9.28 1/s, above a plate that turns as fast."""

    world: World = World(g=0.0)
    slide: Prismatic = part()
    spindle: Revolute = part()
    table: Revolute = part()
    body: Body = Body(m=5.0)
    drill: DrillingForce = DrillingForce(t=0.05, k=K, d_c=2e4)
    force: Force = Force(u=FORCE)
    speed: Speed = part()
    table_speed: Speed = part()

    def build(self) -> None:
        up = (0.0, 0.0, 1.0)
        self.slide = Prismatic(n=up, s=fixed(-1e-3), v=fixed(0.0))
        self.spindle, self.table = Revolute(n=up, phi=fixed(0.0)), Revolute(n=up, phi=fixed(0.0))
        self.speed, self.table_speed = (Speed(w_ref=2 * math.pi * 9.28) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.table.frame_a)
        yield connect(self.slide.frame_b, self.body.frame_a, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.table.frame_b, self.drill.frame_w)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)
        yield connect(self.table_speed.flange, self.table.axis)


@pytest.mark.parametrize("scene", [Pressed(), TurningTogether()], ids=["still", "both"])
def test_a_drill_that_stands_still_is_a_spring(scene: Component) -> None:
    compiled = acausal.compile(scene)
    for solver in SOLVERS:
        r = acausal.simulate(compiled, stop_time=0.05, tolerance=1e-8, solver=solver)
        assert not r.stats["notes"], solver
        assert r.final("slide.s") == pytest.approx(FORCE / K, rel=1e-6), solver
        assert r.final("drill.s_tar") == 0.0, solver
