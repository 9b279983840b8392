"""Runs that rest on a kink have no derivatives by what moves them off it, and those by anything else.

Law: the derivative is that of central differences where both one-sided differences agree; else it is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    der,
    discrete,
    fabs,
    fixed,
    floor,
    maximum,
    minimum,
    no_event,
    parameter,
    pre,
    reset,
    sign,
    sqrt,
    structural,
    variable,
    when,
    where,
)
from acausal.errors import ExportError

# Rates of one argument, and where it rests.
KINKS: dict[str, tuple[Callable[[Any], Expr], float]] = {
    "fabs": (lambda s: -fabs(s), 0.0),
    "maximum": (lambda s: -maximum(s, 0.0), 0.0),
    "minimum elsewhere": (lambda s: 1.0 - minimum(s, 1.0), 1.0),
    "relation": (lambda s: where(s > 0.0, -s, -2.0 * s), 0.0),
    "no event": (lambda s: where(no_event(s > 0.0), -s, -2.0 * s), 0.0),
    "sign": (lambda s: -s * sign(s), 0.0),
}


class Resting(Component):
    """x' = f(x + b) + c v through an algebraic variable, beside v' = -v + a; x rests where f has a kink."""

    f: Any = structural()
    a: Real = parameter(default=1.0)
    b: Real = parameter(default=0.0)
    c: Real = parameter(default=0.0)
    begin: Real = parameter(default=0.0)
    x: Real = variable()
    v: Real = variable(default=fixed(0.0))
    s: Real = variable()

    def initial_equations(self) -> Equations:
        yield self.x == self.begin

    def equations(self) -> Equations:
        yield self.s == self.x + self.b
        yield der(self.x) == self.f(self.s) + self.c * self.v
        yield der(self.v) == -self.v + self.a


@pytest.mark.parametrize("kink", KINKS)
@pytest.mark.parametrize(("moved", "method"), [("b", "forward"), ("c", "adjoint"), ("begin", "forward")])
def test_what_moves_a_run_off_its_kink_is_refused(moved: str, kink: str, method: Literal["forward", "adjoint"]) -> None:
    f, begin = KINKS[kink]
    model = Resting(f=f, begin=begin)
    with pytest.raises(ExportError, match=r"AC615[\s\S]*rests on a kink[\s\S]*by " + moved):
        acausal.sensitivities(model, [moved], ["x"], stop_time=1.0, method=method)


@pytest.mark.parametrize("kink", KINKS)
def test_what_moves_something_else_is_differentiated(kink: str) -> None:
    """v(1) = a (1 - exp(-1)), and x does not depend on a as long as c is zero."""
    f, begin = KINKS[kink]
    found = acausal.sensitivities(Resting(f=f, begin=begin), ["a"], ["x", "v"], stop_time=1.0)
    np.testing.assert_allclose(found.final, [[0.0], [1.0 - np.exp(-1.0)]], atol=1e-8)


@pytest.mark.parametrize("c", [1.0, -1.0])
def test_a_kink_that_is_only_left_or_passed_is_differentiated(c: float) -> None:
    """x' = -|x| + c v leaves its kink at once: x(1) by c, from differences of runs on the same side."""
    model = Resting(f=KINKS["fabs"][0], c=c)
    found = acausal.sensitivities(model, ["c"], ["x"], stop_time=1.0).final[0, 0]
    step = 1e-4
    runs = [
        acausal.simulate(model, parameters={"c": c + s * step}, stop_time=1.0, tolerance=1e-11)["x"][-1]
        for s in (-1.0, 1.0)
    ]
    assert found == pytest.approx((runs[1] - runs[0]) / (2.0 * step), rel=1e-5)


class Shown(Component):
    """An output with a kink at the end of the run: x(1) = b - 1 is zero there."""

    b: Real = parameter(default=1.0)
    x: Real = variable()
    y: Real = variable()

    def initial_equations(self) -> Equations:
        yield self.x == self.b

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.y == fabs(self.x)


def test_an_output_on_its_kink_is_refused() -> None:
    with pytest.raises(ExportError, match="AC615"):
        acausal.sensitivities(Shown(), ["b"], ["y"], stop_time=1.0)
    assert acausal.sensitivities(Shown(), ["b"], ["y"], stop_time=0.5).final[0, 0] == pytest.approx(1.0)


# Rates of y, in which x' = v passes zero, and v.
PASSED: dict[str, tuple[Callable[[Any], Expr], float]] = {
    "jump": (lambda m: where(m.x < 0.0, 5.0, 0.0), -1.0),
    "jump, closed": (lambda m: where(m.x >= 0.0, 5.0, 0.0), 1.0),
    "sign": (lambda m: sign(m.x), 0.5),
    "floor": (lambda m: floor(m.x), 0.5),
    "clause": (lambda m: m.n, -1.0),
}
NO_EVENT: dict[str, tuple[Callable[[Any], Expr], float]] = {
    "sign": (lambda m: no_event(sign(m.x)), -1.0),
    "floor": (lambda m: no_event(floor(m.x)), -1.0),
}


class Passing(Component):
    """x' = v from x(0) = b, and y' = f: what happens as x passes zero moves with b."""

    f: Any = structural()
    speed: float = structural(default=-1.0)
    counted: bool = structural(default=False)
    b: Real = parameter(default=0.0)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete(default=fixed(0.0))

    def initial_equations(self) -> Equations:
        yield self.x == self.b

    def equations(self) -> Equations:
        yield der(self.x) == self.speed
        yield der(self.y) == self.f(self)
        yield when(self.x < (0.0 if self.counted else -9.0), reset(self.n, pre(self.n) + 1.0))


@pytest.mark.parametrize("case", PASSED)
def test_a_run_that_begins_on_what_acts_is_refused(case: str) -> None:
    """From b = 0 on y has one difference for larger b and another one for smaller b."""
    f, speed = PASSED[case]
    with pytest.raises(ExportError, match=r"AC615[\s\S]*begins exactly on a relation"):
        acausal.sensitivities(Passing(f=f, speed=speed, counted=case == "clause"), ["b"], ["y"], stop_time=0.9)


def test_a_run_that_begins_on_a_kink_is_differentiated() -> None:
    """y = 5 integral of t - b: y(1) by b is -5."""
    model = Passing(f=lambda m: where(m.x < 0.0, -5.0 * m.x, 0.0))
    found = acausal.sensitivities(model, ["b"], ["y"], stop_time=1.0).final[0, 0]
    assert found == pytest.approx(-5.0, rel=1e-8)


@pytest.mark.parametrize("begin", [0.0, 0.4371, 0.5])
@pytest.mark.parametrize("case", NO_EVENT)
def test_a_jump_without_an_event_is_refused(case: str, begin: float) -> None:
    f, speed = NO_EVENT[case]
    with pytest.raises(ExportError, match="AC615"):
        acausal.sensitivities(Passing(f=f, speed=speed, b=begin), ["b"], ["y"], stop_time=0.9)


@pytest.mark.parametrize("counted", [False, True])
@pytest.mark.parametrize("begin", [0.4371, 0.5])
def test_a_jump_whose_relation_is_watched_is_differentiated(begin: float, counted: bool) -> None:
    """y(0.9) = 5 (0.9 - b), whether or not a clause locates x < 0, too."""
    model = Passing(f=lambda m: where(no_event(m.x < 0.0), 5.0, 0.0), b=begin, counted=counted)
    assert acausal.sensitivities(model, ["b"], ["y"], stop_time=0.9).final[0, 0] == pytest.approx(-5.0)


def test_no_event_around_what_is_continuous_is_differentiated() -> None:
    """y' = -v |x| as x falls from b through zero: y(T) = (b^2 + (T - b)^2)/2 for v = -1, by b 2 b - T."""
    model = Passing(f=lambda m: no_event(where(m.x < 0.0, -m.x, m.x)), b=0.4371)
    found = acausal.sensitivities(model, ["b"], ["y"], stop_time=0.9).final[0, 0]
    assert found == pytest.approx(2.0 * 0.4371 - 0.9, rel=1e-7)


class Rooted(Component):
    """x' = -1 from b on, and y' = k x^1.5 as long as x is positive: beyond, the root of x is no number."""

    b: Real = parameter(default=0.4)
    k: Real = parameter(default=1.0)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def initial_equations(self) -> Equations:
        yield self.x == self.b

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield der(self.y) == self.k * where(no_event(self.x > 0.0), self.x * sqrt(self.x), 0.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
def test_a_root_that_ends_at_a_kink_is_differentiated(solver: str) -> None:
    """y(1) = k 0.4 b^2.5."""
    found = acausal.sensitivities(Rooted(), ["k", "b"], ["y"], stop_time=1.0, solver=solver)
    np.testing.assert_allclose(found.final, [[0.4 * 0.4**2.5, 0.4**1.5]], rtol=1e-6)
