"""Alias elimination: what disappears, what is kept under which name, and that nothing is lost on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, signal_input, variable
from acausal.analyse.aliases import reduce
from acausal.errors import AcausalError
from acausal.flatten.flatten import flatten
from acausal.flatten.reduced import ReducedSystem


def reduced(model: Component) -> ReducedSystem:
    return reduce(flatten(model))


def names(system: ReducedSystem) -> set[str]:
    return {system.name(v) for v in range(system.pool.n_variables)}


class Signs(Component):
    """a = x, b = -x, c = -b, and d = b through a constant that is only known later."""

    x: Real = variable(default=fixed(2.0))
    a: Real = variable()
    b: Real = variable()
    c: Real = variable()
    d: Real = variable()
    one: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.a == self.x
        yield self.x + self.b == 0.0
        yield self.c == -self.b
        yield self.d == self.one * self.b
        yield self.one == 1.0


def test_aliases_with_signs_leave_one_variable() -> None:
    system = reduced(Signs())
    assert len(system.residuals) == 1
    result = acausal.simulate(Signs(), tolerance=1e-9)
    x = 2 * math.exp(-1.0)
    for name, sign in (("x", 1), ("a", 1), ("b", -1), ("c", 1), ("d", -1)):
        assert result.final(name) == pytest.approx(sign * x, rel=1e-8)
    np.testing.assert_array_equal(result["b"], -result["x"])
    assert result.final("one") == 1.0


class Parameters(Component):
    """Expressions of parameters are constants of the run."""

    p: Real = parameter(default=3.0)
    a: Real = variable()
    b: Real = variable()
    c: Real = variable()

    def equations(self) -> Equations:
        yield self.a == 2 * self.p + 1
        yield self.b == -self.a
        yield self.c == self.b * self.a


def test_what_depends_on_parameters_only_is_no_unknown() -> None:
    system = reduced(Parameters())
    assert system.residuals == ()
    compiled = acausal.compile(Parameters())
    for p in (3.0, -1.0):
        result = acausal.simulate(compiled, parameters={"p": p})
        assert result.final("c") == -((2 * p + 1) ** 2)


class Chain(Component):
    """s, v, a, j: each is the derivative of the one before by name."""

    s: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    a: Real = variable(default=fixed(2.0))
    j: Real = variable()

    def equations(self) -> Equations:
        yield self.v == der(self.s)
        yield der(self.v) == self.a
        yield self.j == der(self.a)
        yield self.j == 6.0


def test_chains_of_derivatives_are_linked_by_name() -> None:
    """s = 1 + t^2 + t^3."""
    system = reduced(Chain())
    assert names(system) == {"s", "v", "a", "der(a)"}  # j is 6 before it is anything else
    result = acausal.simulate(Chain(), stop_time=2.0, tolerance=1e-9)
    assert result.final("s") == pytest.approx(1 + 4 + 8, rel=1e-8)
    assert result.final("j") == 6.0


class Circle(Component):
    """x' = y, y' = x: one of the two stays an equation, else the circle would have no end."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.y
        yield der(self.y) == self.x


class Growth(Component):
    """v = x' and x' = x: that v is x shows only after v was taken for the derivative of x."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable()

    def equations(self) -> Equations:
        yield self.v == der(self.x)
        yield der(self.x) == self.x


class SecondGrowth(Component):
    """x'' = x through two names."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(1.0))
    w: Real = variable()

    def equations(self) -> Equations:
        yield self.v == der(self.x)
        yield self.w == der(self.v)
        yield der(self.v) == self.x


class Opposite(Component):
    """v = -x', v' = x: an oscillation written with a sign."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.v == -der(self.x)
        yield der(self.v) == self.x


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        pytest.param(Circle(), math.cosh(1.0), id="circle"),
        pytest.param(Growth(), math.e, id="own derivative"),
        pytest.param(SecondGrowth(), math.e, id="own second derivative"),
        pytest.param(Opposite(), math.cos(1.0), id="negative derivative"),
    ],
)
def test_circles_of_derivatives(model: Component, expected: float) -> None:
    assert acausal.simulate(model, stop_time=1.0, tolerance=1e-9).final("x") == pytest.approx(expected, rel=1e-7)


class TwoIntegrals(Component):
    """Two integrals of one speed, which is found to be one only after both were linked."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(2.0))
    w: Real = variable()

    def equations(self) -> Equations:
        yield self.v == der(self.x)
        yield self.w == der(self.y)
        yield der(self.x) == self.w
        yield der(self.v) == -self.x


def test_two_integrals_of_one_speed() -> None:
    """x = 2 sin t, y = 1 + 2 sin t."""
    result = acausal.simulate(TwoIntegrals(), stop_time=1.0, tolerance=1e-9)
    assert result.final("x") == pytest.approx(2 * math.sin(1.0), rel=1e-7)
    assert result.final("y") == pytest.approx(1 + 2 * math.sin(1.0), rel=1e-7)
    assert result.final("w") == pytest.approx(2 * math.cos(1.0), rel=1e-7)


class Zero(Component):
    """a = b and a = -b: both are zero."""

    a: Real = variable()
    b: Real = variable()
    rate: Real = variable()

    def equations(self) -> Equations:
        yield self.a == self.b
        yield self.b == -self.a
        yield self.rate == der(self.a)


def test_equal_to_its_own_negative() -> None:
    """And the derivative of what is zero is zero."""
    result = acausal.simulate(Zero())
    assert (result.final("a"), result.final("b"), result.final("rate")) == (0.0, 0.0, 0.0)


class Driven(Component):
    """Inputs are never replaced by anything, not even by each other."""

    u: Real = signal_input()
    w: Real = signal_input()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == self.u + 0 * self.w


def test_inputs_stay() -> None:
    system = reduced(Driven())
    assert [system.name(v) for v in system.inputs] == ["u", "w"]
    result = acausal.simulate(Driven(), inputs={"u": 4.0, "w": 7.0})
    assert (result.final("y"), result.final("w")) == (4.0, 7.0)


class Contradiction(Component):
    a: Real = variable()
    b: Real = variable()
    c: Real = variable()

    def equations(self) -> Equations:
        yield self.a == self.b
        yield self.b == 1.0
        yield self.a == 2.0


class Cancelling(Component):
    """(a - b) - a = 0 says b = 0; that a is in it is an appearance."""

    a: Real = variable()
    b: Real = variable()

    def equations(self) -> Equations:
        yield (self.a - self.b) - self.a == 0.0
        yield self.a == 3.0 + self.b


def test_contradictions_are_found() -> None:
    with pytest.raises(AcausalError, match=r"AC2\d\d"):
        reduced(Contradiction())


def test_terms_that_cancel_are_left_out() -> None:
    assert reduced(Cancelling()).residuals == ()
    assert acausal.simulate(Cancelling()).final("a") == 3.0
