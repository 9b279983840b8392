"""Relations that have no value for a while, because a root or logarithm in them does not exist."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, log, maximum, sqrt, variable, where


class Root(Component):
    """x = 1 + t. The root exists from t = 0.5 on, and is greater than -1 there at once: y = -0.5 + 1.5 at t = 2."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(sqrt(self.x - 1.5) > -1.0, 1.0, -1.0)


class Existing(Component):
    """The same relations within the domains of their functions."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        reached = where(self.x > 1.5, log(maximum(self.x - 1.5, 1e-9)), -20.0)
        yield der(self.y) == where((sqrt(maximum(self.x - 1.5, 0.0)) > 0.5) | (reached > 0.0), 1.0, -1.0)


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_a_relation_without_a_value_is_noted(solver: str, native: bool) -> None:
    """It was found up to a twentieth of a second before it had a value, and nothing said so."""
    result = acausal.simulate(Root(), stop_time=2.0, solver=solver, native=native)
    assert "sqrt(x - 1.5) > -1: no value" in str(result.stats["notes"])


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_a_relation_that_always_has_a_value_is_not(solver: str) -> None:
    """The root reaches 0.5 at t = 0.75: y = -0.75 + 1.25."""
    result = acausal.simulate(Existing(), stop_time=2.0, solver=solver)
    assert "no value" not in str(result.stats["notes"])
    assert result.final("y") == pytest.approx(0.5, abs=1e-5)


class Power(Component):
    """A relation with an integer power, which has a value everywhere; x = t - 1 reaches x**3 = 1/8 at t = 1.5."""

    x: Real = variable(default=fixed(-1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(self.x**3 > 0.125, 1.0, -1.0)


def test_integer_powers_have_a_value() -> None:
    result = acausal.simulate(Power(), stop_time=2.0)
    assert "no value" not in str(result.stats["notes"])
    assert result.final("y") == pytest.approx(-1.0, abs=1e-6)
