"""Errors of a solution are told: of integrals, of a solver that stops early, of inputs that a result cannot hold."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    parameter,
    quantity,
    signal_input,
    sin,
    time,
    variable,
    where,
)
from acausal.errors import OptimizationError, UsageError
from acausal.library.blocks import TimeTable
from acausal.optimal_control import Problem
from tests.expected import fails_with
from tests.optimal_control.test_rounding import Rubbing


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


def least_time() -> Problem:
    """One metre from rest to rest with at most 1 m/s2 takes 2 s."""
    problem = Problem(Cart())
    problem.phase(duration=(0.1, 10.0), intervals=4)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.subject_to(problem.end("s") == 1.0)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(problem.duration)
    return problem


def test_a_solution_that_misses_the_tolerance_is_noted() -> None:
    """An acceptable tolerance of 1000 stops ipopt above the least time."""
    stopped = least_time().solve(options={"acceptable_tol": 1e3, "acceptable_iter": 1})
    stats: Any = stopped.stats
    assert stopped.objective > 2.001
    assert "before it reaches the tolerance" in stats["notes"][0]
    reached: Any = least_time().solve().stats
    assert not any("tolerance" in note for note in reached["notes"])


def test_inputs_that_a_series_cannot_hold_are_refused() -> None:
    """Through four values of an interval a cubic passes, but no polynomial of degree four."""
    problem = Problem(Cart())
    problem.phase(duration=1.0, intervals=1)
    problem.minimize(problem.integral((problem["u"] - ca.sin(9.0 * problem.time)) ** 2))
    with fails_with(UsageError, "AC053", "degree 4"):
        problem.solve(degree=7, control=4)
    cubic: Any = problem.solve(degree=7, control=3).stats
    assert cubic["replay_error"] < 1e-6


def test_a_phase_ends_when_its_condition_first_holds() -> None:
    """The least speed at one metre within 9 s would be that of a return from beyond, which is no end there."""
    problem = Problem(Cart())
    phase = problem.phase(until=problem["s"] >= 1.0, duration=(0.1, 9.0), expected=2.0)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.minimize(problem.end("v"))
    problem.guess(inputs={"u": 1.0})
    with fails_with(OptimizationError, "AC704", "holds inside it"):
        problem.solve()
    phase.subject_to("v", min=0.0)
    assert problem.solve().objective == pytest.approx(0.0, abs=1e-6)


class Square(Component):
    """No state: the output is the square of the input."""

    u: Real = signal_input(min=0.0, max=1.0)
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == self.u**2


def test_a_model_without_states_has_an_optimum() -> None:
    """The least square of u >= 1 / 2."""
    problem = Problem(Square())
    problem.phase(duration=1.0, intervals=2)
    problem.subject_to("u", min=0.5)
    problem.minimize(problem.integral("y"))
    assert problem.solve().objective == pytest.approx(0.25, rel=1e-6)


def test_large_integrals_are_checked_as_small_ones() -> None:
    """A factor of a million changes no relative error."""
    problem = pushed()
    problem.minimize(1e6 * problem.integral(1e6 * problem["s"] ** 4))
    assert problem.solve(accuracy=1e-6).objective == pytest.approx(1e12 * EXACT, rel=1e-5)


def test_a_constraint_on_a_truth_value_is_refused() -> None:
    """`u <= 1` is 0 or 1, so a bound of -1 always holds, and an equation with 1 has no slope."""
    problem = Problem(Cart())
    problem.phase(duration=1.0, intervals=1)
    u = problem["u"]
    for constraint in ((u <= 1.0) >= -1.0, ca.logic_and(u <= 1.0, u >= 0.0) == 1.0, ca.logic_not(u <= 1.0)):
        with fails_with(UsageError, "AC051", "is on a truth value"):
            problem.subject_to(constraint)
    with fails_with(UsageError, "AC051", "is on a truth value"):
        problem.subject_to(ca.logic_or(u <= 1.0, u >= 3.0), min=1.0)


@pytest.mark.parametrize("stated", ["u", "relation", "square"])
def test_a_limit_between_the_points_is_kept_or_noted(stated: str) -> None:
    """An input may leave its limit between the points, and be faster than 2 sqrt(d/a), only where a note says so."""
    problem = Problem(Cart())
    problem.phase(duration=(0.1, 10.0), intervals=7)
    u = problem["u"]
    if stated == "u":
        problem.subject_to("u", min=-1.0, max=1.0)
    elif stated == "relation":
        problem.subject_to(u <= 1.0)
        problem.subject_to(-1.0 <= u)
    else:
        problem.subject_to(u**2 <= 1.0)
    problem.subject_to(problem.end("s") == 4.0)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(problem.duration)
    best = problem.solve()
    largest = float(np.abs(best.at(np.linspace(0.0, float(best.time[-1]), 1000), "u")).max())
    notes: Any = best.stats["notes"]
    if stated == "square":
        assert largest > 1.1
        assert "sq(u) <= 1 is violated between the points" in notes[0]
    else:
        assert largest < 1.0 + 1e-6
        assert best.objective > 4.0
        assert notes == ()


class Priced(Component):
    """A way at a price that is 10 for 20 ms, which no state follows."""

    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(0.0), unit="s")
    price: TimeTable = TimeTable(
        table=((0.0, 0.0), (0.45, 0.0), (0.45, 10.0), (0.47, 10.0), (0.47, 0.0), (1.0, 0.0)), offset=0.0
    )

    def equations(self) -> Equations:
        yield der(self.x) == self.u


def test_a_pulse_of_a_table_in_an_integral_is_noted() -> None:
    """The points miss it, so u = 1 costs 1, where the pulse adds a fifth."""
    problem = Problem(Priced())
    problem.phase(duration=1.0, intervals=4)
    problem.subject_to(problem.end("x") == 1.0)
    problem.minimize(problem.integral(problem["u"] ** 2 + problem["price.y"] * problem["u"]))
    best = problem.solve()
    stats: Any = best.stats
    assert best.objective == pytest.approx(1.0, rel=1e-6)
    assert stats["interval_error"] == pytest.approx(0.2 / 1.2, rel=1e-4)
    assert "the mesh is coarse" in stats["notes"][0]


class Silent(Component):
    """No state, and no input that acts."""

    u: Real = signal_input(default=0.0)
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == sin(quantity(50.0, "1/s") * time) + 0.0 * self.u


def test_integrals_of_models_without_states_are_checked() -> None:
    """The integral of sin(50 t)**2 over a second is 1/2 - sin(100)/200; nothing constrains the program."""
    problem = Problem(Silent())
    problem.phase(duration=1.0, intervals=5)
    problem.minimize(problem.integral(problem["y"] ** 2 + problem["u"] ** 2))
    best, exact = problem.solve(), 0.5 - np.sin(100.0) / 200
    stats: Any = best.stats
    assert abs(best.objective / exact - 1) > 0.01
    assert "the mesh is coarse" in stats["notes"][0]
    assert problem.solve(accuracy=1e-6).objective == pytest.approx(exact, rel=1e-5)


def test_integrals_with_complementarity_are_those_of_a_run() -> None:
    """A steep power of the speed of a block that stops and turns round, against the trapezium rule along the replay."""
    problem = Problem(Rubbing())
    problem.phase(duration=8.0, intervals=14)
    problem.subject_to(problem.end("x") == 0.0)
    problem.subject_to(problem.end("v") == 0.0)
    steep = problem.integral(problem["v"] ** 24)
    problem.minimize(problem.integral(problem["u"] ** 2) + 0.1 * steep)
    problem.guess(inputs={"u": -0.6})
    best = problem.solve(complementarity=True)
    run = best.replay(output_interval=1e-3)
    exact = float(np.trapezoid(np.asarray(run["u"]) ** 2 + 0.1 * np.asarray(run["v"]) ** 24, run.time))
    stats: Any = best.stats
    assert stats["replay_error"] < 0.01
    assert abs(best.objective / exact - 1) > 1e-3
    assert "of the magnitude of a state or an integral" in stats["notes"][0]


class Switched(Component):
    """A rate that switches on after a delay that may be decided."""

    delay: Real = parameter(default=0.5, min=0.0, max=5.0, unit="s")
    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(0.0), unit="s")

    def equations(self) -> Equations:
        yield der(self.x) == self.u + where(time > self.delay, 1.0, 0.0)


def test_a_parameter_without_a_slope_is_noted() -> None:
    """x(1) = 0.3 costs nothing where the rate switches on at 0.7 s, which only a phase that ends there finds."""
    problem = Problem(Switched())
    problem.decide("delay")
    problem.phase(duration=1.0, intervals=4)
    problem.subject_to(problem.end("x") == 0.3)
    problem.minimize(problem.integral(problem["u"] ** 2))
    notes: Any = problem.solve().stats["notes"]
    assert "nothing changes with delay near the solution" in notes[0]
    problem = Problem(Switched())
    delay = problem.decide("delay")
    problem.phase("off", until=problem.time >= delay, intervals=2, expected=0.5)
    problem.phase("on", duration=(0.0, 1.0), intervals=2)
    problem.subject_to(problem.duration == 1.0)
    problem.subject_to(problem.end("x") == 0.3)
    problem.minimize(problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.objective == pytest.approx(0.0, abs=1e-8)
    assert best.parameters["delay"] == pytest.approx(0.7, abs=1e-6)
    assert best.stats["notes"] == ()


def far() -> Problem:
    """As far as possible from zero in a second with at most 1 m/s2, to either side; by symmetry zero is stationary."""
    problem = Problem(Cart())
    problem.phase(duration=1.0, intervals=4)
    problem.subject_to("u", min=-1.0, max=1.0)
    problem.minimize(-(problem.end("s") ** 2))
    return problem


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_a_stationary_guess_is_left(solver: str) -> None:
    """s = u / 2 is 1/2 at most."""
    assert far().solve(solver=solver).objective == pytest.approx(-0.25, rel=1e-6)


def test_a_controller_leaves_a_stationary_guess() -> None:
    assert abs(far().controller()([0.0, 0.0])["u"]) == pytest.approx(1.0, abs=1e-4)


def test_a_greatest_value_is_no_minimum() -> None:
    problem = Problem(Cart())
    problem.phase(duration=1.0, intervals=4)
    problem.minimize(-problem.integral(problem["u"] ** 2))
    with fails_with(OptimizationError, "AC702"):
        problem.solve()


def test_a_path_that_is_demanded_exactly_is_not_violated_by_rounding() -> None:
    """v = t / 2 costs a quarter."""
    problem = Problem(Cart())
    problem.phase(duration=1.0, intervals=4)
    problem.subject_to(problem["v"] == 0.5 * problem.time)
    problem.minimize(problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.objective == pytest.approx(0.25, rel=1e-6)
    assert best.stats["notes"] == ()


class Limited(Component):
    """x grows at u; its declared limit is no constraint."""

    x: Real = variable(default=fixed(0.0), max=0.5)
    u: Real = signal_input(min=0.0, max=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.u


def test_a_solution_beyond_the_limits_of_a_variable_says_so() -> None:
    """At u = 1, the greatest x(1) is 1."""
    problem = Problem(Limited())
    problem.phase(duration=1.0, intervals=4)
    problem.minimize(-problem.end("x"))
    best = problem.solve()
    assert float(best.final("x")) == pytest.approx(1.0, abs=1e-5)
    stats: Any = best.stats
    assert [n for n in stats["notes"] if n.startswith("beyond limits: x (") and "max = 0.5" in n]
