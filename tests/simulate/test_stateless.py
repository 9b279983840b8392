"""Models without states: algebraic variables and discrete ones that follow time."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, discrete, fixed, pre, reset, sin, time, variable, when

STEPS = {"rk2": 1e-2, "rk": 1e-2, "collocation": 1e-2}


class Driven(Component):
    """A cubic spring under a force that changes sign, and the number of times at which its stretch has passed 1."""

    y: Real = variable()
    n: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.y + self.y**3 == 4.0 * sin(time)
        yield when(self.y > 1.0, reset(self.n, pre(self.n) + 1))


class Counted(Component):
    """Nothing but a number."""

    n: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield when(sin(time) > 0.5, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "cvodes", "erk", "rk2", "rk", "collocation"])
def test_an_algebraic_loop_and_a_single_discrete_variable(solver: str) -> None:
    """y = 1 where 4 sin(t) = 2: at pi/6, and 2 pi later; at t = 5 pi/2 the force is 4, and y + y^3 = 4."""
    given = {"solver": solver, "step": STEPS.get(solver), "native": False}
    r = acausal.simulate(Driven(), stop_time=2.5 * math.pi, **given)  # type: ignore[arg-type]
    assert [e.time for e in r.events if "n" in e.changed] == pytest.approx([math.pi / 6, math.pi / 6 + 2 * math.pi])
    assert r.final("n") == 2.0
    y = r.final("y")
    assert y + y**3 == pytest.approx(4.0, rel=1e-9)


@pytest.mark.parametrize("solver", ["rk2", "rk"])
def test_a_discrete_variable_alone(solver: str) -> None:
    """sin(t) exceeds 0.5 twice before 2.5 pi."""
    r = acausal.simulate(Counted(), stop_time=2.5 * math.pi, solver=solver, step=1e-2)
    assert r.final("n") == 2.0
