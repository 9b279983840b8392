"""Conduction of heat along a bar. Ports as in Modelica.Thermal.HeatTransfer."""

from __future__ import annotations

from acausal import Component, Equations, Real, concatenate, der, guess, parameter, structural, variable
from acausal.library.thermal.interfaces import HeatPort


class HeatBar(Component):
    """Bar of constant properties: rho*c*dT/dt = lambda*d2T/dx2, second order in the width of a cell.

    The conductance between neighbouring cells is lambda*A/dx, to each port twice that. An open port is insulated; a
    given temperature or heat flow, or exchange with the surroundings, at an end is modelled by connecting a
    `FixedTemperature`, `FixedHeatFlow` or `ThermalConductor` there.
    Source: S. V. Patankar, Numerical Heat Transfer and Fluid Flow (1980), section 4.2.
    """

    n: int = structural(default=50, doc="Number of cells")
    length: Real = parameter(unit="m", default=1.0, min=0.0, doc="Length")
    A: Real = parameter(unit="m2", default=1e-4, min=0.0, doc="Cross section")
    lambda_: Real = parameter(unit="W/(m.K)", default=50.0, min=0.0, doc="Thermal conductivity")
    rho: Real = parameter(unit="kg/m3", default=7850.0, min=0.0, doc="Density")
    c: Real = parameter(unit="J/(kg.K)", default=460.0, min=0.0, doc="Specific heat capacity")
    T_start: Real = parameter(
        shape=lambda self: self.n, unit="K", default=293.15, doc="Temperatures of the cells at the start"
    )
    T: Real = variable(
        shape=lambda self: self.n,
        unit="K",
        nominal=300.0,
        prefer_state=True,
        default=guess(293.15),
        doc="Mean temperatures of the cells",
    )

    port_a: HeatPort = HeatPort()
    port_b: HeatPort = HeatPort()

    def initial_equations(self) -> Equations:
        yield self.T == self.T_start

    def equations(self) -> Equations:
        C = self.rho * self.c * self.A * self.length / self.n
        G = self.lambda_ * self.A * self.n / self.length
        yield self.port_a.Q_flow == 2.0 * G * (self.port_a.T - self.T[0])
        yield self.port_b.Q_flow == 2.0 * G * (self.port_b.T - self.T[-1])
        # Heat flows through the n + 1 faces, towards port_b.
        between = (G * (self.T[:-1] - self.T[1:]),) if self.n > 1 else ()
        Q_flow = concatenate(self.port_a.Q_flow, *between, -self.port_b.Q_flow)
        yield C * der(self.T) == Q_flow[:-1] - Q_flow[1:]
