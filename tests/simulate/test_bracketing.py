"""The first crossing of guards with kinks, found with few points of the solution; instants are closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.driver import hybrid
from acausal.simulate.events.location.bracketing import Node, first_crossing
from acausal.simulate.events.location.stopping import integrate_to_event
from acausal.simulate.native import cache


def _crossed(guard: np.poly1d, kink: float, floor: float) -> tuple[float, int]:
    """Where `floor` up to a kink, `floor + guard(t - kink)` behind it, falls below zero; how many points that took."""
    points = 0

    def at(t: float) -> Node:
        value, rate = (guard(t - kink), guard.deriv()(t - kink)) if t > kink else (0.0, 0.0)
        return Node(t, np.zeros(0), np.array([floor + value]), np.array([rate]), np.array([1e-3 * floor]))

    def integrate(_: Node, t: float) -> Node:
        nonlocal points
        points += 1
        return at(t)

    found = first_crossing(at(0.0), at(1.0), 1e-14, integrate)
    assert found is not None
    return found.t, points


def test_a_guard_that_is_level_up_to_a_kink_takes_few_points() -> None:
    """floor - c u - d u^2 with u the time since the kink is zero at u = 2 floor / (c + sqrt(c^2 + 4 d floor)).

    By cubics alone each point is a thousandth of the interval nearer: 400 of them were not enough.
    """
    random = np.random.default_rng(20260101)
    for _ in range(100):
        kink, floor = random.uniform(0.01, 0.95), 10.0 ** random.uniform(-12.0, -2.0)
        c, d = 10.0 ** random.uniform(-2.0, 4.0), random.choice([0.0, 10.0 ** random.uniform(-2.0, 4.0)])
        exact = kink + 2.0 * floor / (c + np.sqrt(c * c + 4.0 * d * floor))
        if exact > 0.99:
            continue
        t, points = _crossed(np.poly1d([-d, -c, 0.0]), kink, floor)
        assert t == pytest.approx(exact, abs=1e-12 + 1e-2 * floor / c)
        assert points <= 60


@pytest.mark.slow
@pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")
def test_a_flight_passes_kinks_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """A force that grows by 2 kN/s moves 5 kg over a gap of 1 mm in (6 gap m / rate)^(1/3), whatever the rows are.

    The width of the cut is `maximum(width, 1e-9)`, where the width is zero before. Dense output said 20 times that
    this kink is passed where it is not, and 400 points did not find it: at some output intervals Python went there.
    """
    asked = []

    def counted(*given: Any) -> Any:
        asked.append(given)
        return integrate_to_event(*given)

    monkeypatch.setattr(hybrid, "integrate_to_event", counted)
    compiled = acausal.compile(ThickBlock())
    for interval in (0.08, 0.1, 0.013):
        given: dict[str, Any] = {"stop_time": 1.5, "tolerance": 1e-8, "output_interval": interval}
        r = acausal.simulate(compiled, solver="rosenbrock", native=True, **given)
        touch = next(e.time for e in r.events if e.condition == "drill.s > 0")
        assert touch == pytest.approx(1.0 + (6.0 * 1e-3 * 5.0 / 2000.0) ** (1.0 / 3.0), abs=1e-10)
    assert not asked
