"""Law: a state whose rate has a pole has no value after it, whatever solver steps over it; others have.

The integral of 1/x over zero is infinite. Those of sin(x)/x, 1/sqrt(|x|) and what is limited on both sides are finite.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    atan,
    cos,
    der,
    fabs,
    fixed,
    guess,
    maximum,
    minimum,
    reset,
    sin,
    sqrt,
    structural,
    tan,
    variable,
    when,
    where,
)
from acausal.errors import IntegrationError
from tests.marks import slow_but

Rate = Callable[[Any, Any], Any]


class Passing(Component):
    """x passes zero after 1 s, z == 1/x, and y integrates a function of both."""

    rate: Rate = structural(default=lambda x, z: x)
    implicit: bool = structural(default=False)
    back: float = structural(default=0.0)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.z * self.x == 1.0 if self.implicit else self.z == self.x
        yield der(self.y) == self.rate(self.x, self.z)
        if self.back:
            yield when(self.x < self.back, reset(self.x, -self.back))


POLES: dict[str, Rate] = {
    "quotient": lambda x, z: minimum(1.0 / x, 5.0),
    "negative": lambda x, z: maximum(-1.0 / x, -5.0),
    "small": lambda x, z: minimum(1e-3 / x, 5.0),
    "power": lambda x, z: minimum(x**-1, 5.0),
    "with its size": lambda x, z: minimum(1.0 / x / fabs(x), 5.0),
    "factor": lambda x, z: minimum(1.0 / (x * (1.0 + x**2)), 5.0),
    "tangent": lambda x, z: minimum(tan(0.5 * math.pi * (1.0 - x)), 5.0),
    "behind a relation": lambda x, z: where(x < 0.0, 1.0 / x, 5.0),
}
FINITE: dict[str, tuple[Rate, float]] = {
    "removable": (lambda x, z: sin(x) / x, 2.0 * 0.946083070367183),  # Si(1), Abramowitz and Stegun, table 5.1
    "double": (lambda x, z: (1.0 - cos(x)) / x**2, 2.0 * (0.946083070367183 + math.cos(1.0) - 1.0)),  # by parts
    "root": (lambda x, z: 1.0 / sqrt(fabs(x)), 4.0),
    "jump": (lambda x, z: x / fabs(x), 0.0),
    "within": (lambda x, z: atan(1.0 / x), 0.0),
    "limited": (lambda x, z: minimum(maximum(1.0 / x, -5.0), 5.0), 0.0),
    "left out": (lambda x, z: where(fabs(x) > 0.1, 1.0 / x, 0.0), 0.0),
}


@pytest.mark.parametrize(
    ("name", "solver", "interval"),
    slow_but(
        [
            *((name, solver, 2.0) for name in POLES for solver in ("idas", "cvodes", "rosenbrock", "erk")),
            *((name, "idas", 4e-3) for name in POLES),
        ],
        *((name, "idas", 4e-3) for name in ("quotient", "behind a relation")),
        ("tangent", "erk", 2.0),
    ),
)
def test_no_run_goes_past_a_pole(name: str, solver: str, interval: float) -> None:
    """With `idas`, 1/x below 5 led to -27.5."""
    with pytest.raises(IntegrationError) as caught:
        acausal.simulate(
            Passing(rate=POLES[name]), stop_time=2.0, solver=solver, tolerance=1e-5, output_interval=interval
        )
    assert caught.value.result is not None
    assert caught.value.result.time[-1] <= 1.0 + 1e-6


@pytest.mark.parametrize("step", [1e-2, 1.1e-2, 7e-3])
def test_no_fixed_step_goes_past_a_pole(step: float) -> None:
    """A step that ended 4e-16 s behind it led to -4e12, of which a tolerance is large."""
    with pytest.raises(IntegrationError, match="AC404"):
        acausal.simulate(Passing(rate=POLES["quotient"]), stop_time=2.0, solver="rk", step=step)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_equations_without_a_solution_at_an_instant_have_poles(solver: str) -> None:
    """z x == 1 divides by x as well."""
    with pytest.raises(IntegrationError):
        acausal.simulate(
            Passing(rate=lambda x, z: minimum(z, 5.0), implicit=True), stop_time=2.0, solver=solver, tolerance=1e-6
        )


@pytest.mark.parametrize(
    ("name", "solver"),
    slow_but(
        [(name, s) for name in FINITE for s in ("idas", "cvodes", "rosenbrock", "erk")],
        *((name, "idas") for name in ("removable", "root", "jump")),
    ),
)
def test_what_has_a_finite_integral_is_integrated(name: str, solver: str) -> None:
    rate, expected = FINITE[name]
    r = acausal.simulate(Passing(rate=rate), stop_time=2.0, solver=solver, tolerance=1e-6)
    assert r.final("y") == pytest.approx(expected, abs=2e-5)


class OfSquare(Component):
    """The divisor is a variable that does not change its sign."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    square: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.square == self.x**2
        yield der(self.y) == minimum(where(self.x > 0.0, 1.0, -1.0) / self.square, 5.0)


def test_a_divisor_is_zero_where_what_it_is_the_square_of_is() -> None:
    with pytest.raises(IntegrationError):
        acausal.simulate(OfSquare(), stop_time=2.0, solver="rk", step=0.3)


def test_a_divisor_that_jumps_over_zero_has_no_pole() -> None:
    """x goes from 1 to 1/2, and from -1/2 to -3/2: ln 2 - ln 3."""
    r = acausal.simulate(Passing(rate=lambda x, z: 1.0 / x, back=0.5), stop_time=1.5, solver="idas", tolerance=1e-8)
    assert r.final("y") == pytest.approx(math.log(2.0) - math.log(3.0), abs=1e-6)


def test_the_message_names_the_divisor() -> None:
    with pytest.raises(
        IntegrationError, match=r"AC404(.|\n)*y has no finite value after t = 1 s(.|\n)*divisor x passes"
    ):
        acausal.simulate(Passing(rate=POLES["quotient"]), stop_time=2.0, solver="idas", tolerance=1e-6)
