"""Heat in a bar against closed forms: H. S. Carslaw, J. C. Jaeger, Conduction of Heat in Solids (1959)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.special import erfc

import acausal
from acausal import Component, Equations, connect, part
from acausal.library.fields import HeatBar
from acausal.library.thermal import FixedTemperature, ThermalConductor
from acausal.structure import match

# Diffusivity lambda / (rho c) of 1e-4 m2/s.
SPREAD = 1e-4


class Insulated(Component):
    n: int = acausal.structural(default=100)
    bar: HeatBar = part()

    def build(self) -> None:
        self.bar = HeatBar(n=self.n, lambda_=400.0, rho=8000.0, c=500.0)


class Heated(Insulated):
    """One end is put to 100 K more; the other one loses heat to the surroundings by a conductor."""

    hot: FixedTemperature = FixedTemperature(T=393.15)
    cold: FixedTemperature = FixedTemperature(T=293.15)
    loss: ThermalConductor = ThermalConductor(G=0.02)

    def equations(self) -> Equations:
        yield connect(self.hot.port, self.bar.port_a)
        yield connect(self.bar.port_b, self.loss.port_a)
        yield connect(self.loss.port_b, self.cold.port)


def middles(n: int) -> Any:
    return (np.arange(n) + 0.5) / n


def profile(result: acausal.Result, n: int, row: int) -> Any:
    return np.array([result[f"bar.T[{k}]"][row] for k in range(n)])


def test_a_bump_spreads_as_the_heat_kernel() -> None:
    """A Gaussian of deviation s stays one: s^2 grows by 2 a t, the height as 1/s; second order in the cells."""
    errors = []
    for n in (25, 50):
        start = 300.0 + 10.0 * np.exp(-((middles(n) - 0.5) ** 2) / (2.0 * 0.08**2))
        given = {"bar.T_start": start.tolist()}
        result = acausal.simulate(Insulated(n=n), parameters=given, stop_time=20.0, tolerance=1e-8)
        wide = np.sqrt(0.08**2 + 2.0 * SPREAD * 20.0)
        exact = 300.0 + 10.0 * 0.08 / wide * np.exp(-((middles(n) - 0.5) ** 2) / (2.0 * wide**2))
        found = profile(result, n, -1)
        errors.append(np.abs(found - exact).max())
        assert found.mean() == pytest.approx(start.mean(), rel=1e-9)  # no heat is lost
    assert errors[1] < 0.03
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def test_heat_from_one_end_goes_in_as_the_error_function() -> None:
    """Half space: T = T0 + dT erfc(x / (2 sqrt(a t)))."""
    result = acausal.simulate(Heated(), stop_time=100.0, tolerance=1e-7)
    exact = 293.15 + 100.0 * erfc(middles(100) / (2.0 * np.sqrt(SPREAD * 100.0)))
    assert np.abs(profile(result, 100, -1) - exact).max() < 0.04


def test_the_profile_ends_as_a_straight_line_to_the_conductor() -> None:
    """Steady: the bar conducts lambda A / L = 0.04 W/K in series with 0.02 W/K."""
    result = acausal.simulate(Heated(n=20), stop_time=2e5, tolerance=1e-8)
    flow = 100.0 / (1.0 / 0.04 + 1.0 / 0.02)
    assert result.final("bar.port_a.Q_flow") == pytest.approx(flow, rel=1e-6)
    np.testing.assert_allclose(profile(result, 20, -1), 393.15 - flow / 0.04 * middles(20), rtol=1e-6)


def test_starts_of_ten_thousand_cells_cost_a_few_matchings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Guesses that give way to initial equations are found by halves: one matching for each was quadratic."""
    made: list[int] = []

    def counted(incidence: Any) -> Any:
        made.append(1)
        return match(incidence)

    monkeypatch.setattr("acausal.analyse.start.match", counted)
    acausal.compile(Insulated(n=200))
    assert 0 < len(made) < 15
