"""Models that call Python or a library are interpreted, with compiled code requested as well: there is no C of them."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import pytest

import acausal
from acausal import Component, Equations, External, Real, der, fixed, parameter, variable


class _Doubled(ca.Callback):
    """2 x, computed by Python."""

    def __init__(self) -> None:
        super().__init__()
        self.construct("doubled", {"enable_fd": True})

    def eval(self, arg: Any) -> Any:
        return [2.0 * arg[0]]


DOUBLED = _Doubled()
F = External("doubled", lambda: DOUBLED, inputs=[()], outputs=[()])


class Decaying(Component):
    """x' = -k f(x) from 1, with f(x) = 2 x."""

    k: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * F(self.x)


@pytest.mark.parametrize("solver", ["rosenbrock", "idas", "erk"])
def test_a_function_of_python_is_interpreted_and_a_note_says_why(solver: str) -> None:
    """A library with an undefined symbol would end the process when it is called."""
    run = acausal.simulate(Decaying(), stop_time=1.0, solver=solver, tolerance=1e-8, native=True)
    assert run.final("x") == pytest.approx(math.exp(-1.0), rel=1e-6)
    assert "calls Python or a library" in str(run.stats["notes"])


def test_its_derivatives_are_interpreted_too() -> None:
    """x = exp(-2 k t)."""
    found = acausal.sensitivities(Decaying(), ["k"], ["x"], stop_time=1.0, native=True)
    assert found.final[0, 0] == pytest.approx(-2.0 * math.exp(-1.0), rel=1e-6)
