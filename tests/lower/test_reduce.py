"""Alias elimination and linear invariants: what disappears, and that nothing is lost on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    boolean,
    der,
    exp,
    fixed,
    parameter,
    pre,
    signal_input,
    structural,
    variable,
    where,
)
from acausal.analyse.aliases import reduce
from acausal.errors import AcausalError, EventError
from acausal.flatten.flatten import flatten
from acausal.flatten.reduced import ReducedSystem
from acausal.models.ivp import E5, Pollution, Robertson


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


class Split(Component):
    """What two sources give, exp(-k*t) and t, arrives in two stores and is counted as a whole."""

    declared: bool = structural(default=True, doc="The second store starts at a declared 0, not by an equation")
    k: Real = parameter(default=1.0)
    whole: Real = variable(default=fixed(0.0))
    first: Real = variable(default=fixed(0.0))
    second: Real = variable()

    def equations(self) -> Equations:
        yield der(self.first) == exp(-self.k * acausal.time)
        yield der(self.second) == self.k * acausal.time
        yield der(self.whole) == exp(-self.k * acausal.time) + self.k * acausal.time

    def initial_equations(self) -> Equations:
        if not self.declared:
            yield self.second == 0.0


def test_an_invariant_that_starts_at_zero_saves_a_state() -> None:
    """E5: y2 = y3 + y4 (source: the problem's own statement y2 - y3 - y4 = 0)."""
    c = acausal.compile(E5())
    assert c.states == ("y1", "y3", "y4")
    r = acausal.simulate(c, stop_time=1e-3, solver="idas")
    assert r.final("y2") == pytest.approx(float(r.final("y3")) + float(r.final("y4")), rel=1e-15)


def test_the_saved_variable_has_its_exact_value() -> None:
    """Closed form: the integral of exp(-t) + t."""
    c = acausal.compile(Split(second=fixed(0.0)))
    assert len(c.states) == 2
    r = acausal.simulate(c, stop_time=1.0, tolerance=1e-10)
    assert r.final("whole") == pytest.approx(1 - math.exp(-1.0) + 0.5, rel=1e-8)
    assert r.final("whole") == pytest.approx(float(r.final("first")) + float(r.final("second")), rel=1e-15)


def test_an_unknown_constant_is_not_guessed() -> None:
    """A start that an initial equation gives is no declared zero, even if it comes out as one."""
    assert len(acausal.compile(Split(declared=False)).states) == 3


@pytest.mark.parametrize(("model", "states"), [(Robertson, 3), (Pollution, 20)])
def test_totals_that_hide_small_species_are_left_alone(model: type[Component], states: int) -> None:
    """y1 + y2 + y3 = 1 would make y2 = 1e-13 a difference of numbers near 1."""
    assert len(acausal.compile(model()).states) == states


class Drained(Component):
    """One store drains into another; what is counted changes with its level, which must stay below a limit."""

    limit: Real = parameter(default=10.0)
    first: Real = variable(default=fixed(0.0))
    second: Real = variable(default=fixed(0.0))
    above: Real = boolean()
    counted: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.first) == -2.0 * exp(-acausal.time)
        yield der(self.second) == 2.0 * exp(-acausal.time)
        yield self.above == ((self.second > 1.0) | pre(self.above) & (self.second > 0.5))
        yield der(self.counted) == where(self.above, 3.0, 0.0)
        yield assert_(self.second < self.limit, "it overflows")


def test_discrete_equations_and_assertions_keep_their_meaning() -> None:
    """The level 2 (1 - exp(-t)) passes 1 at log(2), 1.5 at log(4); conditions were those of other expressions."""
    c = acausal.compile(Drained())
    assert len([s for s in c.states if s in ("first", "second")]) == 1
    for solver in ("rosenbrock", "idas"):
        r = acausal.simulate(c, stop_time=2.0, solver=solver)
        assert r.final("above") == 1.0
        assert r.final("counted") == pytest.approx(3.0 * (2.0 - math.log(2.0)), rel=1e-6)
    with pytest.raises(EventError, match="it overflows") as stopped:
        acausal.simulate(c, stop_time=2.0, parameters={"limit": 1.5})
    assert stopped.value.result is not None
    assert stopped.value.result.time[-1] == pytest.approx(math.log(4.0), abs=1e-6)
