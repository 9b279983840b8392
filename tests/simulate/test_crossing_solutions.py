"""Algebraic equations whose solutions cross, and others that only come near: told or refused, or solved."""

from __future__ import annotations

from collections.abc import Callable
from math import log
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    cos,
    der,
    exp,
    fabs,
    fixed,
    guess,
    maximum,
    minimum,
    signal_input,
    sin,
    sqrt,
    structural,
    variable,
    where,
)
from acausal.errors import IntegrationError
from acausal.optimal_control import Problem
from tests.stepping import walk

SOLVERS = ["idas", "rosenbrock", "cvodes", "erk", "rk", "rk2", "collocation"]


class Crossing(Component):
    """x = t - 1, some equations for y and z, and the integral of y."""

    equation: str = structural(default="product")
    x: Real = variable(default=fixed(-1.0))
    y: Real = variable(default=guess(-1.0))
    z: Real = variable(default=guess(-1.0))
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.w) == self.y
        for residual in RESIDUALS[self.equation](self.x, self.y, self.z):
            yield residual == 0.0


# The solutions that begin at y = -1, or near zero, meet others at x = 0.
Residuals = Callable[[Any, Any, Any], list[Any]]
CROSSING: dict[str, Residuals] = {
    "product": lambda x, y, z: [y * (x - y), z - y],
    "squares": lambda x, y, z: [y**2 - x**2, z - y],
    "two": lambda x, y, z: [y * z - x**2, y**3 + y - z**3 - z],
    # a parallelogram of cranks of 0.3 and a coupler of 1, whose angle z + 1 stays zero unless it turns over
    "parallelogram": lambda x, y, z: [
        0.3 * cos(x) + cos(z + 1.0) - 1.0 - 0.3 * cos(y),
        0.3 * sin(x) + sin(z + 1.0) - 0.3 * sin(y),
    ],
    "near": lambda x, y, z: [y * (x - y) + 1e-12, z - y],
    # three meet, and the sign of the determinant, 2 x^2 on this one, stays
    "three": lambda x, y, z: [y**3 - x**2 * y, z - y],
    # the same kind without a product: sin(x) and -sin(x) on a circle
    "circle": lambda x, y, z: [y**2 + z**2 - 1.0, z - cos(x)],
    # determinants that jump from -1 to 1, between steps and as an event, and one that is zero at a kink
    "kink": lambda x, y, z: [fabs(y) - fabs(x), z - y],
    "event": lambda x, y, z: [where(y > 0.0, y, -y) - where(x > 0.0, x, -x), z - y],
    "zero at a kink": lambda x, y, z: [minimum(y, y - x) * maximum(y, y - x), z - y],
}
# One solution, or another one that stays away: the integral of y from x = -1 to 1, where there is a short one.
HEALTHY: dict[str, Residuals] = {
    "turbulent": lambda x, y, z: [y * fabs(y) + 1e-3 * y - x, z - y],
    "factor": lambda x, y, z: [x * (exp(y) - exp(-1.0)), z - y],
    "rectifier": lambda x, y, z: [1e-9 * (exp(y / 0.025) - 1.0) - (3.0 * x - y) / 100.0, z - y],
    "smooth turn": lambda x, y, z: [y * (x - y) + 1e-6, z - y],
    "touched factor": lambda x, y, z: [x**2 * (exp(y) - exp(-1.0)), z - y],
    # kinks and jumps of one solution: y is x / 3 or x, and another residual on each side
    "kinked": lambda x, y, z: [where(y > 0.0, 3.0 * y, y) - x, z - y],
    "blocks": lambda x, y, z: [where(y < 0.0, x - y, y**3 + y - x), z - y],
    "near three": lambda x, y, z: [y**3 + (x**2 + 1e-3) * (y - x), z - y],
}
NEARER: dict[str, Residuals] = {"nearer": lambda x, y, z: [y * (x - y) + 1e-9, z - y]}
# singular all along y = x, where it begins
SINGULAR: dict[str, Residuals] = {"double": lambda x, y, z: [y * fabs(x - y), z - y]}
RESIDUALS = {**CROSSING, **HEALTHY, **NEARER, **SINGULAR}


def run(equation: str, solver: str, **options: Any) -> acausal.Result:
    steps: dict[str, Any] = {"step": 0.01} if solver in ("rk", "rk2", "collocation") else {}
    return acausal.simulate(Crossing(equation=equation), stop_time=2.0, solver=solver, **steps, **options)


def noted(result: acausal.Result) -> bool:
    return "solutions of the equations for" in str(result.stats["notes"])


@pytest.mark.parametrize(
    ("equation", "solver"),
    [
        *((e, s) for e in CROSSING for s in ("idas", "rosenbrock", "cvodes")),
        *((e, s) for e in ("product", "kink") for s in SOLVERS[3:]),
    ],
)
def test_a_run_through_a_crossing_says_so_or_ends_there(equation: str, solver: str) -> None:
    """By the equations both ways are right: `cvodes` and `erk` turned off, `idas` went straight on, all in silence."""
    try:
        told = noted(run(equation, solver))
    except IntegrationError as error:
        told = error.code == "AC402" and abs(error.result.time[-1] - 1.0) < 0.02
    assert told


@pytest.mark.parametrize("solver", ["idas", "rk2"])
@pytest.mark.parametrize("equation", HEALTHY)
def test_one_solution_is_not_noted(equation: str, solver: str) -> None:
    """Slopes that fall nearly to zero, or to zero where any y solves the equation for an instant, make no branches."""
    assert not noted(run(equation, solver))


@pytest.mark.parametrize("equation", ["smooth turn", "nearer"])
def test_stages_on_another_solution_than_their_steps_are_told(equation: str) -> None:
    """The integral of y is -0.5; stages of Radau's method stayed on y = x from x = 0 on: it was -0.24 and -0.06."""
    result = run(equation, "collocation")
    assert noted(result) or result.final("w") == pytest.approx(-0.5, abs=1e-3)


@pytest.mark.parametrize("solver", ["idas", "rk2"])
def test_few_rows_are_enough(solver: str) -> None:
    """Other instants are looked at that the result does not show."""
    result = run("product", solver, output_interval=0.6)
    assert noted(result)
    assert result.time == pytest.approx([0.0, 0.6, 1.2, 1.8, 2.0])


def test_steps_of_rk2_between_two_rows_solve_the_equations() -> None:
    """y |y| + y / 1000 == x is odd in x, so that y has no integral from -1 to 1; at 1 it is a root of a square."""
    result = run("turbulent", "rk2", output_interval=0.05)
    assert result.final("w") == pytest.approx(0.0, abs=1e-9)
    assert result.final("y") == pytest.approx((1e-6 / 4 + 1.0) ** 0.5 - 1e-3 / 2, abs=1e-9)


class Fast(Component):
    """Solutions that meet at x = 0, where x(s) passes zero within a thousandth of s = 0, the instant t = 0.517 s."""

    equation: str = structural(default="product")
    path: str = structural(default="pulse")
    s: Real = variable(default=fixed(-0.517))
    x: Real = variable(default=guess(-1.0))
    y: Real = variable(default=guess(-1.0))
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == 1.0
        yield der(self.w) == self.y
        s = self.s / 1e-3
        yield self.x == (s / sqrt(1.0 + s**2) if self.path == "step" else 1.5 / (1.0 + s**2) - 1.0)
        yield RESIDUALS[self.equation](self.x, self.y, self.y)[0] == 0.0


@pytest.mark.parametrize(
    ("equation", "path", "interval", "solver"),
    [
        ("product", "pulse", 0.05, "idas"),
        ("product", "pulse", 0.05, "rk"),
        ("product", "step", 0.05, "cvodes"),
        ("product", "step", 0.05, "idas"),
        ("squares", "pulse", 0.02, "idas"),
        ("squares", "pulse", 0.02, "rk"),
    ],
)
def test_what_happens_between_two_rows_is_looked_at(equation: str, path: str, interval: float, solver: str) -> None:
    """Rows tell nothing of either: before and behind the pulse y is -1, and where it turned off it stays 0."""
    steps: dict[str, Any] = {"step": 5e-4} if solver == "rk" else {}
    fast = Fast(equation=equation, path=path)
    result = acausal.simulate(fast, stop_time=1.0, solver=solver, output_interval=interval, **steps)
    assert noted(result) or "more happens than they show" in str(result.stats["notes"])


class Large(Component):
    """A ring of many unknowns, all of which are c y, on one of the solutions of y (x - v[0]) == 0."""

    x: Real = variable(default=fixed(-0.987))
    y: Real = variable(default=guess(-1.0))
    v: Real = variable(shape=120, default=guess(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        for k in range(120):
            near = sin(self.v[(k + 1) % 120]) + sin(self.v[k - 1])
            yield self.v[k] + 0.01 * self.v[k] ** 3 + 0.1 * near == self.y
        yield self.y * (self.x - self.v[0]) == 0.0


def test_blocks_of_any_size_are_watched() -> None:
    assert noted(acausal.simulate(Large(), stop_time=2.0, solver="idas"))


@pytest.mark.parametrize("equation", ["product", "two", "parallelogram", "three"])
def test_exported_steps_say_where_solutions_meet(equation: str) -> None:
    """Steps of `sdirk` went straight on without a flag, whatever they met."""
    made = acausal.step_function(acausal.compile(Crossing(equation=equation, x=fixed(-0.0337))), 0.01, "sdirk")
    said = walk(made, 7)["step.unconverged"]
    assert said[0] == 0.0
    assert max(said[2:5]) == 1.0


@pytest.mark.parametrize("method", ["rk4", "sdirk"])
def test_an_exported_step_that_begins_where_solutions_meet_says_so(method: str) -> None:
    """The slope of y (x - y) is zero there, so that Newton's method gives nan."""
    made = acausal.step_function(acausal.compile(Crossing(x=fixed(-0.0337))), 0.01, method)
    begins = [0.0 if name in ("x", "y", "z") else value for name, value in zip(made.x.names, made.x.start, strict=True)]
    assert float(made.function(begins, [], made.p.start)[1][made.y.position("step.unconverged")]) == 1.0


def test_exported_steps_say_at_which_events_solutions_meet() -> None:
    for equation, meets in (("event", True), ("kinked", False), ("blocks", False)):
        made = acausal.step_function(acausal.compile(Crossing(equation=equation)), 0.01, "rk4")
        assert any("solutions of algebraic equations meet where y > 0" in note for note in made.notes) is meets


@pytest.mark.parametrize("start", [-0.03, -0.0237])
def test_steps_that_turn_off_at_a_kink_say_so(start: float) -> None:
    """Of |y| == |x|, on the end of a step or within one; the determinant is -1 on both sides of it."""
    made = acausal.step_function(acausal.compile(Crossing(equation="kink", x=fixed(start))), 0.01, "rk4")
    said = walk(made, 4)["step.unconverged"]
    assert said[0] == said[3] == 0.0
    assert max(said) == 1.0


def test_exported_functions_hold_the_determinants() -> None:
    """Of y (x - y) the slope by y is x - 2 y: -x on y = x, x on y = 0."""
    model = acausal.compile(Crossing()).casadi()
    assert any("determinants" in note for note in model.notes)
    signs = [float(model.determinants([x, 0.0], [x], [], [])[0]) for x in (-1.0, -1e-3, 1e-3, 1.0)]
    assert signs[0] == signs[1] == -signs[2] == -signs[3] != 0.0
    sizes = [float(model.determinants([x, 0.0], [x], [], [])[1]) for x in (-1.0, -1e-3)]
    assert sizes[0] - sizes[1] == pytest.approx(log(1e3))


@pytest.mark.parametrize("equation", ["product", "squares", "event"])
def test_a_run_that_begins_where_solutions_meet_says_so(equation: str) -> None:
    """Which of them it took was decided by the guesses, as far as they were within a Newton step of it, in silence."""
    begun = Crossing(equation=equation, x=fixed(0.0), y=guess(-0.5), z=guess(-0.5))
    assert noted(acausal.simulate(begun, stop_time=1.0, solver="idas"))


def test_a_run_that_begins_where_the_only_solution_is_steep_is_not_noted() -> None:
    """y |y| + y / 1000 == x at x = 0."""
    begun = Crossing(equation="turbulent", x=fixed(0.0), y=guess(0.0), z=guess(0.0))
    assert not noted(acausal.simulate(begun, stop_time=1.0, solver="idas"))


def test_steps_that_singular_equations_leave_where_they_were_are_refused() -> None:
    """x' = 1, and x stayed -1: CasADi took the nan of a Newton step for a small one."""
    with pytest.raises(IntegrationError):
        run("double", "collocation")


class Pushed(Component):
    """x' = u from -1, and y (x - y) == 0 from y = -1."""

    u: Real = signal_input(default=1.0)
    x: Real = variable(default=fixed(-1.0))
    y: Real = variable(default=guess(-1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield self.y * (self.x - self.y) == 0.0


def test_an_optimum_hands_on_what_its_replay_says() -> None:
    problem = Problem(Pushed())
    problem.phase(duration=2.0, intervals=3)
    problem.subject_to("u", min=0.5, max=2.0)
    problem.subject_to(problem.end("x") == 1.0)
    problem.minimize(problem.integral("u"))
    assert noted(problem.solve())
