"""A state that reaches a relation exactly at a tick: `>=` and `<` are other ones at the tick, not a round after it."""

from __future__ import annotations

from functools import cache
from itertools import product

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    der,
    edge,
    fixed,
    integer,
    pre,
    reset,
    sample,
    structural,
    variable,
    when,
)
from acausal.lower.compiled import CompiledModel


class AtOne(Component):
    """x = t, a trigger that is true at t = 1, and r: x has reached one; counted is where one or both become true."""

    is_rising: bool = structural(default=True)
    x: Real = variable(default=fixed(0.0))
    trigger: Real = boolean()
    one: Real = boolean()
    both: Real = boolean()
    ones: Real = integer()
    boths: Real = integer()
    reached: Real = integer()

    def equations(self) -> Equations:
        r = self.x >= 1.0 if self.is_rising else ~(self.x < 1.0)
        yield der(self.x) == 1.0
        yield self.trigger == sample(1.0, 1.0)
        yield self.one == ((self.trigger & ~r) | (~self.trigger & r))
        yield self.both == (self.trigger & r)
        yield when(edge(self.one), reset(self.ones, pre(self.ones) + 1))
        yield when(self.both, reset(self.boths, pre(self.boths) + 1))
        yield when(r, reset(self.reached, pre(self.reached) + 1))


@cache
def _compiled(is_rising: bool) -> CompiledModel:
    return acausal.compile(AtOne(is_rising=is_rising))


@pytest.mark.parametrize(
    ("solver", "native", "is_rising"),
    [
        *product(["idas", "cvodes", "rosenbrock"], [False], [True, False]),
        ("rosenbrock", True, True),
        ("erk", True, False),
    ],
)
def test_a_relation_that_is_reached_at_a_tick(solver: str, native: bool, is_rising: bool) -> None:
    """Both at the tick, where x is one; behind it the trigger is false, and one of them is true, once."""
    r = acausal.simulate(_compiled(is_rising), stop_time=1.5, solver=solver, native=native)
    assert (r.final("ones"), r.final("boths"), r.final("reached")) == (1, 1, 1)
