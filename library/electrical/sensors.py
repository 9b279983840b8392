"""Ideal sensors. Names as in Modelica.Electrical.Analog.Sensors."""

from __future__ import annotations

from acausal import Component, Equations, Real, signal_output
from acausal.library.electrical.interfaces import Pin


class PotentialSensor(Component):
    """Potential of a pin; no current flows."""

    p: Pin = Pin()
    phi: Real = signal_output(unit="V", doc="Potential relative to ground")

    def equations(self) -> Equations:
        yield self.p.i == 0.0
        yield self.phi == self.p.v


class VoltageSensor(Component):
    """Voltage between two pins; no current flows."""

    p: Pin = Pin()
    n: Pin = Pin()
    v: Real = signal_output(unit="V", doc="p.v - n.v")

    def equations(self) -> Equations:
        yield self.p.i == 0.0
        yield self.n.i == 0.0
        yield self.v == self.p.v - self.n.v


class CurrentSensor(Component):
    """Current in a branch; no voltage drops."""

    p: Pin = Pin()
    n: Pin = Pin()
    i: Real = signal_output(unit="A", doc="Current from p to n")

    def equations(self) -> Equations:
        yield self.p.v == self.n.v
        yield self.i == self.p.i
        yield self.p.i + self.n.i == 0.0
