"""Events shorter than any step: a plate that is passed in a microsecond, and a guard that is only grazed."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fixed, reset, variable, when, where


class Plate(Component):
    """A body of 1 kg at 100 m/s meets a plate of 0.1 mm that resists with 1e7 N."""

    x: Real = variable(unit="m", default=fixed(0.0))
    v: Real = variable(unit="m/s", default=fixed(100.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where((self.x > 1.0) & (self.x < 1.0001), -1e7, 0.0)


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_a_thin_plate_is_not_tunnelled(solver: str, tolerance: float) -> None:
    """The plate takes 1000 J of 5000 J: v = sqrt(100^2 - 2 * 1e7 * 1e-4)."""
    r = acausal.simulate(Plate(), stop_time=0.1, tolerance=tolerance, solver=solver)
    assert r.final("v") == pytest.approx(math.sqrt(8000.0), rel=10 * tolerance)


class Graze(Component):
    """x = (t - 1/2)^2 dips below 1e-6 for 2 ms."""

    x: Real = variable(default=fixed(0.25))
    v: Real = variable(default=fixed(-1.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == 2.0
        yield der(self.y) == where(self.x < 1e-6, 1.0, 0.0)
        yield when(self.x < 1e-6, reset(self.n, self.n + 1))


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas"])
@pytest.mark.parametrize("outputs", [1, 100, 1000])
def test_a_double_crossing_within_a_step_is_found(solver: str, outputs: int) -> None:
    """Both crossings, and y = 2 ms between them; one output time is the instant between them exactly."""
    r = acausal.simulate(Graze(), stop_time=1.0, tolerance=1e-8, solver=solver, output_interval=1.0 / outputs)
    assert r.final("n") == 1.0
    assert r.final("y") == pytest.approx(2e-3, abs=1e-7)
    assert [e.time for e in r.events] == pytest.approx([0.499, 0.501], abs=1e-7)
