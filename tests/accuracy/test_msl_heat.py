"""Heat transfer, and what it does to circuits and brakes: examples of the Modelica Standard Library.

Compared with converged solutions, with the published one where there is no other (Heat_TwoMasses), and with closed
forms; the limits are those of the data's README.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, no_event, parameter, part, structural, time, where
from acausal.library import blocks, electrical, rotational, thermal
from tests.accuracy.msl_reference import met


class TwoMasses(Component):
    """Heat_TwoMasses."""

    mass1: thermal.HeatCapacitor = thermal.HeatCapacitor(C=15.0, T=fixed(373.15))
    mass2: thermal.HeatCapacitor = thermal.HeatCapacitor(C=15.0, T=fixed(273.15))
    conduction: thermal.ThermalConductor = thermal.ThermalConductor(G=10.0)

    def equations(self) -> Equations:
        yield connect(self.mass1.port, self.conduction.port_a)
        yield connect(self.conduction.port_b, self.mass2.port)


class Motor(Component):
    """Heat_Motor: losses of winding and core, conduction between them, convection to the surroundings."""

    periods: int = structural(default=12)
    losses: blocks.Pulse = part()
    windingLosses: thermal.PrescribedHeatFlow = part()
    winding: thermal.HeatCapacitor = part()
    winding2core: thermal.ThermalConductor = part()
    coreLosses: thermal.FixedHeatFlow = part()
    core: thermal.HeatCapacitor = part()
    convection: thermal.Convection = part()
    conductance: blocks.Constant = part()
    environment: thermal.FixedTemperature = part()

    def build(self) -> None:
        # 100 W for 360 s, then 1000 W for 240 s, again and again
        self.losses = blocks.Pulse(
            amplitude=900.0, width=0.4, period=600.0, nperiod=self.periods, offset=100.0, start_time=360.0
        )
        self.windingLosses = thermal.PrescribedHeatFlow(T_ref=368.15, alpha=3.03e-3)
        self.winding = thermal.HeatCapacitor(C=2500.0, T=fixed(293.15))
        self.winding2core = thermal.ThermalConductor(G=10.0)
        self.coreLosses = thermal.FixedHeatFlow(Q_flow=500.0)
        self.core = thermal.HeatCapacitor(C=25000.0, T=fixed(293.15))
        self.convection = thermal.Convection()
        self.conductance = blocks.Constant(k=25.0)
        self.environment = thermal.FixedTemperature(T=293.15)

    def equations(self) -> Equations:
        yield connect(self.losses.y, self.windingLosses.Q_flow)
        yield connect(self.windingLosses.port, self.winding.port, self.winding2core.port_a)
        yield connect(self.winding2core.port_b, self.core.port, self.coreLosses.port, self.convection.solid)
        yield connect(self.convection.fluid, self.environment.port)
        yield connect(self.conductance.y, self.convection.Gc)


class HeatingRectifier(Component):
    """Electrical_HeatingRectifier: a diode that warms itself."""

    SineVoltage1: electrical.SineVoltage = electrical.SineVoltage(V=1.0, f=1.0)
    HeatingDiode1: electrical.HeatingDiode = electrical.HeatingDiode()
    Capacitor1: electrical.Capacitor = electrical.Capacitor(C=1.0, v=fixed(0.0))
    Resistor1: electrical.Resistor = electrical.Resistor(R=1.0)
    Ground1: electrical.Ground = electrical.Ground()
    ThermalConductor1: thermal.ThermalConductor = thermal.ThermalConductor(G=10.0)
    HeatCapacitor1: thermal.HeatCapacitor = thermal.HeatCapacitor(C=1.0, T=fixed(293.15))

    def equations(self) -> Equations:
        yield connect(self.SineVoltage1.p, self.HeatingDiode1.p)
        yield connect(self.HeatingDiode1.n, self.Capacitor1.p, self.Resistor1.p)
        yield connect(self.SineVoltage1.n, self.Capacitor1.n, self.Resistor1.n, self.Ground1.p)
        yield connect(self.HeatingDiode1.heatPort, self.ThermalConductor1.port_a)
        yield connect(self.ThermalConductor1.port_b, self.HeatCapacitor1.port)


class ShowSaturatingInductor(Component):
    """Electrical_ShowSaturatingInductor: one voltage on a saturating and on a linear inductor."""

    SineVoltage1: electrical.SineVoltage = electrical.SineVoltage(V=1.25, f=1 / (2 * math.pi), phase=math.pi / 2)
    SaturatingInductance1: electrical.SaturatingInductor = electrical.SaturatingInductor(Psi=fixed(0.0))
    Inductance1: electrical.Inductor = electrical.Inductor(L=1.0, i=fixed(0.0))
    Ground1: electrical.Ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.SineVoltage1.p, self.SaturatingInductance1.p, self.Inductance1.p)
        yield connect(self.SineVoltage1.n, self.SaturatingInductance1.n, self.Inductance1.n, self.Ground1.p)


class NonlinearResistor(electrical.PartialOnePort):
    """Chua's resistor, of three straight pieces; as in Modelica.Electrical.Analog.Examples.Utilities."""

    Ga: Real = parameter(unit="S", doc="Conductance inside")
    Gb: Real = parameter(unit="S", doc="Conductance outside")
    Ve: Real = parameter(unit="V", doc="Voltage at which the pieces meet")

    def equations(self) -> Equations:
        outer = (self.Ga - self.Gb) * self.Ve
        inside = where(no_event(self.v > self.Ve), self.Gb * self.v + outer, self.Ga * self.v)
        yield self.i == where(no_event(self.v < -self.Ve), self.Gb * self.v - outer, inside)


class ChuaCircuit(Component):
    """Electrical_ChuaCircuit, in scaled units; chaotic."""

    L: electrical.Inductor = electrical.Inductor(L=18.0, i=fixed(0.0))
    Ro: electrical.Resistor = electrical.Resistor(R=12.5e-3)
    G: electrical.Conductor = electrical.Conductor(G=0.565)
    C1: electrical.Capacitor = electrical.Capacitor(C=10.0, v=fixed(4.0))
    C2: electrical.Capacitor = electrical.Capacitor(C=100.0, v=fixed(0.0))
    Nr: NonlinearResistor = NonlinearResistor(Ga=-0.757576, Gb=-0.409091, Ve=1.0)
    Gnd: electrical.Ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.L.p, self.G.p, self.C2.p)
        yield connect(self.L.n, self.Ro.p)
        yield connect(self.G.n, self.Nr.p, self.C1.p)
        yield connect(self.Gnd.p, self.Ro.n, self.C2.n, self.C1.n, self.Nr.n)


class EddyCurrentBrake(Component):
    """Rotational_EddyCurrentBrake: a wheel that is braked and heats the disc."""

    inertia: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(20.0))
    eddyCurrentTorque: rotational.EddyCurrentTorque = rotational.EddyCurrentTorque(
        tau_nominal=100.0, w_nominal=10.0, alpha20=3.92e-3
    )
    heatCapacitor: thermal.HeatCapacitor = thermal.HeatCapacitor(C=1.0, T=fixed(293.15))
    ramp: blocks.Ramp = blocks.Ramp(height=1.0, duration=0.1, start_time=0.1)

    def equations(self) -> Equations:
        yield connect(self.inertia.flange_b, self.eddyCurrentTorque.flange)
        yield connect(self.eddyCurrentTorque.heatPort, self.heatCapacitor.port)
        yield connect(self.ramp.y, self.eddyCurrentTorque.exc)


class SwitchedHeater(Component):
    """As the circuit of Heat_ControlledTemperature: a resistor that warms itself behind a switch."""

    supply: electrical.ConstantVoltage = electrical.ConstantVoltage(V=15.0)
    resistor: electrical.HeatingResistor = electrical.HeatingResistor(R_ref=6.0, T_ref=293.15, alpha=5e-3)
    switch: electrical.IdealClosingSwitch = electrical.IdealClosingSwitch()
    ground: electrical.Ground = electrical.Ground()
    body: thermal.HeatCapacitor = thermal.HeatCapacitor(C=2.0, T=fixed(290.0))

    def equations(self) -> Equations:
        yield connect(self.supply.p, self.resistor.p)
        yield connect(self.resistor.n, self.switch.p)
        yield connect(self.switch.n, self.supply.n, self.ground.p)
        yield connect(self.resistor.heatPort, self.body.port)
        yield self.switch.control == (time < 1.0)


def test_a_linear_block_is_solved_whatever_the_sign_of_its_pivot_far_away() -> None:
    """No unknown is iterated, although the resistance is negative at temperatures below 93 K.

    While closed C*T' = V^2/(R_ref*(1 + alpha*(T - T_ref)) + Ron), so with y = 1 + alpha*(T - T_ref) + Ron/R_ref it is
    y^2 = y0^2 + 2*alpha*V^2*t/(C*R_ref) up to Ron/R_ref = 2e-6 of the losses.
    """
    compiled = acausal.compile(SwitchedHeater())
    assert compiled.algebraic == ()
    r = acausal.simulate(compiled, stop_time=1.0, tolerance=1e-8)
    y = math.sqrt((1.0 - 5e-3 * 3.15) ** 2 + 2.0 * 5e-3 * 15.0**2 / (2.0 * 6.0))
    assert r.at(0.999999, "body.T") == pytest.approx(293.15 + (y - 1.0) / 5e-3, abs=1e-3)


@pytest.mark.parametrize("model", [HeatingRectifier, ShowSaturatingInductor, EddyCurrentBrake])
def test_converged_examples(model: type[Component], reference: Path) -> None:
    domain = "Rotational" if model is EddyCurrentBrake else "Electrical"
    renamed = {"eddyCurrentTorque.lossPower": "eddyCurrentTorque.loss_power"}
    met(model(), reference / "msl" / f"{domain}_{model.__name__}", renamed=renamed)


def test_two_masses(reference: Path) -> None:
    """Within the library's limit of the published curves, and on T = 323.15 +- 50 exp(-4 t/3)."""
    r = met(TwoMasses(), reference / "msl" / "Heat_TwoMasses", 2e-3, file="reference.csv")
    assert r["mass1.T"] == pytest.approx(323.15 + 50.0 * np.exp(-4.0 * r.time / 3.0), abs=1e-6)
    assert r["mass2.T"] == pytest.approx(323.15 - 50.0 * np.exp(-4.0 * r.time / 3.0), abs=1e-6)


@pytest.mark.parametrize(("model", "folder"), [(Motor, "Heat_Motor"), (ChuaCircuit, "Electrical_ChuaCircuit")])
def test_examples_without_a_published_run(model: type[Component], folder: str, reference: Path) -> None:
    """Chua's circuit at 1e-11: two independent integrations agree to 1e-6 there; looser ones part before the end."""
    tolerance = 1e-11 if model is ChuaCircuit else 1e-8
    solver = "rosenbrock" if model is ChuaCircuit else None
    met(model(), reference / "msl" / folder, tolerance=tolerance, solver=solver)
