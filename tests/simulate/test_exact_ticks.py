"""A state that reaches a relation exactly at a tick: `>=` and `<` are other ones at the tick, not a round after it."""

from __future__ import annotations

import math
from functools import cache
from itertools import product

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    delay,
    der,
    edge,
    fixed,
    integer,
    parameter,
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


class SampledSaw(Component):
    """A sawtooth of `rate` teeth a second, the sum over time of its samples, and, with `lag`, a delay beside it."""

    lag: bool = structural(default=False)
    rate: Real = parameter(default=1.0)
    interval: Real = parameter(default=0.25, unit="s")
    x: Real = variable(default=fixed(0.0))
    held: Real = variable(default=fixed(0.0))
    total: Real = variable(default=fixed(0.0))
    beside: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.rate
        yield der(self.held) == 0.0
        yield der(self.total) == self.held
        yield der(self.beside) == (delay(self.x, 0.1) if self.lag else self.x)
        yield when(self.x > 1.0, reset(self.x, 0.0))
        yield when(sample(0.0, self.interval), reset(self.held, self.x))


@cache
def _sawtooth(lag: bool) -> CompiledModel:
    return acausal.compile(SampledSaw(lag=lag))


def _sampled_heights(rate: float, interval: float, stop: float) -> float:
    """The integral of the samples: a tooth that ends at a tick has the height 1 there."""
    teeth = [rate * interval * k for k in range(1, math.ceil(stop / interval - 1e-9))]
    heights = [0.0, *(t + 1.0 - math.ceil(t - 1e-9) for t in teeth)]
    return interval * sum(heights[:-1]) + (stop - interval * len(teeth)) * heights[-1]


@pytest.mark.parametrize(("lag", "solver"), list(product([False, True], ["idas", "cvodes", "rosenbrock", "erk"])))
def test_rounding_does_not_decide_what_is_sampled_where_a_tooth_ends(lag: bool, solver: str) -> None:
    """`x > 1` holds after the tick, although it may be located before it."""
    for rate, interval in ((3.0, 1.0 / 3.0), (4.0, 0.1), (0.5, 0.25)):
        values = {"rate": rate, "interval": interval}
        r = acausal.simulate(_sawtooth(lag), stop_time=2.1, parameters=values, solver=solver, native=False)
        assert r.final("total") == pytest.approx(_sampled_heights(rate, interval, 2.1), abs=1e-5), (rate, interval)


def test_nor_does_it_in_steps() -> None:
    step = acausal.step_function(_sawtooth(False), 0.05, "rk4", [])
    for rate, interval in ((1.0, 0.25), (1.0, 0.1)):
        x, p = np.array(step.x.start), np.array(step.p.start)
        p[[step.p.position("rate"), step.p.position("interval")]] = rate, interval
        for _ in range(42):
            x = np.array(step.function(x, [], p)[0]).ravel()
        assert x[step.x.position("total")] == pytest.approx(_sampled_heights(rate, interval, 2.1), abs=1e-9)
