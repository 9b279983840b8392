"""Linear invariants: found where all terms cancel, used where that loses no digits."""

from __future__ import annotations

import math

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
    structural,
    variable,
    where,
)
from acausal.errors import EventError
from acausal.models.ivp import E5, Pollution, Robertson


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
