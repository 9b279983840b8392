"""A solver, a source of stops and an export are one file each: those beside this one know nothing of each other.

The free motion of `Oscillator` is s0*exp(-z*t)*(cos(w*t) + z/w*sin(w*t)) with z = d/(2*m), w = sqrt(c/m - z**2): every
textbook of mechanics. A bouncing ball from height h lands first at sqrt(2*h/g).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.oscillator import Oscillator
from acausal.simulate.driver.run import Run
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.options import options, parameter_vector
from acausal.simulate.solvers import SOLVERS
from tests.outside.dop853 import Dop853
from tests.outside.scipy_system import scipy_system
from tests.outside.watch import Watch


def motion(t: np.ndarray) -> np.ndarray:
    """Position of the oscillator with its defaults: m = 1 kg, c = 100 N/m, d = 1 N.s/m, s0 = 0.1 m."""
    z = 0.5
    w = np.sqrt(100.0 - z**2)
    return np.asarray(0.1 * np.exp(-z * t) * (np.cos(w * t) + z / w * np.sin(w * t)))


@pytest.fixture
def dop853(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(SOLVERS, Dop853.name, Dop853)
    return Dop853.name


def test_a_solver_from_outside_solves(dop853: str) -> None:
    r = acausal.simulate(Oscillator(), solver=dop853, tolerance=1e-9)
    assert r.stats["solver"] == "dop853"
    assert np.abs(r["mass.s"] - motion(r.time)).max() < 1e-9


def test_a_solver_from_outside_finds_events(dop853: str) -> None:
    r = acausal.simulate(BouncingBall(h0=2.0), solver=dop853, stop_time=1.0)
    assert r.events[0].time == pytest.approx(np.sqrt(2 * 2.0 / 9.81), abs=1e-8)


def watched(
    model: acausal.Component, watch: Watch, stop: float, solver: str = "rosenbrock", native: bool | None = None
) -> acausal.Result:
    compiled = acausal.compile(model)
    p = parameter_vector(compiled, {})
    chosen = options(compiled.flat.experiment, stop_time=stop, tolerance=1e-9, solver=solver, native=native)
    return Run(compiled, chosen, p, Inputs(np.zeros(0)), None, sources=(watch,)).result()


def test_a_source_of_stops_from_outside_stops_the_run() -> None:
    names = acausal.compile(Oscillator()).states
    s, v = names.index("mass.s"), names.index("mass.v")
    watch = Watch(lambda x: x[s], lambda x: x[v], most=0.01, longest=0.02)
    r = watched(Oscillator(), watch, 2.0)
    times, values = np.array(watch.seen).T
    assert values == pytest.approx(motion(times), abs=1e-9)
    # at 1 m/s in the middle it stops every 10 ms, at the turning points every 20 ms
    assert np.diff(times).min() < 0.0125
    assert watch.stops[-1] == 2.0
    assert np.diff(times).max() == pytest.approx(0.02)
    # stops at which nothing happens are no rows and no events
    assert r.time == pytest.approx(np.linspace(0.0, 2.0, 501), abs=1e-15)
    assert r.events == ()
    assert np.abs(r["mass.s"] - motion(r.time)).max() < 1e-9


@pytest.mark.parametrize(("solver", "native"), [("idas", False), ("rosenbrock", False), ("rosenbrock", True)])
def test_stops_from_outside_are_no_events(solver: str, native: bool) -> None:
    """Three bounces: at t1 = sqrt(2*h/g), then flights of 2*e*g*t1/g and 2*e**2*g*t1/g."""
    first = np.sqrt(2 * 1.0 / 9.81)
    watch = Watch(lambda x: x[0], lambda x: x[1], most=0.1, longest=0.05)
    r = watched(BouncingBall(e=0.7), watch, 1.6, solver, native)
    assert [e.time for e in r.events] == pytest.approx([first, 2.4 * first, 3.38 * first], abs=1e-8)
    assert len(r.time) == 501 + 2 * 3
    times, heights = np.array(watch.seen).T
    hit = first * np.array([1.0, 2.4, 3.38, 4.066])
    k = np.searchsorted(hit, times)
    flown = times - np.where(k, hit[k - 1], 0.0)
    up = np.where(k, 9.81 * first * 0.7**k, 0.0)
    assert heights == pytest.approx(np.where(k, up * flown, 1.0) - 9.81 / 2 * flown**2, abs=1e-7)


def test_an_export_from_outside_is_integrated_outside() -> None:
    system = scipy_system(Oscillator())
    grid = np.linspace(0.0, 5.0, 51)
    found = solve_ivp(system.rates, (0.0, 5.0), system.start, "DOP853", grid, rtol=1e-10, atol=1e-12)
    assert found.y[system.names.index("mass.s")] == pytest.approx(motion(grid), abs=1e-9)
