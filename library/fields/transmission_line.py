"""Electrical line of distributed inductance and capacitance."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, fixed, parameter, part, structural, variable
from acausal.library.electrical.interfaces import Pin


class LineCapacitance(Component):
    """Voltage of one section."""

    v: Real = variable(unit="V", default=fixed(0.0), prefer_state=True, doc="Voltage to the reference")


class LineInductance(Component):
    """Current between two sections."""

    i: Real = variable(unit="A", default=fixed(0.0), prefer_state=True, doc="Current towards p2")


class TransmissionLine(Component):
    """Telegrapher's equations: l*di/dt = -dv/dx - r*i, c*dv/dt = -di/dx - g*v, second order in the length of a section.

    Currents lie between voltages, half a section apart; half an inductance lies at either end. Without losses waves run
    at 1/sqrt(l*c) without reflection into loads of sqrt(l/c). Waves shorter than about ten sections lag behind.
    Names as in Modelica.Electrical.Analog.Lines.OLine.
    """

    N: int = structural(default=50, doc="Number of sections")
    length: Real = parameter(unit="m", default=1.0, min=0.0, doc="Length")
    r: Real = parameter(unit="Ohm/m", default=0.0, min=0.0, doc="Resistance per length")
    l: Real = parameter(unit="H/m", default=2.5e-7, min=0.0, doc="Inductance per length")  # noqa: E741  (MSL's name)
    g: Real = parameter(unit="S/m", default=0.0, min=0.0, doc="Conductance per length")
    c: Real = parameter(unit="F/m", default=1e-10, min=0.0, doc="Capacitance per length")

    p1: Pin = Pin()
    p2: Pin = Pin()
    p3: Pin = Pin()
    capacitances: list[LineCapacitance] = part()
    inductances: list[LineInductance] = part()

    def build(self) -> None:
        self.capacitances = [LineCapacitance() for _ in range(self.N)]
        self.inductances = [LineInductance() for _ in range(self.N + 1)]

    def equations(self) -> Equations:
        dx = self.length / self.N
        voltages = [self.p1.v - self.p3.v, *(section.v for section in self.capacitances), self.p2.v - self.p3.v]
        currents = [section.i for section in self.inductances]
        for k, i in enumerate(currents):
            share = 0.5 if k in (0, self.N) else 1.0
            yield share * dx * (self.l * der(i) + self.r * i) == voltages[k] - voltages[k + 1]
        for k, section in enumerate(self.capacitances):
            yield dx * (self.c * der(section.v) + self.g * section.v) == currents[k] - currents[k + 1]
        yield self.p1.i == currents[0]
        yield self.p2.i == -currents[-1]
        yield self.p1.i + self.p2.i + self.p3.i == 0.0
