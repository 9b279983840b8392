"""Heat port and the partial components of one-dimensional heat transfer.

Signs as in Modelica.Thermal.HeatTransfer: the heat flow rate `Q_flow` of a port is positive into the component; that of
an element between two ports flows from `port_a` to `port_b`.
"""

from __future__ import annotations

from acausal import Component, Connector, Equations, Real, flow, guess, variable


class HeatPort(Connector):
    """Thermal port."""

    T: Real = variable(
        unit="K",
        nominal=300.0,
        default=guess(293.15),
        doc="Temperature of the port",
        hint="is this port connected to a HeatCapacitor, or to a source of temperature?",
    )
    Q_flow: Real = flow(
        unit="W",
        doc="Heat flow rate into the component",
        hint="is the temperature of this port fixed twice, by two components such as FixedTemperature?",
    )


class PartialElement1D(Component):
    """Element between two ports that stores no heat."""

    port_a: HeatPort = HeatPort()
    port_b: HeatPort = HeatPort()
    Q_flow: Real = variable(unit="W", doc="Heat flow rate from port_a to port_b")
    dT: Real = variable(unit="K", doc="Temperature difference port_a.T - port_b.T")

    def equations(self) -> Equations:
        yield self.dT == self.port_a.T - self.port_b.T
        yield self.port_a.Q_flow == self.Q_flow
        yield self.port_b.Q_flow == -self.Q_flow
