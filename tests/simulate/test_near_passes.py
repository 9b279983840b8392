"""A relation that holds for less than a step of a compiled run is found: two points that pass each other closely.

Law: positions are sums of sines, so the distance at any time is a closed form. It falls below a threshold as often as
it does among 200 000 samples, if all of its minima differ from the threshold by much more than the run is wrong.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fabs, fixed, parameter, pre, reset, variable, when

_STOP, _TOLERANCE, _CLEAR = 5.0, 1e-6, 300.0


class _Rotating(Component):
    w1: Real = parameter(default=1.0)
    w2: Real = parameter(default=1.0)
    a: Real = parameter(default=1.0)
    threshold: Real = parameter(default=0.1)
    x1: Real = variable(default=fixed(1.0))
    y1: Real = variable(default=fixed(0.0))
    x2: Real = variable(default=fixed(0.0))
    y2: Real = variable(default=fixed(1.0))
    count: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        for w, x, y in ((self.w1, self.x1, self.y1), (self.w2, self.x2, self.y2)):
            yield der(x) == w * y
            yield der(y) == -w * x


class OnALine(_Rotating):
    """Two points on a line: their distance has a kink where they meet."""

    def equations(self) -> Equations:
        yield when(fabs(self.x1 - self.a * self.x2) < self.threshold, reset(self.count, pre(self.count) + 1))


class InAPlane(_Rotating):
    """One point on a circle, one on a line: the square of their distance is smooth."""

    def equations(self) -> Equations:
        square = (self.x1 - self.a * self.x2) ** 2 + (self.y1 - self.x2) ** 2
        yield when(square < self.threshold**2, reset(self.count, pre(self.count) + 1))


def _distance(is_on_a_line: bool, p: dict[str, float], t: Any) -> Any:
    x1, x2, y1 = np.cos(p["w1"] * t), np.sin(p["w2"] * t), -np.sin(p["w1"] * t)
    return np.abs(x1 - p["a"] * x2) if is_on_a_line else np.hypot(x1 - p["a"] * x2, y1 - x2)


@cache
def _cases(is_on_a_line: bool) -> list[tuple[dict[str, float], int]]:
    """Parameters, and how often the threshold is passed."""
    rng, t = np.random.default_rng(7), np.linspace(0.0, _STOP, 200_001)
    found: list[tuple[dict[str, float], int]] = []
    while len(found) < 8:
        w1, w2 = 10 ** rng.uniform(0.5, 1.7, 2)
        p = {"w1": w1, "w2": w2, "a": rng.uniform(0.3, 1.5)}
        p["threshold"] = 10 ** rng.uniform(-3, -1) if is_on_a_line else 0.02
        d = _distance(is_on_a_line, p, t)
        turns = np.flatnonzero((d[1:-1] - d[:-2]) * (d[2:] - d[1:-1]) <= 0.0) + 1
        above = d > p["threshold"]
        if above[0] and np.abs(d[turns] - p["threshold"]).min() > _CLEAR * _TOLERANCE:
            found.append((p, int((above[:-1] & ~above[1:]).sum())))
    return found


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
@pytest.mark.parametrize("kind", [OnALine, InAPlane])
def test_each_pass_is_counted(kind: type[_Rotating], solver: str) -> None:
    """Looking at signs at both ends of a step lost a third of 5302 passes on a line, and 16 of 144 in a plane."""
    model = acausal.compile(kind())
    for p, passes in _cases(kind is OnALine):
        for rows in (0.02, _STOP):
            given: dict[str, Any] = {"stop_time": _STOP, "output_interval": rows, "tolerance": _TOLERANCE}
            r = acausal.simulate(model, parameters=p, solver=solver, native=True, **given)
            assert float(r.final("count")) == passes, (p, rows)
