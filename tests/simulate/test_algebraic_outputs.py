"""Algebraic variables at outputs and guards are those of the equations, however large the steps between them are.

Expected values: with x = t, z + z^3 = t has z = 1 at t = 2 exactly; half a wave of a sine through an ideal diode
carries the charge 2/omega, and the diode switches at the zero crossings.
"""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, guess, integer, pre, reset, sin, time, variable, when, where
from acausal.models.ivp.charge_pump import ChargePump
from acausal.models.stability.drilling import DrillDynamic
from acausal.simulate.record.algebraic import corrected
from acausal.simulate.solvers.segment import Tolerances
from tests.marks import slow_but

_OMEGA = 100 * np.pi


class Cubic(Component):
    """A state that is a straight line, so that multistep methods take steps of a quarter of the run."""

    x: Real = variable(default=fixed(0.0))
    z: Real = variable(default=guess(0.5))
    above: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.z + self.z * self.z * self.z == self.x
        yield der(self.above) == where(self.z > 1.0, 1.0, 0.0)
        yield when(self.z > 1.0, reset(self.n, pre(self.n) + 1))


class HalfWave(Component):
    """A diode without any leak, in series with 1 Ohm."""

    t: Real = variable()
    s: Real = variable()
    charge: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.t == time
        yield sin(_OMEGA * self.t) == where(self.s > 0.0, self.s, 0.0) + where(self.s > 0.0, 0.0, self.s)
        yield der(self.charge) == where(self.s > 0.0, self.s, 0.0)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "cvodes"])
@pytest.mark.parametrize("points", [1, 100, 10_000])
def test_a_guard_on_an_algebraic_variable_is_located(solver: str, points: int) -> None:
    result = acausal.simulate(Cubic(), stop_time=4.0, output_interval=4.0 / points, tolerance=1e-8, solver=solver)
    assert [event.time for event in result.events] == pytest.approx([2.0], abs=1e-9)
    assert result.final("above") == pytest.approx(2.0, abs=1e-7)
    assert result.final("n") == 1.0
    z = np.asarray(result["z"])
    assert np.max(np.abs(z + z**3 - result.time)) < 1e-8


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
@pytest.mark.parametrize("points", [1, 600])
def test_an_ideal_diode_switches_at_the_zero_crossings(solver: str, points: int) -> None:
    result = acausal.simulate(HalfWave(), stop_time=0.06, output_interval=0.06 / points, tolerance=1e-8, solver=solver)
    # the last one ends the run on its guard
    assert [event.time for event in result.events] == pytest.approx([0.01, 0.02, 0.03, 0.04, 0.05, 0.06], abs=1e-9)
    assert result.final("charge") == pytest.approx(3 * 2 / _OMEGA, abs=1e-8)


def test_equal_runs_give_equal_results_to_the_last_digit() -> None:
    """A step that is too large by far makes the run chaotic: any difference in the last digit would grow to all."""
    runs = [
        acausal.simulate(
            DrillDynamic(), parameters={"k": 1e8}, stop_time=0.4, solver="rk2", step=1e-3, force=True, native=False
        )
        for _ in range(2)
    ]
    assert [event.time for event in runs[0].events] == [event.time for event in runs[1].events]
    assert np.array_equal(runs[0]["s"], runs[1]["s"])


@pytest.mark.slow
@pytest.mark.parametrize("solver", slow_but(["idas", "rosenbrock"], "idas"))
def test_algebraic_variables_of_the_charge_pump_do_not_depend_on_the_output_grid(solver: str) -> None:
    """Rows of the same instants, from grids of 100 and 1000 intervals; U3 reaches 35.9 V."""
    coarse, fine = (acausal.simulate(ChargePump(), output_interval=1.2e-6 / n, solver=solver) for n in (100, 1000))
    rows = np.searchsorted(fine.time, coarse.time + 1e-18, side="right") - 1
    last = np.searchsorted(coarse.time, coarse.time + 1e-18, side="right") - 1
    assert np.allclose(fine.time[rows], coarse.time, rtol=0, atol=1e-17)
    u3 = np.asarray(coarse["circuit.U3"])[last]
    assert np.max(np.abs(u3)) > 35.0
    assert np.max(np.abs(u3 - np.asarray(fine["circuit.U3"])[rows])) < 1e-6 * 36.0


@pytest.mark.parametrize("z", [1e40, 1e127, 1e200, -1e308, np.inf, np.nan])
def test_values_of_a_solver_that_diverged_are_refused(z: float) -> None:
    """`idas` leaves its last iterate in a row; where powers of it overflow, no residual is small relative to them."""
    compiled = acausal.compile(Cubic())
    x = np.array([[2.0]] + [[0.0]] * (len(compiled.states) - 1))
    p, m = np.zeros(len(compiled.parameters)), np.zeros(compiled.n_modes)
    with pytest.raises(RuntimeError, match="not solved"):
        corrected(compiled, np.array([2.0]), x, np.array([[z]]), np.zeros(0), p, m, Tolerances(1e-6, 1e-3))
