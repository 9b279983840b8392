"""Guards that are level up to a kink: events in closed form, and in compiled runs no help from Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, discrete, fixed, maximum, parameter, reset, time, variable, when
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.events.location.search import Search
from acausal.simulate.native import cache


class Level(Component):
    """A distance that stays at `floor` up to a kink, and falls from there on."""

    kink: Real = parameter(default=0.5)
    floor: Real = parameter(default=1e-3)
    c: Real = parameter(default=1.0)
    d: Real = parameter(default=0.0)
    u: Real = variable(default=fixed(0.0))
    at: Real = discrete(default=fixed(-1.0))

    def equations(self) -> Equations:
        since = maximum(self.u - self.kink, 0)
        yield der(self.u) == 1
        yield when(self.floor - self.c * since - self.d * since**2 < 0, reset(self.at, time))


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_a_guard_that_is_level_up_to_a_kink_is_passed_in_time(solver: str) -> None:
    """floor - c u - d u^2 with u the time since the kink is zero at u = 2 floor / (c + sqrt(c^2 + 4 d floor))."""
    random = np.random.default_rng(20260101)
    compiled = acausal.compile(Level())
    for _ in range(20):
        kink, floor = random.uniform(0.01, 0.95), 10.0 ** random.uniform(-12.0, -2.0)
        c, d = 10.0 ** random.uniform(-2.0, 4.0), random.choice([0.0, 10.0 ** random.uniform(-2.0, 4.0)])
        exact = kink + 2.0 * floor / (c + np.sqrt(c * c + 4.0 * d * floor))
        if exact > 0.99:
            continue
        given = {"kink": kink, "floor": floor, "c": c, "d": float(d)}
        r = acausal.simulate(compiled, parameters=given, stop_time=1.0, tolerance=1e-8, solver=solver, native=False)
        assert float(r.final("at")) == pytest.approx(exact, abs=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
def test_a_flight_passes_kinks_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """A force that grows by 2 kN/s moves 5 kg over a gap of 1 mm in (6 gap m / rate)^(1/3), whatever the rows are.

    The width of the cut is `maximum(width, 1e-9)`, where the width is zero before. Dense output said 20 times that
    this kink is passed where it is not, and 400 points did not find it: at some output intervals Python went there.
    """
    asked = []
    monkeypatch.setattr(Search, "to_event", lambda *given: asked.append(given))
    compiled = acausal.compile(ThickBlock())
    for interval in (0.08, 0.1, 0.013):
        given: dict[str, Any] = {"stop_time": 1.5, "tolerance": 1e-8, "output_interval": interval}
        r = acausal.simulate(compiled, solver="rosenbrock", native=True, **given)
        touch = next(e.time for e in r.events if e.condition == "drill.s > 0")
        assert touch == pytest.approx(1.0 + (6.0 * 1e-3 * 5.0 / 2000.0) ** (1.0 / 3.0), abs=1e-10)
    assert not asked
