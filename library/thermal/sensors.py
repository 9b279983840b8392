"""Ideal sensors of heat transfer. Names as in Modelica.Thermal.HeatTransfer.Sensors."""

from __future__ import annotations

from acausal import Component, Equations, Real, signal_output
from acausal.library.thermal.interfaces import HeatPort


class TemperatureSensor(Component):
    """Absolute temperature of a port; no heat flows."""

    port: HeatPort = HeatPort()
    T: Real = signal_output(unit="K", doc="Temperature of the port")

    def equations(self) -> Equations:
        yield self.port.Q_flow == 0.0
        yield self.T == self.port.T


class RelTemperatureSensor(Component):
    """Difference of two temperatures; no heat flows."""

    port_a: HeatPort = HeatPort()
    port_b: HeatPort = HeatPort()
    T_rel: Real = signal_output(unit="K", doc="port_a.T - port_b.T")

    def equations(self) -> Equations:
        yield self.port_a.Q_flow == 0.0
        yield self.port_b.Q_flow == 0.0
        yield self.T_rel == self.port_a.T - self.port_b.T


class HeatFlowSensor(Component):
    """Heat flow rate through a connection; both sides have the same temperature."""

    port_a: HeatPort = HeatPort()
    port_b: HeatPort = HeatPort()
    Q_flow: Real = signal_output(unit="W", doc="Heat flow rate from port_a to port_b")

    def equations(self) -> Equations:
        yield self.port_a.T == self.port_b.T
        yield self.port_a.Q_flow + self.port_b.Q_flow == 0.0
        yield self.Q_flow == self.port_a.Q_flow
