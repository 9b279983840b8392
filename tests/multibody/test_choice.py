"""States of constraints without a safe choice: judged wherever a run may go, not only around its start."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, guess, part, structural, variable
from acausal.library.multibody import BodyShape, Fixed, Revolute, RevolutePlanarLoopConstraint, World


class LongPendulum(Component):
    """A point mass on a circle of radius 5, of nominal magnitude 1: around the start x is always positive."""

    x: Real = variable(default=fixed(5.0))
    y: Real = variable(default=guess(0.0))
    vx: Real = variable()
    vy: Real = variable(default=fixed(0.0))
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.x * self.f
        yield der(self.vy) == -self.y * self.f - 9.81
        yield self.x**2 + self.y**2 == 25.0


class FourBar(Component):
    """Lengths of ground, crank, coupler and rocker; the start is exact."""

    ground: float = structural(default=1.0)
    crank: float = structural(default=0.4)
    coupler: float = structural(default=1.0)
    rocker: float = structural(default=0.8)
    angle: float = structural(default=0.25)
    world: World = World()
    base: Fixed = part()
    joints: list[Revolute] = part()
    links: list[BodyShape] = part()
    last: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()

    def build(self) -> None:
        self.base = Fixed(r=(self.ground, 0.0, 0.0))
        a = self.crank * np.array([math.cos(self.angle), math.sin(self.angle)])
        way = np.array([self.ground, 0.0]) - a
        length = float(np.hypot(*way))
        inner = math.acos((self.coupler**2 + length**2 - self.rocker**2) / (2 * self.coupler * length))
        turn = math.atan2(way[1], way[0]) + inner
        b = a + self.coupler * np.array([math.cos(turn), math.sin(turn)])
        last = math.atan2(-b[1], self.ground - b[0])
        starts = guess(turn - self.angle), guess(last - turn)
        self.joints = [Revolute(phi=fixed(self.angle), w=fixed(2.0)), *(Revolute(phi=s) for s in starts)]
        self.links = [
            BodyShape(m=1.0, r=(r, 0.0, 0.0), r_CM=(r / 2, 0.0, 0.0), I_33=r**2 / 12)
            for r in (self.crank, self.coupler, self.rocker)
        ]

    def equations(self) -> Equations:
        before = self.world.frame_b
        for joint, link in zip(self.joints, self.links, strict=True):
            yield connect(before, joint.frame_a)
            yield connect(joint.frame_b, link.frame_a)
            before = link.frame_b
        yield connect(before, self.last.frame_a)
        yield connect(self.last.frame_b, self.base.frame_b)


def test_a_coordinate_that_starts_far_from_zero_may_come_there() -> None:
    compiled = acausal.compile(LongPendulum())
    assert compiled.states == ("x", "y", "vx", "vy")
    run = acausal.simulate(compiled, stop_time=10.0, tolerance=1e-8)
    np.testing.assert_allclose(run["x"] ** 2 + run["y"] ** 2, 25.0, rtol=1e-12)
    energy = 0.5 * (run["vx"] ** 2 + run["vy"] ** 2) + 9.81 * run["y"]
    np.testing.assert_allclose(energy, 0.0, atol=1e-5)
    assert float(np.min(run["x"])) == pytest.approx(-5.0, abs=1e-2)


@pytest.mark.parametrize(
    ("sizes", "angle"),
    [((0.5, 1.1, 0.81, 1.36), 1.21), ((0.45, 0.96, 1.03, 1.41), -1.29), ((1.0, 0.4, 1.0, 0.8), 0.25)],
)
def test_the_states_of_a_four_bar_do_not_depend_on_its_start(sizes: tuple[float, ...], angle: float) -> None:
    """No angle of a four-bar determines the others all around, so that all three and their rates are states."""
    ground, crank, coupler, rocker = sizes
    model = FourBar(ground=ground, crank=crank, coupler=coupler, rocker=rocker, angle=angle)
    assert len(acausal.compile(model, cache=False).states) == 6
