"""Ideal diodes, thyristors and switches on a sine source with a resistor: the wave, or nothing.

By idas: rosenbrock does not get past a diode in a model that has no continuous state at all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, part, structural, time
from acausal.library import electrical


class HalfWave(Component):
    """Source of 10 V and 50 Hz, a switch, and 5 Ohm."""

    switch: Any = part()
    source: electrical.SineVoltage = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()
    kind: str = structural(default="IdealDiode")

    def build(self) -> None:
        late = (time > 0.005) & (time < 0.006) | (time > 0.025)
        given: dict[str, Any] = {"Ron": 1e-6, "Goff": 1e-9}
        if "Thyristor" in self.kind:
            given["fire"] = late
        if "Switch" in self.kind:
            given["control"] = late
        self.switch = getattr(electrical, self.kind)(**given)
        self.source = electrical.SineVoltage(V=10.0, f=50.0)
        self.load = electrical.Resistor(R=5.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.switch.p)
        yield connect(self.switch.n, self.load.p)
        yield connect(self.load.n, self.source.n, self.ground.p)


def conducting(kind: str, t: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    late = (t > 0.005) & (t < 0.006) | (t > 0.025)
    up = np.sin(100.0 * np.pi * t) > 0.0
    return {
        "IdealDiode": up,
        "IdealThyristor": up & ((t > 0.005) & (t < 0.01) | (t > 0.025)),
        "IdealGTOThyristor": up & late,
        "IdealOpeningSwitch": ~late,
        "IdealClosingSwitch": late,
    }[kind]


@pytest.mark.parametrize(
    "kind", ["IdealDiode", "IdealThyristor", "IdealGTOThyristor", "IdealOpeningSwitch", "IdealClosingSwitch"]
)
def test_the_load_sees_the_source_while_the_switch_conducts(kind: str) -> None:
    r = acausal.simulate(HalfWave(kind=kind), stop_time=0.035, tolerance=1e-8, output_interval=1e-4, solver="idas")
    t = np.arange(0.5e-4, 0.035, 1e-4)
    expected = np.where(conducting(kind, t), 10.0 * np.sin(100.0 * np.pi * t), 0.0)
    np.testing.assert_allclose(r.at(t, "load.v"), expected, rtol=0, atol=3e-3)  # linear between outputs


def test_a_diode_with_a_knee_conducts_above_it() -> None:
    class Knee(HalfWave):
        def build(self) -> None:
            super().build()
            self.switch = electrical.IdealDiode(Ron=1e-6, Goff=1e-9, Vknee=2.0)

    r = acausal.simulate(Knee(), stop_time=0.01, tolerance=1e-8, output_interval=1e-4, solver="idas")
    assert r["load.v"].max() == pytest.approx(8.0, abs=1e-3)
    first = np.arcsin(0.2) / (100.0 * np.pi)
    assert r.events[0].time == pytest.approx(first, abs=1e-7)


class CurrentBridge(Component):
    """A current of 1 A and 50 Hz through four diodes without any losses into 10 Ohm."""

    source: electrical.SineCurrent = part()
    diodes: Any = part()
    load: electrical.Resistor = electrical.Resistor(R=10.0)
    ground: electrical.Ground = electrical.Ground()
    phase: float = structural(default=0.0)

    def build(self) -> None:
        self.source = electrical.SineCurrent(I=1.0, f=50.0, phase=self.phase)
        self.diodes = [electrical.IdealDiode(Ron=0.0, Goff=0.0) for _ in range(4)]

    def equations(self) -> Equations:
        a, b, c, d = self.diodes
        yield connect(self.source.n, a.p, b.n)
        yield connect(self.source.p, c.p, d.n)
        yield connect(a.n, c.n, self.load.p)
        yield connect(b.p, d.p, self.load.n, self.ground.p)


@pytest.mark.parametrize("phase", [0.0, np.pi, 0.3])
@pytest.mark.parametrize("form", ["torn", "dae"])
def test_a_current_finds_its_way_through_diodes_without_losses(phase: float, form: str) -> None:
    """10 V |sin|. At zero current nothing says what blocks: the start did not know (AC304), nor did each zero."""
    model = acausal.compile(CurrentBridge(phase=phase), formulation=form)
    run = acausal.simulate(model, stop_time=0.04, solver="idas")
    expected = 10.0 * np.abs(np.sin(100.0 * np.pi * run.time + phase))
    assert run["load.v"] == pytest.approx(expected, abs=1e-9)
    assert len(run.events) == 4
