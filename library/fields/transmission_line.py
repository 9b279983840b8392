"""Electrical line of distributed inductance and capacitance."""

from __future__ import annotations

from acausal import Component, Equations, Real, as_expr, concatenate, der, fixed, parameter, structural, variable
from acausal.library.electrical.interfaces import Pin


class TransmissionLine(Component):
    """Telegrapher's equations: l*di/dt = -dv/dx - r*i, c*dv/dt = -di/dx - g*v, second order in the length of a section.

    Currents lie between voltages, half a section apart; half an inductance lies at either end. Without losses, waves
    travel at 1/sqrt(l*c) and are not reflected by loads of sqrt(l/c). Waves shorter than about ten sections lag behind.
    Names as in Modelica.Electrical.Analog.Lines.OLine.
    """

    N: int = structural(default=50, doc="Number of sections")
    length: Real = parameter(unit="m", default=1.0, min=0.0, doc="Length")
    r: Real = parameter(unit="Ohm/m", default=0.0, min=0.0, doc="Resistance per length")
    l: Real = parameter(unit="H/m", default=2.5e-7, min=0.0, doc="Inductance per length")  # noqa: E741  (MSL's name)
    g: Real = parameter(unit="S/m", default=0.0, min=0.0, doc="Conductance per length")
    c: Real = parameter(unit="F/m", default=1e-10, min=0.0, doc="Capacitance per length")

    v: Real = variable(
        shape=lambda self: self.N,
        unit="V",
        default=fixed(0.0),
        prefer_state=True,
        doc="Voltages of the sections to the reference",
    )
    i: Real = variable(
        shape=lambda self: self.N + 1,
        unit="A",
        default=fixed(0.0),
        prefer_state=True,
        doc="Currents between the sections, towards p2",
    )
    p1: Pin = Pin()
    p2: Pin = Pin()
    p3: Pin = Pin()

    def equations(self) -> Equations:
        dx = self.length / self.N
        v = concatenate(self.p1.v - self.p3.v, self.v, self.p2.v - self.p3.v)
        # Half an inductance at either end.
        share = as_expr([0.5, *[1.0] * (self.N - 1), 0.5])
        yield share * dx * (self.l * der(self.i) + self.r * self.i) == v[:-1] - v[1:]
        yield dx * (self.c * der(self.v) + self.g * self.v) == self.i[:-1] - self.i[1:]
        yield self.p1.i == self.i[0]
        yield self.p2.i == -self.i[-1]
        yield self.p1.i + self.p2.i + self.p3.i == 0.0
