"""A crossing exactly at the stop time fires, with every solver and tolerance; one just behind it does not."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    integer,
    pre,
    reset,
    sample,
    signal_input,
    variable,
    when,
    where,
)

SOLVERS = ("idas", "rosenbrock", "cvodes", "erk")


class Crossing(Component):
    """A straight line that arrives at pi, beside something that makes the steps."""

    x: Real = variable(default=fixed(0.0))
    s: Real = variable(default=fixed(0.0))
    c: Real = variable(default=fixed(1.0))
    y: Real = variable()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.s) == self.c
        yield der(self.c) == -self.s
        yield self.y == where(self.x > math.pi, 5.0, 1.0)
        yield when(self.x > math.pi, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-10])
def test_what_arrives_at_the_stop_time_fires(solver: str, tolerance: float) -> None:
    model = acausal.compile(Crossing())
    at, before = (
        acausal.simulate(model, stop_time=stop, solver=solver, tolerance=tolerance)
        for stop in (math.pi, math.pi - 0.01)
    )
    assert [at.final(name) for name in ("n", "y")] == [1.0, 5.0]
    assert [before.final(name) for name in ("n", "y")] == [0.0, 1.0]
    assert at.time[-1] == pytest.approx(math.pi, abs=1e-12)
    assert (len(at.events), len(before.events)) == (1, 0)


class Ball(Component):
    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield when(self.h < 0.0, reset(self.v, -0.8 * pre(self.v)), reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_second_bounce_is_the_last_thing_that_happens(solver: str) -> None:
    """At sqrt(2/g)*(1 + 2*e) the ball is back: it leaves with e^2 of the speed it came with first."""
    stop = math.sqrt(2.0 / 9.81) * 2.6
    result = acausal.simulate(Ball(), stop_time=stop, solver=solver, tolerance=1e-8)
    assert result.final("n") == 2.0
    assert result.final("v") == pytest.approx(0.64 * math.sqrt(2.0 * 9.81), rel=1e-7)


class Filled(Component):
    """A level that starts anew when it has come to 1, with a given inflow."""

    u: Real = signal_input()
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(self.x > 1.0, reset(self.x, 0.0), reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_step_that_ends_where_the_run_does(solver: str) -> None:
    """1.5 up to 1 s empties at 2/3 s and leaves 1/2; 1/4 fills the other half at 3 s, the last node of a search."""
    inflow = ([0.0, 1.0, 1.0, 3.0], [1.5, 1.5, 0.25, 0.25])
    result = acausal.simulate(Filled(), inputs={"u": inflow}, stop_time=3.0, solver=solver, tolerance=1e-10)
    assert (result.final("n"), result.final("x")) == (2.0, 0.0)


class Taken(Component):
    """x = t, taken every half second by a discrete equation, which is no `when`."""

    x: Real = variable(default=fixed(0.0))
    d: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.d == where(sample(0.5, 0.5), self.x, pre(self.d))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_discrete_equation_reads_the_sample_of_the_stop_time(solver: str) -> None:
    assert acausal.simulate(Taken(), stop_time=1.0, solver=solver).final("d") == pytest.approx(1.0, abs=1e-6)
