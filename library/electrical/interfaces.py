"""Pin and the partial components of analog circuits.

Signs as in Modelica.Electrical.Analog: the current of a pin is positive into the component; the current `i`
of a two-pin component flows from `p` to `n` through it, and `v` is the potential of `p` relative to `n`.
"""

from __future__ import annotations

from acausal import Component, Connector, Equations, Real, flow, variable


class Pin(Connector):
    """Electrical pin. Positive and negative pins belong to this class and differ only in their names."""

    v: Real = variable(
        unit="V",
        doc="Potential at the pin",
        hint="no component fixes a potential in this circuit; add Ground and connect it to one pin",
    )
    i: Real = flow(
        unit="A",
        doc="Current flowing into the component",
        hint="is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?",
    )


class PartialOnePort(Component):
    """Component with two pins; the current that enters `p` leaves `n`."""

    p: Pin = Pin()
    n: Pin = Pin()
    v: Real = variable(unit="V", doc="Voltage drop p.v - n.v")
    i: Real = variable(unit="A", doc="Current from p to n")

    def equations(self) -> Equations:
        yield self.v == self.p.v - self.n.v
        yield self.p.i + self.n.i == 0.0
        yield self.i == self.p.i


class PartialTwoPort(Component):
    """Component with two ports of two pins."""

    p1: Pin = Pin()
    n1: Pin = Pin()
    p2: Pin = Pin()
    n2: Pin = Pin()
    v1: Real = variable(unit="V", doc="Voltage drop p1.v - n1.v")
    v2: Real = variable(unit="V", doc="Voltage drop p2.v - n2.v")
    i1: Real = variable(unit="A", doc="Current from p1 to n1")
    i2: Real = variable(unit="A", doc="Current from p2 to n2")

    def equations(self) -> Equations:
        yield self.v1 == self.p1.v - self.n1.v
        yield self.v2 == self.p2.v - self.n2.v
        yield self.p1.i + self.n1.i == 0.0
        yield self.p2.i + self.n2.i == 0.0
        yield self.i1 == self.p1.i
        yield self.i2 == self.p2.i
