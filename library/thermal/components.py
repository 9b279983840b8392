"""Storage and transport of heat. Names as in Modelica.Thermal.HeatTransfer.Components."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, guess, parameter, quantity, signal_input, variable
from acausal.library.thermal.interfaces import HeatPort, PartialElement1D

STEFAN_BOLTZMANN = 5.670374419e-8
"""Constant of black-body radiation [W/(m2.K4)]; exact in the SI of 2019, here to ten digits."""


class HeatCapacitor(Component):
    """Lumped body of uniform temperature; its start value is that of `T`."""

    port: HeatPort = HeatPort()
    C: Real = parameter(unit="J/K", min=0.0, doc="Heat capacity")
    T: Real = variable(unit="K", nominal=300.0, prefer_state=True, default=guess(293.15), doc="Temperature of the body")
    der_T: Real = variable(unit="K/s", doc="Rate of the temperature")

    def equations(self) -> Equations:
        yield self.T == self.port.T
        yield self.der_T == der(self.T)
        yield self.C * self.der_T == self.port.Q_flow


class ThermalConductor(PartialElement1D):
    """Conduction: heat flow proportional to the difference of temperatures."""

    G: Real = parameter(unit="W/K", min=0.0, doc="Thermal conductance")

    def equations(self) -> Equations:
        yield self.Q_flow == self.G * self.dT


class ThermalResistor(PartialElement1D):
    """Conduction given by its thermal resistance; with R = 0 both temperatures are equal."""

    R: Real = parameter(unit="K/W", min=0.0, doc="Thermal resistance")

    def equations(self) -> Equations:
        yield self.dT == self.R * self.Q_flow


class Convection(Component):
    """Heat transfer between a solid and a fluid: Q_flow = Gc*(solid.T - fluid.T), with the conductance Gc as input."""

    solid: HeatPort = HeatPort()
    fluid: HeatPort = HeatPort()
    Gc: Real = signal_input(unit="W/K", doc="Convective conductance")
    Q_flow: Real = variable(unit="W", doc="Heat flow rate from solid to fluid")
    dT: Real = variable(unit="K", doc="Temperature difference solid.T - fluid.T")

    def equations(self) -> Equations:
        yield self.dT == self.solid.T - self.fluid.T
        yield self.solid.Q_flow == self.Q_flow
        yield self.fluid.Q_flow == -self.Q_flow
        yield self.Q_flow == self.Gc * self.dT


class BodyRadiation(PartialElement1D):
    """Radiation between two bodies: Q_flow = Gr*sigma*(port_a.T^4 - port_b.T^4)."""

    Gr: Real = parameter(unit="m2", min=0.0, doc="Net radiation conductance: area, emissivities and view factor")

    def equations(self) -> Equations:
        a, b = self.port_a.T, self.port_b.T
        yield self.Q_flow == self.Gr * quantity(STEFAN_BOLTZMANN, "W/(m2.K4)") * (a**4 - b**4)
