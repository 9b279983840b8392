"""Values of a result between its rows: as accurate as the run, however many and however close to a row."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, variable
from acausal.simulate.solvers.base import CasadiSolver


class Swing(Component):
    x: Real = variable()
    v: Real = variable()
    twice: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -9.0 * self.x
        yield self.twice == 2.0 * self.x


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_many_times_between_rows(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One integration from each row, for all times behind it and all signals; at some, rounding is all that is left."""
    model = Swing(x=fixed(1.0), v=fixed(0.0))
    result = acausal.simulate(model, stop_time=2.0, output_interval=0.1, solver=solver, tolerance=1e-8)
    calls = []
    solve = CasadiSolver.integrate

    def counted(self: CasadiSolver, *arguments: object) -> object:
        calls.append(1)
        return solve(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(CasadiSolver, "integrate", counted)
    near = [0.3 + 1e-15, 0.7 + 3e-15, 1.1 + 1e-14, 1.9 - 1e-15]
    times = np.sort(np.concatenate([np.linspace(0.003, 1.99, 200), near]))
    assert result.at(times, "x") == pytest.approx(np.cos(3.0 * times), abs=2e-7)
    assert result.at(times, "twice") == pytest.approx(2.0 * np.cos(3.0 * times), abs=4e-7)
    assert len(calls) <= 2 * 21
