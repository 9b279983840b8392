"""Boundary conditions of channels: of the first, the second and the third kind. An open port is a closed wall."""

from __future__ import annotations

from acausal import Component, Equations, Real, parameter
from acausal.library.fields.interfaces import ConcentrationPort


class FixedConcentration(Component):
    """Concentration at the end, whatever the flow (first kind, Dirichlet)."""

    port: ConcentrationPort = ConcentrationPort()
    c: Real = parameter(unit="mol/m3", doc="Concentration at the port")

    def equations(self) -> Equations:
        yield self.port.c == self.c


class FixedMolarFlow(Component):
    """Molar flow through the end, whatever the concentration (second kind, Neumann)."""

    port: ConcentrationPort = ConcentrationPort()
    n_flow: Real = parameter(unit="mol/s", doc="Molar flow rate out of this component, into the channel")

    def equations(self) -> Equations:
        yield self.port.n_flow == -self.n_flow


class ConcentrationExchange(Component):
    """Flow proportional to the difference from an outside concentration (third kind, Robin)."""

    port: ConcentrationPort = ConcentrationPort()
    k: Real = parameter(unit="m3/s", min=0.0, doc="Mass transfer coefficient times area")
    c: Real = parameter(unit="mol/m3", default=0.0, doc="Concentration outside")

    def equations(self) -> Equations:
        yield self.port.n_flow == self.k * (self.port.c - self.c)
