"""Rows and ticks stand at multiples of their interval as a user writes them. Expected values: decimal arithmetic."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, integer, pre, reset, sample, variable, when
from acausal.simulate.multiples import multiples


class Ticking(Component):
    """A clock of 0.3 s beside an integral of one."""

    x: Real = variable(default=fixed(0.0), unit="")
    ticks: Real = integer(default=0)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.3, 0.3), reset(self.ticks, pre(self.ticks) + 1))


@pytest.mark.parametrize(
    ("first", "interval"),
    [("0", "0.1"), ("0", "0.3"), ("0.7", "0.01"), ("-2.5", "1e-3"), ("1e6", "2e-4"), ("0", "1.7")],
)
def test_multiples_are_the_numbers_that_a_user_writes(first: str, interval: str) -> None:
    k = np.arange(5000)
    expected = [float(Decimal(first) + int(j) * Decimal(interval)) for j in k]
    assert multiples(float(first), float(interval), k).tolist() == expected


def test_an_interval_that_is_no_short_fraction() -> None:
    interval = float(np.sqrt(2.0))
    assert multiples(0.0, interval, np.arange(4)).tolist() == [0.0, interval, 2.0 * interval, 3.0 * interval]


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_row_at_a_tick_is_one_of_its_rows(solver: str) -> None:
    """Each tick has a row before and one after it: a row an ulp beside it would be a third."""
    r = acausal.simulate(Ticking(), stop_time=6.1, output_interval=0.3, solver=solver, tolerance=1e-6)
    ticks = [float(k * Decimal("0.3")) for k in range(1, 21)]
    assert r.time.tolist() == [0.0, *np.repeat(ticks, 2).tolist(), 6.1]
    assert r["ticks"].tolist() == [0, *np.repeat(np.arange(20), 2)[1:], 20, 20]
