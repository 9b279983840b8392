"""A relation that is exceeded briefly is found beside one that is held: a sliding mode has no compiled loop.

Law: sin(w t) exceeds a level just below one once in each period.
"""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fixed, parameter, pre, reset, variable, when, where
from tests.marks import slow_but

_STOP = 40.0


class BesideSliding(Component):
    """An oscillator that pushes something which slides along s = 0 from 0.05 s on, as 0.3 is less than 1."""

    w: Real = parameter(default=1.0)
    level: Real = parameter(default=0.999)
    s: Real = variable(default=fixed(0.05))
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    count: Real = discrete(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == where(self.s > 0, -1.0, 1.0) + 0.3 * self.x
        yield der(self.x) == self.w * self.v
        yield der(self.v) == -self.w * self.x
        yield when(self.x > self.level, reset(self.count, pre(self.count) + 1))


@pytest.mark.parametrize(
    ("solver", "native"),
    slow_but([("erk", True), ("rosenbrock", True), ("erk", False), ("rosenbrock", False)], ("erk", True)),
)
def test_each_peak_is_counted(solver: str, native: bool) -> None:
    """In these runs `erk` stopped between two mesh points, and compiled ones ended with a ValueError."""
    compiled = acausal.compile(BesideSliding())
    for excess, w, tolerance in (
        (0.00026434299405187514, 4.562726023081869, 1e-6),
        (0.002786265905340496, 4.3855517496780925, 1e-6),
        (0.00020410654786961636, 2.600493906295917, 1e-7),
        (0.001652405832970416, 2.735292788146185, 1e-7),
        (0.000799860929903051, 1.6640204613018494, 1e-8),
    ):
        given = {"w": w, "level": 1.0 - excess}
        result = acausal.simulate(
            compiled, parameters=given, stop_time=_STOP, solver=solver, tolerance=tolerance, native=native
        )
        peaks = math.floor((w * _STOP - math.pi / 2) / (2 * math.pi)) + 1
        assert result.final("count") == peaks, given
        assert abs(float(result.final("s"))) < 1e-5, "it slides"
