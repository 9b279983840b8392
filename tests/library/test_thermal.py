"""Heat transfer against closed forms; the worked examples of the Modelica library are in tests/accuracy."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, connect, fixed
from acausal.library import blocks, electrical, thermal
from acausal.library.thermal.components import STEFAN_BOLTZMANN


class Wall(Component):
    """A hot body behind a wall of two layers and a heat flow meter, with convection outside."""

    inside: thermal.PrescribedTemperature = thermal.PrescribedTemperature()
    warm: blocks.Constant = blocks.Constant(k=300.0)
    first: thermal.ThermalResistor = thermal.ThermalResistor(R=0.5)
    meter: thermal.HeatFlowSensor = thermal.HeatFlowSensor()
    second: thermal.ThermalConductor = thermal.ThermalConductor(G=4.0)
    film: thermal.Convection = thermal.Convection()
    conductance: blocks.Constant = blocks.Constant(k=2.0)
    outside: thermal.FixedTemperature = thermal.FixedTemperature(T=275.0)
    between: thermal.TemperatureSensor = thermal.TemperatureSensor()
    across: thermal.RelTemperatureSensor = thermal.RelTemperatureSensor()

    def equations(self) -> Equations:
        yield connect(self.warm.y, self.inside.T)
        yield connect(self.conductance.y, self.film.Gc)
        yield connect(self.inside.port, self.first.port_a, self.across.port_a)
        yield connect(self.first.port_b, self.meter.port_a, self.between.port)
        yield connect(self.meter.port_b, self.second.port_a)
        yield connect(self.second.port_b, self.film.solid)
        yield connect(self.film.fluid, self.outside.port, self.across.port_b)


def test_resistances_of_layers_add_up() -> None:
    """25 K over 1/2 + 1/4 + 1/2 K/W is 20 W; behind the first layer it is 10 K colder."""
    r = acausal.simulate(Wall(), stop_time=1.0)
    assert r.final("meter.Q_flow") == pytest.approx(20.0, rel=1e-12)
    assert r.final("between.T") == pytest.approx(290.0, rel=1e-12)
    assert r.final("across.T_rel") == pytest.approx(25.0, rel=1e-12)


class Radiator(Component):
    """A body that radiates into space at 0 K."""

    body: thermal.HeatCapacitor = thermal.HeatCapacitor(C=1000.0, T=fixed(600.0))
    radiation: thermal.BodyRadiation = thermal.BodyRadiation(Gr=0.5)
    space: thermal.FixedTemperature = thermal.FixedTemperature(T=0.0)

    def equations(self) -> Equations:
        yield connect(self.body.port, self.radiation.port_a)
        yield connect(self.radiation.port_b, self.space.port)


def test_a_body_cools_by_radiation() -> None:
    """C dT/dt = -Gr sigma T^4 has the solution T = (T0^-3 + 3 Gr sigma t/C)^(-1/3)."""
    r = acausal.simulate(Radiator(), stop_time=300.0, tolerance=1e-9)
    expected = (600.0**-3 + 3 * 0.5 * STEFAN_BOLTZMANN * 300.0 / 1000.0) ** (-1 / 3)
    assert r.final("body.T") == pytest.approx(expected, rel=1e-7)


class Heater(Component):
    """A resistor on a constant voltage that warms itself."""

    source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=10.0)
    coil: electrical.HeatingResistor = electrical.HeatingResistor(R_ref=5.0, T_ref=300.0, alpha=0.01)
    ground: electrical.Ground = electrical.Ground()
    body: thermal.HeatCapacitor = thermal.HeatCapacitor(C=2.0, T=fixed(300.0))

    def equations(self) -> Equations:
        yield connect(self.source.p, self.coil.p)
        yield connect(self.source.n, self.coil.n, self.ground.p)
        yield connect(self.coil.heatPort, self.body.port)


def test_a_resistor_that_warms_itself() -> None:
    """With x = 1 + alpha (T - T_ref), C x'/alpha = V^2/(R x): x = sqrt(1 + 2 alpha V^2 t/(R C))."""
    r = acausal.simulate(Heater(), stop_time=20.0, tolerance=1e-9)
    x = math.sqrt(1.0 + 2 * 0.01 * 100.0 * 20.0 / (5.0 * 2.0))
    assert r.final("coil.R_actual") == pytest.approx(5.0 * x, rel=1e-7)
    assert r.final("body.T") == pytest.approx(300.0 + (x - 1.0) / 0.01, rel=1e-7)
