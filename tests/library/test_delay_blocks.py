"""Delay blocks against what a sine was, and Pade's approximation against its own transfer function."""

from __future__ import annotations

from math import pi, sin

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect
from acausal.library.blocks import FixedDelay, PadeDelay, Ramp, Sine, Step, VariableDelay


class Bench(Component):
    """One sine through three delays of 0.3 s, one of which grows from 0.1 s at 0.1 s/s."""

    source: Sine = Sine(f=0.5)
    fixed: FixedDelay = FixedDelay(delay_time=0.3)
    varying: VariableDelay = VariableDelay(delay_max=2.0)
    pade: PadeDelay = PadeDelay(delay_time=0.3, n=4)
    length: Ramp = Ramp(height=1.0, duration=10.0, offset=0.1)

    def equations(self) -> Equations:
        yield connect(self.source.y, self.fixed.u, self.varying.u, self.pade.u)
        yield connect(self.length.y, self.varying.delay_time)


def test_a_sine_through_all_of_them() -> None:
    r = acausal.simulate(Bench(), stop_time=6.0, tolerance=1e-8, output_interval=0.05)
    for t, fixed, varying in zip(r.time, r["fixed.y"], r["varying.y"], strict=True):
        assert fixed == pytest.approx(sin(pi * max(t - 0.3, 0.0)), abs=1e-7)
        assert varying == pytest.approx(sin(pi * max(t - 0.1 - 0.1 * t, 0.0)), abs=1e-7)
    late = r.time > 2.0
    # |G| = 1, and the phase is off by (w T)^9 (4!)^2 / (8! 9!) or so: 3e-8
    assert r["pade.y"][late] == pytest.approx(r["fixed.y"][late], abs=1e-6)


class Jump(Component):
    """A step into an approximation whose numerator is of lower order."""

    source: Step = Step(start_time=1.0)
    pade: PadeDelay = PadeDelay(delay_time=1.0, n=2, m=1)

    def equations(self) -> Equations:
        yield connect(self.source.y, self.pade.u)


def test_pade_of_order_two_and_one() -> None:
    """(1 - s/3) / (1 + 2 s/3 + s^2/6): poles -2 +- i sqrt 2; y = 1 - exp(-2 t) (cos + 2 sqrt 2 sin)(sqrt 2 t)."""
    r = acausal.simulate(Jump(), stop_time=5.0, tolerance=1e-9, output_interval=0.1)
    t = np.maximum(r.time - 1.0, 0.0)
    w = np.sqrt(2.0)
    assert r["pade.y"] == pytest.approx(1 - np.exp(-2 * t) * (np.cos(w * t) + 2 * w * np.sin(w * t)), abs=1e-8)
