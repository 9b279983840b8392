"""Algebraic blocks. Names as in Modelica.Blocks.Math."""

from __future__ import annotations

from acausal import Component, Equations, Real, parameter, signal_input, signal_output
from acausal.library.blocks.interfaces import PartialSI2SO, PartialSISO


class Gain(PartialSISO):
    """Input times a constant."""

    k: Real = parameter(doc="Gain")

    def equations(self) -> Equations:
        yield self.y == self.k * self.u


class Add(PartialSI2SO):
    """Weighted sum of two inputs."""

    k1: Real = parameter(default=1.0, doc="Gain of u1")
    k2: Real = parameter(default=1.0, doc="Gain of u2")

    def equations(self) -> Equations:
        yield self.y == self.k1 * self.u1 + self.k2 * self.u2


class Add3(Component):
    """Weighted sum of three inputs."""

    u1: Real = signal_input(doc="First input signal")
    u2: Real = signal_input(doc="Second input signal")
    u3: Real = signal_input(doc="Third input signal")
    y: Real = signal_output(doc="Output signal")
    k1: Real = parameter(default=1.0, doc="Gain of u1")
    k2: Real = parameter(default=1.0, doc="Gain of u2")
    k3: Real = parameter(default=1.0, doc="Gain of u3")

    def equations(self) -> Equations:
        yield self.y == self.k1 * self.u1 + self.k2 * self.u2 + self.k3 * self.u3


class Product(PartialSI2SO):
    """Product of two inputs."""

    def equations(self) -> Equations:
        yield self.y == self.u1 * self.u2


class Division(PartialSI2SO):
    """First input divided by the second."""

    def equations(self) -> Equations:
        yield self.y == self.u1 / self.u2


class Feedback(PartialSI2SO):
    """Set value minus measured value: `y = u1 - u2`."""

    def equations(self) -> Equations:
        yield self.y == self.u1 - self.u2
