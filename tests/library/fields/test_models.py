"""The shipped models of fields."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal.models.fields import CableReflection, FisherFront, HeatedBar


def test_a_bar_between_water_and_air_ends_in_proportion() -> None:
    """In series lambda A / L = 1/60 W/K and 2e-3 W/K: the far end comes to T_air + 80 K * (1/60) / (1/60 + 2e-3)."""
    result = acausal.simulate(HeatedBar(n=20), stop_time=2e5)
    assert result.final("bar.port_b.T") == pytest.approx(293.15 + 80.0 / (1.0 + 0.12), abs=1e-3)


def test_the_front_runs_a_little_slower_than_fisher_says() -> None:
    """2 sqrt(k D) = 20 mm/s, less 3/2 sqrt(D/k) / t (Bramson 1983), around 22 s, measured over a quarter of a metre."""
    result = acausal.simulate(FisherFront(), tolerance=1e-5)
    times = [result.time[np.argmax(result[f"channel.c[{k}]"] > 0.5)] for k in (50, 100)]
    assert 0.25 / (times[1] - times[0]) == pytest.approx(20e-3 - 15e-3 / 22.0, rel=0.02)


def test_the_cable_shows_a_half_and_then_what_the_load_asks_for() -> None:
    """Z = 50 Ohm: 1/2, then R / (R + 50); the losses are 0.5 Ohm of 10 m, taken out of the end value."""
    result = acausal.simulate(CableReflection())
    assert result.at(60e-9, "line.p1.v") == pytest.approx(0.5, abs=4e-3)
    assert result.at(50e-9, "line.p2.v") == pytest.approx(0.0, abs=1e-6)
    assert result.final("line.p2.v") == pytest.approx(150.0 / 200.5, abs=3e-3)
