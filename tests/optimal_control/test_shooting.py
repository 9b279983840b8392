"""Multiple shooting with exported steps, and fatrop: other transcriptions and solvers of the same problems."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from acausal.errors import OptimizationError, UsageError
from acausal.models.optimal_control.ball_target import gentle_throw
from acausal.models.optimal_control.cart_pole import swing_up
from acausal.optimal_control import Optimum, Problem
from tests.expected import fails_with
from tests.export.scenes import DrivenSlider, Slider


def rest_to_rest(model: type[Slider] | type[DrivenSlider], cost: str, intervals: int) -> Problem:
    """From rest at 0 to rest at 1 in one second at the least integral of a square."""
    problem = Problem(model())
    problem.phase(duration=1.0, intervals=intervals)
    problem.subject_to(problem.end("mass.s") == 1.0)
    problem.subject_to(problem.end("mass.v") == 0.0)
    problem.minimize(problem.integral(problem[cost] ** 2))
    return problem


def test_a_force_that_is_held_costs_a_little_more() -> None:
    """With n constant forces the least sum of squares over n that moves 1 m is 12/(1 - 1/n**2): discrete calculus.

    Momentum 0 and displacement 1 are sum(u)/n = 0 and sum(u (n - k - 1/2))/n**2 = 1; u is linear in k.
    """
    best = rest_to_rest(Slider, "u", 10).solve(shooting="rk4", steps=1)
    assert best.objective == pytest.approx(12.0 / (1 - 1 / 10**2), rel=1e-7)
    assert max(best.error(best.replay()).values()) < 1e-6


@cache
def collocated_swing_up() -> Optimum:
    return swing_up().solve(control=0, degree=6)


@pytest.mark.parametrize("method", ["rk4", "rosenbrock", "sdirk"])
def test_shooting_finds_the_optimum_of_collocation(method: str) -> None:
    """The same swing-up, inputs constant in each of 20 intervals: to 1e-6 where the steps are exact enough."""
    fine = {"rk4": 12, "rosenbrock": 8, "sdirk": 4}[method]
    within = {"rk4": 1e-6, "rosenbrock": 2e-4, "sdirk": 5e-2}[method]
    shot, collocated = swing_up().solve(shooting=method, steps=fine), collocated_swing_up()
    assert shot.objective == pytest.approx(collocated.objective, rel=within)


def test_algebraic_variables_are_shot_through() -> None:
    """The drive's current, which is the force, is found in each step."""
    best = rest_to_rest(DrivenSlider, "current", 10).solve(shooting="sdirk", steps=4)
    assert best.objective == pytest.approx(12.0 / (1 - 1 / 10**2), rel=1e-4)


def test_phases_and_jumps_are_shot_through() -> None:
    assert gentle_throw().solve(shooting="rk4").objective == pytest.approx(gentle_throw().solve().objective, rel=1e-8)


def test_fatrop_says_when_it_stops_early() -> None:
    problem = rest_to_rest(Slider, "u", 10)
    with fails_with(OptimizationError, "AC703", match="no solution after 0 iterations"):
        problem.solve(solver="fatrop", options={"max_iter": 0})
    with fails_with(UsageError, "AC053", match="fatrop does not accept these options"):
        problem.solve(solver="fatrop", options={"acceptable_tol": 1.0})


def test_fatrop_finds_what_ipopt_finds() -> None:
    problem = swing_up()
    by = {name: problem.solve(solver=name) for name in ("ipopt", "fatrop")}
    assert by["fatrop"].stats["solver"] == "fatrop"
    assert by["fatrop"].objective == pytest.approx(by["ipopt"].objective, rel=1e-6)
    np.testing.assert_allclose(by["fatrop"]["f"], by["ipopt"]["f"], atol=1e-3)


@pytest.mark.parametrize(
    "options",
    [
        {"shooting": "euler"},
        {"shooting": "rk4", "steps": 0},
        {"shooting": "rk4", "steps": 1.5},
        {"solver": "knitro"},
        {"control": 3},
    ],
)
def test_unknown_ways_are_refused(options: dict[str, str]) -> None:
    with fails_with(UsageError, "AC053") as refused:
        rest_to_rest(Slider, "u", 4).solve(**options)  # type: ignore[arg-type]
    assert refused.value.help
