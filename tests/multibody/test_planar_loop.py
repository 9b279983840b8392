"""A planar loop on a base that floats: the closing joint hands on all of its force and moment."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, guess, part, structural
from acausal.errors import RunError
from acausal.library.multibody import (
    Body,
    BodyShape,
    FixedRotation,
    FixedTranslation,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
)
from tests.expected import fails_with


def _bar(length: float) -> BodyShape:
    return BodyShape(m=1.0, r=(length, 0.0, 0.0), r_CM=(length / 2, 0.0, 0.0), I_11=0.01, I_22=0.02, I_33=0.02)


class FloatingFourBar(Component):
    """Four bars without gravity, closed at a distance `d` [m] from their plane, one of them tilted by `tilt` [rad]."""

    d: float = structural(default=0.0)
    tilt: float = structural(default=0.0)
    world: World = World(g_0=(0.0, 0.0, 0.0))
    base: Body = Body(
        m=1.0,
        r_CM=(0.0, 0.0, 0.0),
        I_11=0.1,
        I_22=0.1,
        I_33=0.1,
        r_0=fixed((0.0, 0.0, 0.0)),
        v_0=fixed((0.0, 0.0, 0.0)),
    )
    crank: BodyShape = _bar(0.3)
    coupler: BodyShape = _bar(0.8)
    rocker: BodyShape = _bar(0.6)
    a: Revolute = Revolute(phi=fixed(1.2), w=fixed(3.0))
    b: Revolute = Revolute(phi=guess(-0.8))
    c: Revolute = Revolute(phi=guess(1.2))
    across: FixedTranslation = FixedTranslation(r=(0.7, 0.0, 0.0))
    beside: FixedTranslation = part()
    tilted: FixedRotation = part()
    closing: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()

    def build(self) -> None:
        self.beside = FixedTranslation(r=(0.0, 0.0, self.d))
        c, s = math.cos(self.tilt), math.sin(self.tilt)
        self.tilted = FixedRotation(R_rel=((1.0, 0.0, 0.0), (0.0, c, s), (0.0, -s, c)))

    def equations(self) -> Equations:
        yield connect(self.base.frame_a, self.a.frame_a, self.across.frame_a)
        yield connect(self.a.frame_b, self.crank.frame_a)
        yield connect(self.crank.frame_b, self.b.frame_a)
        yield connect(self.b.frame_b, self.coupler.frame_a)
        yield connect(self.across.frame_b, self.tilted.frame_a)
        yield connect(self.tilted.frame_b, self.c.frame_a)
        yield connect(self.c.frame_b, self.rocker.frame_a)
        yield connect(self.rocker.frame_b, self.beside.frame_a)
        yield connect(self.beside.frame_b, self.closing.frame_a)
        yield connect(self.closing.frame_b, self.coupler.frame_b)


@pytest.mark.parametrize("d", [0.0, 0.2])
def test_a_loop_closed_beside_its_plane_stays_in_it(d: float) -> None:
    """All masses, forces and speeds lie in one plane, so that the base turns about its normal only."""
    r = acausal.simulate(FloatingFourBar(d=d), stop_time=0.5, tolerance=1e-8)
    w = [float(str(r.final(f"base.w_a[{k}]"))) for k in range(3)]
    assert w[:2] == pytest.approx([0.0, 0.0], abs=1e-7)
    assert abs(w[2]) > 0.1


def test_a_loop_that_is_not_planar_is_refused() -> None:
    """With a hinge instead, which holds both axes parallel, the loop cannot even be closed."""
    with fails_with(RunError, "AC503", "the loop is not planar"):
        acausal.simulate(FloatingFourBar(tilt=0.3), stop_time=0.5)
