"""Linear circuit elements. Names and signs as in Modelica.Electrical.Analog.Basic."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, parameter, variable
from acausal.library.electrical.interfaces import PartialOnePort, PartialTwoPort, Pin


class Ground(Component):
    """Potential 0 V; every circuit needs one."""

    p: Pin = Pin()

    def equations(self) -> Equations:
        yield self.p.v == 0.0


class Resistor(PartialOnePort):
    """Linear resistor; a negative resistance is an active element."""

    R: Real = parameter(unit="Ohm", doc="Resistance")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.v == self.R * self.i
        yield self.loss_power == self.v * self.i


class Conductor(PartialOnePort):
    """Linear conductor; with G = 0 an open connection."""

    G: Real = parameter(unit="S", doc="Conductance")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.i == self.G * self.v
        yield self.loss_power == self.v * self.i


class Capacitor(PartialOnePort):
    """Linear capacitor; its start value is that of `v`."""

    C: Real = parameter(unit="F", min=0.0, doc="Capacitance")

    def equations(self) -> Equations:
        yield self.i == self.C * der(self.v)


class Inductor(PartialOnePort):
    """Linear inductor; its start value is that of `i`."""

    L: Real = parameter(unit="H", min=0.0, doc="Inductance")

    def equations(self) -> Equations:
        yield self.L * der(self.i) == self.v


class IdealTransformer(PartialTwoPort):
    """Transformer without losses and magnetisation: it transforms direct current, too."""

    n: Real = parameter(unit="1", doc="Turns ratio primary : secondary")

    def equations(self) -> Equations:
        yield self.v1 == self.n * self.v2
        yield self.i2 == -self.n * self.i1
