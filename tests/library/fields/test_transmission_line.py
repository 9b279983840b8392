"""Waves on a line: d'Alembert's solution, reflections, and the resistance of a long time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, exp, part, signal_output, time, unitless
from acausal.library.electrical import Ground, Resistor, SignalVoltage
from acausal.library.fields import TransmissionLine

# 1 m of 50 Ohm, 5 ns.
Z, DELAY = 50.0, 5e-9


class Pulse(Component):
    """A Gaussian of 1 V around 4 ns, 1 ns wide."""

    y: Real = signal_output(unit="V")

    def equations(self) -> Equations:
        yield self.y == acausal.quantity(1.0, "V") * exp(-(((unitless(time) - 4e-9) / 1e-9) ** 2) / 2.0)


def shape(t: Any) -> Any:
    return np.exp(-(((t - 4e-9) / 1e-9) ** 2) / 2.0)


class Fed(Component):
    """A line behind a source with its own resistance, into a load."""

    load: Real = acausal.parameter(default=Z, unit="Ohm")
    pulse: Pulse = Pulse()
    source: SignalVoltage = SignalVoltage()
    inner: Resistor = Resistor(R=Z)
    line: TransmissionLine = TransmissionLine(N=200)
    end: Resistor = part()
    ground: Ground = Ground()

    def build(self) -> None:
        self.end = Resistor(R=self.load)

    def equations(self) -> Equations:
        yield connect(self.pulse.y, self.source.u)
        yield connect(self.source.p, self.inner.p)
        yield connect(self.inner.n, self.line.p1)
        yield connect(self.line.p2, self.end.p)
        yield connect(self.source.n, self.line.p3, self.end.n, self.ground.p)


def run(load: float) -> acausal.Result:
    return acausal.simulate(Fed(), parameters={"load": load}, stop_time=25e-9, tolerance=1e-7)


def test_a_matched_load_gets_half_of_the_pulse_one_delay_later() -> None:
    """d'Alembert: v(L, t) = u(t - L sqrt(l c)) / 2, and nothing comes back."""
    result = run(Z)
    assert np.abs(result["line.p2.v"] - 0.5 * shape(result.time - DELAY)).max() < 2e-3
    assert np.abs(result["line.p1.v"] - 0.5 * shape(result.time)).max() < 2e-3


@pytest.mark.parametrize("load", [10.0, 500.0])
def test_a_load_sends_back_its_share(load: float) -> None:
    """Reflection (R - Z) / (R + Z), once: the source takes what comes back."""
    result = run(load)
    back = (load - Z) / (load + Z)
    assert np.abs(result["line.p2.v"] - 0.5 * (1.0 + back) * shape(result.time - DELAY)).max() < 4e-3
    expected = 0.5 * shape(result.time) + 0.5 * back * shape(result.time - 2.0 * DELAY)
    assert np.abs(result["line.p1.v"] - expected).max() < 6e-3
