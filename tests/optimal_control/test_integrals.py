"""Integrals are checked like states: an integrand may need more points than the motion."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, Equations, Real, der, fixed, signal_input, variable
from acausal.optimal_control import Problem


class Cart(Component):
    """At rest at zero; the input is its acceleration."""

    u: Real = signal_input(unit="m/s2")
    s: Real = variable(default=fixed(0.0), unit="m")
    v: Real = variable(default=fixed(0.0), unit="m/s")

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield der(self.v) == self.u


# s = t**2 / 2 is exact in one interval; the integral of s**4 to t = 2 is 2**9 / 144.
EXACT = 2**9 / 144


def pushed() -> Problem:
    problem = Problem(Cart())
    problem.phase(duration=2.0, intervals=1)
    problem.subject_to("u", min=1.0, max=1.0)
    problem.minimize(problem.integral(problem["s"] ** 4))
    return problem


@pytest.mark.parametrize("shooting", [None, "rk4"])
def test_a_coarse_integral_is_noted(shooting: str | None) -> None:
    best = pushed().solve(shooting=shooting, steps=1)
    stats: Any = best.stats
    error = abs(best.objective / EXACT - 1)
    assert error > 0.01
    assert stats["replay_error"] < 1e-6
    assert stats["interval_error"] == pytest.approx(error, rel=1e-4)
    assert "the mesh is coarse" in stats["notes"][0]


def test_accuracy_refines_for_an_integral() -> None:
    assert pushed().solve(accuracy=1e-6).objective == pytest.approx(EXACT, rel=1e-5)


def test_an_integral_whose_minimum_is_zero_is_no_coarse_mesh() -> None:
    problem = Problem(Cart())
    problem.phase(duration=2.0, intervals=2)
    problem.minimize(problem.integral((problem["u"] - 1.0) ** 2))
    best = problem.solve(accuracy=1e-6)
    assert best.stats["intervals"] == 2
    assert best.at(2.0, "s") == pytest.approx(2.0, rel=1e-6)
