"""Boundary conditions of heat transfer. Names as in Modelica.Thermal.HeatTransfer.Sources."""

from __future__ import annotations

from acausal import Component, Equations, Real, parameter, signal_input
from acausal.library.thermal.interfaces import HeatPort


class FixedTemperature(Component):
    """Port of constant temperature."""

    port: HeatPort = HeatPort()
    T: Real = parameter(unit="K", min=0.0, doc="Temperature")

    def equations(self) -> Equations:
        yield self.port.T == self.T


class PrescribedTemperature(Component):
    """Port whose temperature is a signal."""

    port: HeatPort = HeatPort()
    T: Real = signal_input(unit="K", doc="Temperature")

    def equations(self) -> Equations:
        yield self.port.T == self.T


class PartialHeatFlow(Component):
    """Source of heat whose flow may rise with the temperature of its port, as losses in copper do."""

    port: HeatPort = HeatPort()
    T_ref: Real = parameter(default=293.15, unit="K", doc="Temperature at which the heat flow rate holds")
    alpha: Real = parameter(default=0.0, unit="1/K", doc="Relative rise of the heat flow rate with temperature")


class FixedHeatFlow(PartialHeatFlow):
    """Constant heat flow rate into the system."""

    Q_flow: Real = parameter(unit="W", doc="Heat flow rate out of the port, into what is connected, at T_ref")

    def equations(self) -> Equations:
        yield self.port.Q_flow == -self.Q_flow * (1.0 + self.alpha * (self.port.T - self.T_ref))


class PrescribedHeatFlow(PartialHeatFlow):
    """Heat flow rate into the system as a signal."""

    Q_flow: Real = signal_input(unit="W", doc="Heat flow rate out of the port, into what is connected, at T_ref")

    def equations(self) -> Equations:
        yield self.port.Q_flow == -self.Q_flow * (1.0 + self.alpha * (self.port.T - self.T_ref))
