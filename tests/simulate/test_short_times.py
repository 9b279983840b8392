"""Runs and stretches shorter than a nanosecond are integrated too."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, der, fixed, guess, part, variable
from acausal.library import electrical

SOLVERS = ("idas", "cvodes", "rosenbrock", "erk")


class Fast(Component):
    """A time constant of a nanosecond, and an algebraic variable for the DAE solver."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=guess(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1e9 * self.y
        yield self.y + 0.1 * self.y**3 == 1.1 * self.x**3 / self.x**2


class Decay(Component):
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -1e9 * self.x


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("stop", [5e-9, 5e-10, 5e-12])
def test_a_decay_within_nanoseconds(solver: str, stop: float) -> None:
    """CasADi's IDAS and CVODES take outputs nearer than 1e-9 s as reached: the result was the start value."""
    result = acausal.simulate(Decay(), stop_time=stop, solver=solver, tolerance=1e-8)
    assert np.abs(result["x"] - np.exp(-1e9 * result.time)).max() < 1e-7
    assert result.final("x") == pytest.approx(math.exp(-1e9 * stop), abs=2e-8)


def test_so_does_a_dae() -> None:
    a, b = (acausal.simulate(Fast(), stop_time=2e-9, solver=s, tolerance=1e-10) for s in ("idas", "rosenbrock"))
    assert a.final("x") == pytest.approx(b.final("x"), abs=1e-8)
    assert a.final("x") < 0.3


class LineCommutated(Component):
    """Six ideal diodes between three phases with inductances and a capacitor; everything is zero at the start."""

    phases: list[electrical.SineVoltage] = part()
    lines: list[electrical.Inductor] = part()
    diodes: list[electrical.IdealDiode] = part()
    C: electrical.Capacitor = electrical.Capacitor(C=1e-3, v=fixed(0.0))
    R: electrical.Resistor = electrical.Resistor(R=10.0)
    ground: electrical.Ground = electrical.Ground()

    def build(self) -> None:
        thirds = [-2.0 * math.pi / 3.0 * k for k in range(3)]
        self.phases = [electrical.SineVoltage(V=100.0, f=50.0, phase=phase) for phase in thirds]
        self.lines = [electrical.Inductor(L=1e-3, i=fixed(0.0) if k < 2 else guess(0.0)) for k in range(3)]
        self.diodes = [electrical.IdealDiode(Ron=1e-3, Goff=1e-3) for _ in range(6)]

    def equations(self) -> Equations:
        d = self.diodes
        yield connect(*(phase.n for phase in self.phases), self.ground.p)
        for k in range(3):
            yield connect(self.phases[k].p, self.lines[k].p)
            yield connect(self.lines[k].n, d[k].p, d[k + 3].n)
        yield connect(*(d[k].n for k in range(3)), self.C.p, self.R.p)
        yield connect(*(d[k].p for k in range(3, 6)), self.C.n, self.R.n)


@pytest.mark.parametrize("interval", [1e-2, 1e-4])
@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_stretches_between_close_events_are_integrated(solver: str, interval: float) -> None:
    """Two diodes flip at the start within 1e-10 s; 4 ns were lost there, 4e-4 A (one-step methods lose nothing)."""
    at = np.array([2e-4, 1e-3, 4e-3, 1e-2])
    found, expected = (
        acausal.simulate(LineCommutated(), stop_time=0.01, solver=s, tolerance=1e-9, output_interval=h)
        for s, h in ((solver, interval), ("rosenbrock", 1e-4))
    )
    times = at if interval < 1e-3 else at[-1:]
    assert np.abs(found.at(times, "C.v") - expected.at(times, "C.v")).max() < 1e-6
    assert len(found.events) == len(expected.events)
