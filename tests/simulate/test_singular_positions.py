"""Parallelograms that are stretched out on their way, where two motions meet, and linkages that only come near."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, guess, parameter, part
from acausal.library.multibody import BodyShape, FixedTranslation, Revolute, RevolutePlanarLoopConstraint, World

CRANK: dict[str, Any] = {"r": (0.3, 0.0, 0.0), "r_CM": (0.15, 0.0, 0.0), "I_33": 0.01}


class Linkage(Component):
    """Two cranks with a coupler of 1 m between them, which turn without loads; the plane is level."""

    base: Real = parameter(default=1.0, unit="m", doc="Distance of the pivots; that of a parallelogram is 1 m")
    world: World = World(n=(0.0, 0.0, -1.0))
    first: Revolute = Revolute(phi=fixed(0.5), w=fixed(2.0))
    second: Revolute = Revolute(phi=guess(0.5), w=guess(2.0))
    crank: BodyShape = BodyShape(m=1.0, **CRANK)
    follower: BodyShape = BodyShape(m=1.5, **CRANK)
    ground: FixedTranslation = part()
    knee: Revolute = Revolute(phi=guess(-0.5), w=guess(-2.0))
    coupler: BodyShape = BodyShape(m=2.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0), I_33=0.1)
    closing: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()

    def build(self) -> None:
        self.ground = FixedTranslation(r=(self.base, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.first.frame_a, self.ground.frame_a)
        yield connect(self.ground.frame_b, self.second.frame_a)
        yield connect(self.first.frame_b, self.crank.frame_a)
        yield connect(self.second.frame_b, self.follower.frame_a)
        yield connect(self.crank.frame_b, self.knee.frame_a)
        yield connect(self.knee.frame_b, self.coupler.frame_a)
        yield connect(self.coupler.frame_b, self.closing.frame_a)
        yield connect(self.closing.frame_b, self.follower.frame_b)


def noted(result: acausal.Result) -> bool:
    return "its constraints depend on each other" in str(result.stats["notes"])


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_run_through_a_position_where_two_motions_meet_says_so(solver: str) -> None:
    """Velocities do not jump, so both cranks turn on at 2 rad/s; `rosenbrock` turned back at 1.32 s, without a word."""
    result = acausal.simulate(Linkage(), stop_time=2.0, tolerance=1e-6, solver=solver)
    assert noted(result)
    if solver == "idas":
        for name in ("first.phi", "second.phi"):
            np.testing.assert_allclose(result[name], 0.5 + 2.0 * result.time, atol=1e-5)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_linkage_that_only_comes_near_is_not_noted(solver: str) -> None:
    """Not before the position, and not where the pivots are 2 cm farther apart; energy is that of the start."""
    assert not noted(acausal.simulate(Linkage(), stop_time=1.2, solver=solver))
    result = acausal.simulate(Linkage(), parameters={"base": 1.02}, stop_time=2.0, tolerance=1e-8, solver=solver)
    assert not noted(result)
    energy = np.zeros(len(result.time))
    for body, m, inertia, half in (
        ("crank", 1.0, 0.01, 0.15),
        ("follower", 1.5, 0.01, 0.15),
        ("coupler", 2.0, 0.1, 0.5),
    ):
        w = result[f"{body}.w_a"][:, 2]
        centre = result[f"{body}.v_0"] + result[f"{body}.frame_a.R"][:, :, 1] * (half * w)[:, None]
        energy += m / 2 * np.sum(centre**2, axis=1) + inertia / 2 * w**2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
