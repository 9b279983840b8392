"""Equal components that call an external function: their equations are no columns."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, External, Real, der, fixed, parameter, part, variable


def _cubic() -> Any:
    u = ca.SX.sym("u")
    return ca.Function("cubic", [u], [u**3], {"never_inline": True})


CUBIC = External("cubic", _cubic, inputs=((),), outputs=((),))


class Decay(Component):
    x: Real = variable()
    k: Real = parameter(default=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * CUBIC(self.x) + 0 * (self.x * 1.5 + self.k) * self.x


class Row(Component):
    parts: list[Decay] = part()

    def build(self) -> None:
        self.parts = [Decay(x=fixed(1.0), k=0.5 + 0.01 * k) for k in range(260)]


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_each_follows_its_own_closed_form(solver: str) -> None:
    """x' = -k x**3 from 1: x = (1 + 2 k t)**(-1/2)."""
    result = acausal.simulate(Row(), stop_time=1.0, solver=solver, tolerance=1e-8, native=False)
    found = [result.final(f"parts[{k}].x") for k in range(260)]
    assert found == pytest.approx(1.0 / np.sqrt(1.0 + 2.0 * (0.5 + 0.01 * np.arange(260))), abs=1e-6)
