"""Tables that jump, as the slope of a long table of straight segments does: located, however constant all rates are.

With x = exp(-t) the segment [a, b] takes ln(b/a), and the integral of (x')^2 over it is (b^2 - a^2)/2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Expr, Real, der, exp, fixed, lookup, time, unitless, variable
from acausal.errors import DeclarationError
from acausal.library.blocks import table
from tests.expected import fails_with
from tests.stepping import walk

RNG = np.random.default_rng(11)
N, END = 30, 2.0
PLACES = np.concatenate([[np.exp(-END)], np.sort(RNG.uniform(np.exp(-END), 1.0, N - 2)), [1.0]])
# mostly zero: a method that grows its steps where nothing happens passes the rest
VALUES = np.where(RNG.random(N) < 0.1, RNG.normal(size=N), 0.0)


def decaying(law: Callable[[Expr], Expr]) -> Component:
    """`w` integrates a law of the state x = exp(-t)."""

    class Decaying(Component):
        x: Real = variable(default=fixed(1.0))
        w: Real = variable(default=fixed(0.0))
        y: Real = variable()

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            yield self.y == law(self.x)
            yield der(self.w) == self.rate()

        def rate(self) -> Expr:
            return self.y

    return Decaying()


def squared_slope(points: Sequence[tuple[float, float]]) -> Component:
    """`w` integrates the square of the rate of a table of x."""

    class Squared(type(decaying(lambda x: table(points, x)))):  # type: ignore[misc]
        def rate(self) -> Expr:
            return der(self.y) ** 2

    return Squared()


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_the_slope_of_a_long_table(solver: str) -> None:
    slopes = np.diff(VALUES) / np.diff(PLACES)
    exact = float(slopes**2 @ np.diff(PLACES**2)) / 2
    model = squared_slope(list(zip(PLACES.tolist(), VALUES.tolist(), strict=True)))
    result = acausal.simulate(model, solver=solver, stop_time=END, tolerance=1e-9)
    assert result.final("w") == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_the_slope_of_a_long_table_of_a_curve_in_time(solver: str) -> None:
    """The argument is exp(-t) without any state: no stop is known before the run."""
    points = list(zip(PLACES.tolist(), VALUES.tolist(), strict=True))

    class Timed(Component):
        w: Real = variable(default=fixed(0.0))
        y: Real = variable()

        def equations(self) -> Equations:
            yield self.y == table(points, exp(-unitless(time)))
            yield der(self.w) == der(self.y) ** 2

    exact = float((np.diff(VALUES) / np.diff(PLACES)) ** 2 @ np.diff(PLACES**2)) / 2
    result = acausal.simulate(Timed(), solver=solver, stop_time=END, tolerance=1e-9)
    assert result.final("w") == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("degree", [0, 1])
def test_a_lookup_that_jumps(solver: str, degree: int) -> None:
    rows = [(v, *[v] * degree) for v in VALUES[:-1].tolist()]
    # the integral of v (1 + x - a) dt over [a, b], dt = -dx / x
    lengths = np.diff(np.log(PLACES))
    linear = np.diff(PLACES) - PLACES[:-1] * lengths if degree else 0.0
    exact = float(VALUES[:-1] @ (lengths + linear))
    model = decaying(lookup(PLACES.tolist(), rows))
    result = acausal.simulate(model, solver=solver, stop_time=END, tolerance=1e-9)
    assert result.final("w") == pytest.approx(exact, abs=1e-7)


def test_exported_steps_locate_it() -> None:
    """1 until x = 1/2 at ln 2, which is no multiple of the step, and 3 from there on."""
    compiled = acausal.compile(decaying(lookup([0.0, 0.5, 1.0], [(3.0,), (1.0,)])))
    step = acausal.step_function(compiled, 0.01)
    assert walk(step, 100)["w"][-1] == pytest.approx(np.log(2.0) + 3.0 * (1.0 - np.log(2.0)), abs=1e-8)


@pytest.mark.parametrize(
    ("breaks", "rows", "text"),
    [
        ([0.0, 2.0, 1.0], [(1.0,), (2.0,)], "breakpoint 3 of 3, 1.0, is not greater than the one before"),
        ([0.0, 1.0, 2.0], [(1.0, 1.0)], "3 breakpoints have 2 segments, but there are 1 rows"),
        ([0.0, 1.0, 2.0], [(1.0,), (2.0, 1.0)], "different lengths"),
        ([0.0, 1.0, float("nan")], [(1.0,), (2.0,)], "not finite"),
        ([0.0], [], "1 breakpoints have 0 segments"),
        ([0.0, 1.0], [("a",)], "are numbers"),
    ],
)
def test_what_is_no_piecewise_polynomial(breaks: list[float], rows: list[tuple[float, ...]], text: str) -> None:
    with fails_with(DeclarationError, "AC160", match=text):
        lookup(breaks, rows)


def test_a_signal_is_no_list_of_breakpoints() -> None:
    with pytest.raises(DeclarationError, match="`x` is given as breakpoints"):
        acausal.compile(decaying(lambda x: lookup(x, [(0.0, 1.0)])))  # type: ignore[arg-type, return-value]
