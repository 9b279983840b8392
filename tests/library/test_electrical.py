"""Analog circuits against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import root_scalar

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part
from acausal.library.blocks import Constant
from acausal.library.electrical import (
    Capacitor,
    Conductor,
    ConstantCurrent,
    ConstantVoltage,
    CurrentSensor,
    Diode,
    Ground,
    IdealTransformer,
    Inductor,
    PotentialSensor,
    RampCurrent,
    RampVoltage,
    Resistor,
    RotationalEMF,
    SignalCurrent,
    SignalVoltage,
    SineCurrent,
    SineVoltage,
    StepCurrent,
    StepVoltage,
    TranslationalEMF,
    VoltageSensor,
)
from acausal.library.rotational import Inertia
from acausal.library.translational import Mass
from acausal.models.rc_circuit import RCCircuit
from acausal.models.rc_ladder import RCLadder


def test_charging_of_a_capacitor() -> None:
    r = acausal.simulate(RCCircuit(R=2e3, C=1e-6, V=5.0), stop_time=10e-3, tolerance=1e-9)
    x = np.maximum(r.time - 1e-3, 0.0)
    assert r["capacitor.v"] == pytest.approx(5.0 * (1.0 - np.exp(-x / 2e-3)), abs=1e-7)


class SeriesRLC(Component):
    """Voltage step on a resistor, an inductor and a capacitor; a second step on resistor and inductor alone."""

    source: StepVoltage = StepVoltage(V=10.0, start_time=0.5)
    resistor: Resistor = Resistor(R=2.0)
    inductor: Inductor = Inductor(L=0.5, i=0.0)
    capacitor: Capacitor = Capacitor(C=0.02, v=0.0)
    resistor2: Resistor = Resistor(R=2.0)
    inductor2: Inductor = Inductor(L=0.5, i=0.0)
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p, self.resistor2.p)
        yield connect(self.resistor.n, self.inductor.p)
        yield connect(self.inductor.n, self.capacitor.p)
        yield connect(self.resistor2.n, self.inductor2.p)
        yield connect(self.capacitor.n, self.inductor2.n, self.source.n, self.ground.p)


def test_rlc_and_rl_step() -> None:
    """z = R/2L = 2 1/s, w = sqrt(1/LC - z^2); the inductor's current rises with L/R = 0.25 s."""
    r = acausal.simulate(SeriesRLC(), stop_time=4.0, tolerance=1e-9)
    x = np.maximum(r.time - 0.5, 0.0)
    z, w = 2.0, math.sqrt(100.0 - 4.0)
    assert r["capacitor.v"] == pytest.approx(
        10.0 * (1.0 - np.exp(-z * x) * (np.cos(w * x) + z / w * np.sin(w * x))), abs=1e-6
    )
    assert r["inductor2.i"] == pytest.approx(5.0 * (1.0 - np.exp(-x / 0.25)), abs=1e-7)


class Bridge(Component):
    """Unbalanced Wheatstone bridge with a resistor in the middle, and ideal meters."""

    source: ConstantVoltage = ConstantVoltage(V=12.0)
    r1: Resistor = Resistor(R=100.0)
    r2: Resistor = Resistor(R=200.0)
    r3: Resistor = Resistor(R=300.0)
    r4: Conductor = Conductor(G=1.0 / 400.0)
    middle: Resistor = Resistor(R=50.0)
    current: CurrentSensor = CurrentSensor()
    voltage: VoltageSensor = VoltageSensor()
    potential: PotentialSensor = PotentialSensor()
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.current.p)
        yield connect(self.current.n, self.r1.p, self.r3.p)
        yield connect(self.r1.n, self.r2.p, self.middle.p, self.voltage.p, self.potential.p)
        yield connect(self.r3.n, self.r4.p, self.middle.n, self.voltage.n)
        yield connect(self.r2.n, self.r4.n, self.source.n, self.ground.p)


def test_wheatstone_bridge() -> None:
    """Node voltages of the bridge from its 2x2 conductance matrix."""
    r = acausal.simulate(Bridge(), stop_time=1.0)
    g1, g2, g3, g4, gm = 1 / 100, 1 / 200, 1 / 300, 1 / 400, 1 / 50
    a, b = np.linalg.solve([[g1 + g2 + gm, -gm], [-gm, g3 + g4 + gm]], [12 * g1, 12 * g3])
    assert r.final("potential.phi") == pytest.approx(a, rel=1e-12)
    assert r.final("voltage.v") == pytest.approx(a - b, rel=1e-12)
    assert r.final("current.i") == pytest.approx((12 - a) * g1 + (12 - b) * g3, rel=1e-12)
    assert r.final("source.i") == pytest.approx(-r.final("current.i"), rel=1e-12)


class Transformed(Component):
    """Ideal transformer with a load on its secondary side; both sides are grounded."""

    source: SineVoltage = SineVoltage(V=10.0, f=50.0)
    transformer: IdealTransformer = IdealTransformer(n=4.0)
    load: Resistor = Resistor(R=5.0)
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.transformer.p1)
        yield connect(self.transformer.p2, self.load.p)
        yield connect(self.source.n, self.transformer.n1, self.transformer.n2, self.load.n, self.ground.p)


def test_transformer_multiplies_the_load_by_the_square_of_its_ratio() -> None:
    r = acausal.simulate(Transformed(), stop_time=0.02)
    u = 10.0 * np.sin(2.0 * math.pi * 50.0 * r.time)
    assert r["load.v"] == pytest.approx(u / 4.0, abs=1e-12)
    assert r["source.i"] == pytest.approx(-u / (16.0 * 5.0), abs=1e-12)


class Rectifier(Component):
    """Sine through a diode and a resistor."""

    V: Real = parameter(default=2.0, unit="V")
    source: SineVoltage = part()
    diode: Diode = Diode()
    load: Resistor = Resistor(R=100.0)
    ground: Ground = Ground()

    def build(self) -> None:
        self.source = SineVoltage(V=self.V, f=1.0)

    def equations(self) -> Equations:
        yield connect(self.source.p, self.diode.p)
        yield connect(self.diode.n, self.load.p)
        yield connect(self.load.n, self.source.n, self.ground.p)


@pytest.mark.parametrize("amplitude", [0.5, 2.0, 400.0])
def test_diode_in_series_with_a_resistor(amplitude: float) -> None:
    """Root of Ids*(exp(v/Vt) - 1) + v/R = (u - v)/100 by bracketing; 400 V reaches the tangent beyond Maxexp."""

    def current(v: float) -> float:
        x = v / 0.04
        curve = math.exp(x) if x < 15.0 else math.exp(15.0) * (1.0 + x - 15.0)
        return 1e-6 * (curve - 1.0) + v / 1e8

    r = acausal.simulate(Rectifier(V=amplitude), stop_time=1.0, output_interval=0.05)
    for t in (0.05, 0.25, 0.45, 0.5, 0.75, 0.95):
        u = amplitude * math.sin(2.0 * math.pi * t)
        bracket = (-amplitude - 1.0, amplitude + 1.0)
        v = root_scalar(lambda v, u=u: current(v) - (u - v) / 100.0, bracket=bracket, xtol=1e-15).root
        assert r.at(t, "diode.v") == pytest.approx(v, abs=1e-9), t
        assert r.at(t, "diode.i") == pytest.approx(current(v), rel=1e-6, abs=1e-12), t


class Sources(Component):
    """Every source on a resistor of 2 Ohm of its own."""

    sources: list[Any] = part()
    resistors: list[Resistor] = part()
    ground: Ground = Ground()
    level: Constant = Constant(k=5.0)

    def build(self) -> None:
        self.sources = [
            ConstantVoltage(V=3.0),
            StepVoltage(V=3.0, offset=1.0, start_time=1.0),
            RampVoltage(V=4.0, duration=2.0, offset=1.0, start_time=1.0),
            SineVoltage(V=3.0, f=0.25, phase=0.2, offset=1.0, start_time=1.0),
            SignalVoltage(),
            ConstantCurrent(I=-3.0),
            StepCurrent(I=-3.0, offset=-1.0, start_time=1.0),
            RampCurrent(I=-4.0, duration=2.0, offset=-1.0, start_time=1.0),
            SineCurrent(I=-3.0, f=0.25, phase=0.2, offset=-1.0, start_time=1.0),
            SignalCurrent(u=-5.0),
        ]
        self.resistors = [Resistor(R=2.0) for _ in self.sources]

    def equations(self) -> Equations:
        for source, resistor in zip(self.sources, self.resistors, strict=True):
            yield connect(source.p, resistor.p)
            yield connect(source.n, resistor.n, self.ground.p)
        yield connect(self.level.y, self.sources[4].u)


def test_waveforms_of_voltage_and_current_sources() -> None:
    """Voltages appear on the resistor; a current from p to n inside a source comes back through the resistor."""
    r = acausal.simulate(Sources(), stop_time=4.0, output_interval=0.5)
    before = [3.0, 1.0, 1.0, 1.0, 5.0]
    after = [3.0, 4.0, 2.0, 1.0 + 3.0 * math.sin(math.pi / 4.0 + 0.2), 5.0]
    for t, expected in ((0.5, before), (1.5, after)):
        for k in range(5):
            assert r.at(t, f"resistors[{k}].v") == pytest.approx(expected[k], abs=1e-12)
            assert r.at(t, f"resistors[{k + 5}].i") == pytest.approx(expected[k], abs=1e-12)


def test_ladder_is_diffusion() -> None:
    """Eigenvectors of the ladder, open at its far end: v_j = V*(1 - sum of decaying sines)."""
    n, R, C, V = 6, 2.0, 0.05, 3.0
    r = acausal.simulate(RCLadder(n=n, R=R, C=C, V=V), stop_time=5.0, tolerance=1e-9)
    angle = (2 * np.arange(1, n + 1) - 1) * math.pi / (2 * n + 1)
    shapes = np.sin(np.outer(np.arange(1, n + 1), angle)) * (2.0 / math.sqrt(2 * n + 1))
    rate = 4.0 * np.sin(angle / 2.0) ** 2 / (R * C)
    decaying = np.exp(-np.outer(r.time, rate)) * (shapes.T @ np.full(n, V))
    for j in range(n):
        assert r[f"capacitors[{j}].v"] == pytest.approx(V - decaying @ shapes[j], abs=1e-7)


class Machines(Component):
    """A motor and a voice coil behind resistors, each on 12 V, with nothing to move but their own mass."""

    source: ConstantVoltage = ConstantVoltage(V=12.0)
    ground: Ground = Ground()
    resistor: Resistor = Resistor(R=0.5)
    motor: RotationalEMF = RotationalEMF(k=0.2)
    rotor: Inertia = Inertia(J=0.02, phi=fixed(0.0), w=fixed(0.0))
    series: Resistor = Resistor(R=2.0)
    coil: TranslationalEMF = TranslationalEMF(k=5.0)
    mass: Mass = Mass(m=3.0, s=fixed(0.0), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p, self.series.p)
        yield connect(self.resistor.n, self.motor.p)
        yield connect(self.series.n, self.coil.p)
        yield connect(self.motor.n, self.coil.n, self.source.n, self.ground.p)
        yield connect(self.motor.flange, self.rotor.flange_a)
        yield connect(self.coil.flange, self.mass.flange_a)


def test_machines_run_up_to_where_the_emf_balances_the_voltage() -> None:
    """V/k (1 - exp(-k^2 t/(R J))), and the electrical power of the EMF is the mechanical one."""
    r = acausal.simulate(Machines(), stop_time=2.0, tolerance=1e-9)
    assert r["rotor.w"] == pytest.approx(12.0 / 0.2 * (1.0 - np.exp(-(0.2**2) * r.time / (0.5 * 0.02))), abs=1e-5)
    assert r["mass.v"] == pytest.approx(12.0 / 5.0 * (1.0 - np.exp(-(5.0**2) * r.time / (2.0 * 3.0))), abs=1e-6)
    power = r["motor.v"] * r["motor.i"]
    assert power == pytest.approx(0.02 * r["rotor.a"] * r["rotor.w"], abs=1e-6)


def test_a_state_has_the_name_of_what_is_differentiated() -> None:
    """As users of Modelica expect: the voltage of the capacitor, not the pin whose potential is equal to it."""

    class Filter(Component):
        source: ConstantVoltage = ConstantVoltage(V=1.0)
        resistor: Resistor = Resistor(R=10.0)
        inductor: Inductor = Inductor(L=1e-3)
        capacitor: Capacitor = Capacitor(C=1e-3)
        ground: Ground = Ground()

        def equations(self) -> Equations:
            yield connect(self.source.p, self.resistor.p)
            yield connect(self.resistor.n, self.inductor.p)
            yield connect(self.inductor.n, self.capacitor.p)
            yield connect(self.capacitor.n, self.source.n, self.ground.p)

    assert set(acausal.compile(Filter()).states) == {"inductor.i", "capacitor.v"}
