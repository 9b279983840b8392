"""Conduction of heat along a bar. Ports as in Modelica.Thermal.HeatTransfer."""

from __future__ import annotations

from itertools import pairwise

from acausal import Component, Equations, Real, der, guess, parameter, part, structural, variable
from acausal.library.thermal.interfaces import HeatPort


class HeatCell(Component):
    """One volume of a bar."""

    C: Real = parameter(unit="J/K", min=0.0, doc="Heat capacity")
    T_start: Real = parameter(unit="K", default=293.15, doc="Temperature at the start")
    T: Real = variable(unit="K", nominal=300.0, prefer_state=True, default=guess(293.15), doc="Mean temperature")
    Q_flow: Real = variable(unit="W", doc="Net heat flow rate into the cell")

    def initial_equations(self) -> Equations:
        yield self.T == self.T_start

    def equations(self) -> Equations:
        yield self.C * der(self.T) == self.Q_flow


class HeatBar(Component):
    """Bar of constant properties: rho*c*dT/dt = lambda*d2T/dx2, second order in the width of a cell.

    Between neighbours lambda*A/dx conducts, to each port twice that. An open port is insulated; temperature, heat flow
    and exchange with surroundings at an end are `FixedTemperature`, `FixedHeatFlow` and `ThermalConductor` there.
    Source: S. V. Patankar, Numerical Heat Transfer and Fluid Flow (1980), section 4.2.
    """

    n: int = structural(default=50, doc="Number of cells")
    length: Real = parameter(unit="m", default=1.0, min=0.0, doc="Length")
    A: Real = parameter(unit="m2", default=1e-4, min=0.0, doc="Cross section")
    lambda_: Real = parameter(unit="W/(m.K)", default=50.0, min=0.0, doc="Thermal conductivity")
    rho: Real = parameter(unit="kg/m3", default=7850.0, min=0.0, doc="Density")
    c: Real = parameter(unit="J/(kg.K)", default=460.0, min=0.0, doc="Specific heat capacity")
    T_start: Real = parameter(unit="K", default=293.15, doc="Temperature of all cells at the start")

    port_a: HeatPort = HeatPort()
    port_b: HeatPort = HeatPort()
    cells: list[HeatCell] = part()

    def build(self) -> None:
        C = self.rho * self.c * self.A * self.length / self.n
        self.cells = [HeatCell(C=C, T_start=self.T_start) for _ in range(self.n)]

    def equations(self) -> Equations:
        G = self.lambda_ * self.A * self.n / self.length
        first, last = self.cells[0], self.cells[-1]
        yield self.port_a.Q_flow == 2.0 * G * (self.port_a.T - first.T)
        yield self.port_b.Q_flow == 2.0 * G * (self.port_b.T - last.T)
        between = [G * (a.T - b.T) for a, b in pairwise(self.cells)]
        arriving = [self.port_a.Q_flow, *between]
        leaving = [*between, -self.port_b.Q_flow]
        for cell, here, there in zip(self.cells, arriving, leaving, strict=True):
            yield cell.Q_flow == here - there
