"""A relation that an oscillation passes there and back is passed in each period, however little is above the threshold.

Law: sin(w t) exceeds a < 1 once in each period, for 2 acos(a) / w; the count does not depend on rows or tolerances, as
long as the error of the amplitude, which is measured, is well below 1 - a.
"""

from __future__ import annotations

import math
from typing import Any

import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fixed, parameter, pre, reset, variable, when
from tests.marks import slow_but

_FREQUENCY, _PERIODS = 50.0, 50
_STOP = _PERIODS / _FREQUENCY


class Oscillation(Component):
    threshold: Real = parameter(default=0.99)
    w: Real = parameter(default=2.0 * math.pi * _FREQUENCY)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    count: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.w * self.v
        yield der(self.v) == -self.w * self.x
        yield when(self.x > self.threshold, reset(self.count, pre(self.count) + 1))


@pytest.mark.parametrize("solver", slow_but(["rosenbrock", "erk"], "rosenbrock"))
@pytest.mark.parametrize(
    ("tolerance", "threshold", "rows"),
    [(1e-4, 0.99, 0.1), (1e-6, 0.999, _STOP), (1e-6, 0.9999, 0.1), (1e-8, 0.9999, _STOP)],
)
def test_each_peak_is_counted(solver: str, tolerance: float, threshold: float, rows: float) -> None:
    """Interpreted runs that looked at the ends of steps only, and at 64 points of the run, lost 1 to 39 of the 50."""
    given: dict[str, Any] = {"stop_time": _STOP, "output_interval": rows, "tolerance": tolerance, "native": False}
    r = acausal.simulate(Oscillation(), parameters={"threshold": threshold}, solver=solver, **given)
    assert abs(math.hypot(float(r.final("x")), float(r.final("v"))) - 1.0) < 0.3 * (1.0 - threshold)
    assert float(r.final("count")) == _PERIODS
