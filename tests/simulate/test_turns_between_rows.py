"""Arguments of steep functions that turn many times between two rows: results do not depend on where rows are."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

import acausal
from acausal import Component, Equations, Real, atan, der, exp, fixed, parameter, sin, structural, variable, where
from acausal.lower.compiled import CompiledModel

STOP = 10.0


class Swing(Component):
    """y' = exp(-v^2), v = (sin(n atan(3 n (x - b))) - level)/w, x = t: n swings, all but a few within 1/n of b."""

    is_hybrid: bool = structural(default=False)
    n: Real = parameter(default=50.0)
    b: Real = parameter(default=3.0)
    level: Real = parameter(default=0.7)
    w: Real = parameter(default=1e-3)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    late: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        v = (sin(self.n * atan(3.0 * self.n * (self.x - self.b))) - self.level) / self.w
        yield der(self.x) == 1.0
        yield der(self.y) == exp(-v * v)
        yield der(self.late) == (where(self.x > 4.346, 1.0, 0.0) if self.is_hybrid else 0.0)


@cache
def _compiled(is_hybrid: bool) -> CompiledModel:
    return acausal.compile(Swing(is_hybrid=is_hybrid))


def _area(n: float, b: float, level: float, w: float) -> float:
    """The integral over u = atan(3 n (x - b)), in which all swings are as long."""
    u = np.linspace(np.arctan(-3.0 * n * b), np.arctan(3.0 * n * (STOP - b)), 2_000_001)
    return float(simpson(np.exp(-(((np.sin(n * u) - level) / w) ** 2)) / (3.0 * n * np.cos(u) ** 2), x=u))


@pytest.mark.parametrize(
    ("solver", "interval", "is_hybrid", "values"),
    [
        ("erk", 0.1, False, (42.7, 3.16, 0.667, 1.33e-3)),
        ("idas", 10.0, False, (94.8, 8.31, 0.999, 3.5e-4)),
        pytest.param("cvodes", 10.0, True, (28.9, 4.776, 0.959, 0.0109), marks=pytest.mark.slow),
    ],
)
def test_swings_between_rows(
    solver: str, interval: float, is_hybrid: bool, values: tuple[float, float, float, float]
) -> None:
    """Rows whose neighbours tell each other showed nothing of the swings between two of them: 0.8 and 21 % off."""
    run: dict[str, Any] = {"stop_time": STOP, "tolerance": 1e-8, "native": False, "output_interval": interval}
    named = dict(zip(("n", "b", "level", "w"), values, strict=True))
    r = acausal.simulate(_compiled(is_hybrid), solver=solver, parameters=named, **run)
    assert r.final("y") == pytest.approx(_area(*values), rel=2e-6)
