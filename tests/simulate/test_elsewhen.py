"""`when(...).elsewhen(...)`: priority among branches that become true together (Modelica 3.6, section 8.3.5.2)."""

from __future__ import annotations

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    der,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    terminate,
    time,
    variable,
    when,
)
from acausal.errors import DeclarationError, EventError
from tests.expected import fails_with

SOLVERS = ["idas", "cvodes", "rosenbrock", "erk"]


class Digits(Component):
    """Every branch adds another digit, so that the sum tells which ones have acted, and how often."""

    y0: Real = parameter(default=0.0, doc="Start of y")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()
    n: Real = integer()

    def initial_equations(self) -> Equations:
        yield self.y == self.y0

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == 1.0
        yield (
            when(self.x > 1.0, reset(self.n, pre(self.n) + 1))
            .elsewhen(self.y > 1.0, reset(self.n, pre(self.n) + 10))
            .elsewhen(self.x > 2.0, reset(self.n, pre(self.n) + 100))
            .elsewhen(time > 1.5, reset(self.n, pre(self.n) + 1000))
            .elsewhen(sample(0.25, 0.5), reset(self.n, pre(self.n) + 10000))
        )


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_first_of_two_branches_that_become_true_together_acts(solver: str) -> None:
    """x and y pass 1 together: only the first branch acts; six samples before t = 3."""
    r = acausal.simulate(Digits(), stop_time=2.9, solver=solver)
    assert r.final("n") == 61101


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_branch_acts_alone_while_an_earlier_condition_holds_already(solver: str) -> None:
    """y passes 1 at t = 1.2, when x > 1 is true and no longer new."""
    r = acausal.simulate(Digits(y0=-0.2), stop_time=2.9, solver=solver)
    assert r.final("n") == 61111


class Ending(Component):
    """A branch that ends the run, and one before it that takes its instant away."""

    both: Real = parameter(default=2.0, unit="s", doc="When the first branch acts")
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(time >= self.both, reset(self.n, 1)).elsewhen(time >= 1.0, terminate("one second"))


@pytest.mark.parametrize(("both", "end", "n"), [(2.0, 1.0, 0), (1.0, 3.0, 1)])
def test_a_branch_may_end_the_run(both: float, end: float, n: int) -> None:
    r = acausal.simulate(Ending(both=both), stop_time=3.0, solver="idas")
    assert r.time[-1] == end
    assert r.final("n") == n


def test_the_log_names_the_branch() -> None:
    r = acausal.simulate(Digits(), stop_time=0.5)
    assert "elsewhen(sample(0.25, 0.5), reset(n, pre(n) + 10000))" in r.events[0].condition


class Samples(Component):
    """A clock that is one of several conditions."""

    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when((sample(0.0, 0.25), self.x > 10.0), reset(self.n, pre(self.n) + 1))


def test_every_tick_of_a_clock_among_other_conditions_counts() -> None:
    """t = 0, 0.25, 0.5, 0.75, 1: a tick is over before the next one."""
    assert acausal.simulate(Samples(), stop_time=1.1).final("n") == 5


class Disagreeing(Component):
    """Two whens, no order between them."""

    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 1.0, reset(self.n, 1))
        yield when(self.x > 1.0, reset(self.n, 2))


def test_two_whens_that_disagree_at_one_instant_are_refused() -> None:
    with fails_with(EventError, "AC504") as caught:
        acausal.simulate(Disagreeing(), stop_time=2.0)
    assert "n is set to different values at t = 1 s" in str(caught.value)
    assert "elsewhen" in str(caught.value)
    assert len(caught.value.where) == 2


def test_an_action_that_is_none_is_refused_in_branches_too() -> None:
    x = Samples().x
    with pytest.raises(DeclarationError, match="AC140") as caught:
        when(x > 1.0).elsewhen(x > 2.0, 3.0)  # type: ignore[arg-type]
    assert "elsewhen(condition, reset(x, value))" in str(caught.value)


class OneVariable(Component):
    """A branch may not set what has an equation of its own."""

    x: Real = variable(default=fixed(0.0))
    b: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.b == (self.x > 3.0)
        yield when(self.x > 1.0, terminate("no")).elsewhen(self.x > 2.0, reset(self.b, True))


def test_a_branch_and_an_equation_determine_a_variable_twice() -> None:
    with pytest.raises(DeclarationError, match="AC145"):
        acausal.compile(OneVariable())
