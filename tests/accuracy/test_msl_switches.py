"""Ideal switches: examples of the Modelica Standard Library against converged and published solutions."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import blocks, electrical
from tests.accuracy.msl_reference import met


class SwitchWithArc(Component):
    """Electrical_SwitchWithArc: an inductor switched off by an ideal switch, and by one with an arc."""

    source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=50.0)
    switch1: electrical.IdealClosingSwitch = electrical.IdealClosingSwitch()
    inductor1: electrical.Inductor = part()
    resistor1: electrical.Resistor = part()
    switch2: electrical.CloserWithArc = electrical.CloserWithArc(V0=30.0, dVdt=10e3, Vmax=60.0)
    inductor2: electrical.Inductor = part()
    resistor2: electrical.Resistor = part()
    ground: electrical.Ground = electrical.Ground()
    pulse: blocks.BooleanPulse = blocks.BooleanPulse(period=1.0)

    def build(self) -> None:
        self.inductor1, self.inductor2 = (electrical.Inductor(L=0.1, i=0.0) for _ in range(2))
        self.resistor1, self.resistor2 = (electrical.Resistor(R=1.0) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(self.source.p, self.switch1.p, self.switch2.p)
        yield connect(self.switch1.n, self.inductor1.p)
        yield connect(self.inductor1.n, self.resistor1.p)
        yield connect(self.switch2.n, self.inductor2.p)
        yield connect(self.inductor2.n, self.resistor2.p)
        yield connect(self.source.n, self.resistor1.n, self.resistor2.n, self.ground.p)
        yield connect(self.pulse.y, self.switch1.control, self.switch2.control)


class DiodeBridge2Pulse(Component):
    """Electrical_DiodeBridge2Pulse: a bridge of four ideal diodes on a resistor, and the means of its output."""

    source: electrical.SineVoltage = electrical.SineVoltage(V=math.sqrt(2.0) * 110.0, f=50.0)
    diodes: list[electrical.IdealDiode] = part()
    load: electrical.Resistor = electrical.Resistor(R=20.0)
    ground: electrical.Ground = electrical.Ground()
    voltage: electrical.VoltageSensor = electrical.VoltageSensor()
    current: electrical.CurrentSensor = electrical.CurrentSensor()
    meanVoltage: blocks.Mean = blocks.Mean(f=100.0)
    meanCurrent: blocks.Mean = blocks.Mean(f=100.0)
    rootMeanSquareVoltage: blocks.RootMeanSquare = blocks.RootMeanSquare(f=100.0)

    def build(self) -> None:
        self.diodes = [electrical.IdealDiode() for _ in range(4)]

    def equations(self) -> Equations:
        up1, up2, down1, down2 = self.diodes
        yield connect(self.source.p, up1.p, down1.n)
        yield connect(self.source.n, up2.p, down2.n, self.ground.p)
        yield connect(up1.n, up2.n, self.current.p, self.voltage.p)
        yield connect(self.current.n, self.load.p)
        yield connect(down1.p, down2.p, self.load.n, self.voltage.n)
        yield connect(self.voltage.v, self.meanVoltage.u, self.rootMeanSquareVoltage.u)
        yield connect(self.current.i, self.meanCurrent.u)


def test_switch_with_arc_meets_the_converged_solution(reference: Path) -> None:
    met(SwitchWithArc(), reference / "msl" / "Electrical_SwitchWithArc")


def test_diode_bridge_meets_the_published_solution_and_the_closed_form(reference: Path) -> None:
    r = met(DiodeBridge2Pulse(), reference / "msl" / "Electrical_DiodeBridge2Pulse", 2e-3, file="reference.csv")
    # the means of a rectified sine, with 2e-5 Ohm of the diodes in series with 20 Ohm: README of the data
    assert r.final("meanVoltage.y") == pytest.approx(99.0347, abs=1e-4)
    assert r.final("meanCurrent.y") == pytest.approx(4.95173, abs=1e-5)
    assert r.final("rootMeanSquareVoltage.mean.y") == pytest.approx(12099.976, abs=1e-2)
