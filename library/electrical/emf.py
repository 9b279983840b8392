"""Conversion of electrical into mechanical power. Names and signs as in Modelica.Electrical.Analog.Basic."""

from __future__ import annotations

from acausal import Equations, Real, der, parameter, variable
from acausal.library.electrical.interfaces import PartialOnePort
from acausal.library.rotational.interfaces import Flange as RotationalFlange
from acausal.library.translational.interfaces import Flange as TranslationalFlange


class RotationalEMF(PartialOnePort):
    """Ideal motor or generator: `v = k*w`, and the current drives the shaft with `k*i`; its housing is fixed."""

    flange: RotationalFlange = RotationalFlange()
    k: Real = parameter(unit="N.m/A", doc="Torque per current, and voltage per angular velocity")
    w: Real = variable(unit="rad/s", doc="Angular velocity of the flange")

    def equations(self) -> Equations:
        yield self.w == der(self.flange.phi)
        yield self.v == self.k * self.w
        yield self.flange.tau == -self.k * self.i


class TranslationalEMF(PartialOnePort):
    """Ideal voice coil: `v = k*velocity`, and the current pushes the flange with `k*i`; its housing is fixed."""

    flange: TranslationalFlange = TranslationalFlange()
    k: Real = parameter(unit="N/A", doc="Force per current, and voltage per velocity")
    velocity: Real = variable(unit="m/s", doc="Velocity of the flange")

    def equations(self) -> Equations:
        yield self.velocity == der(self.flange.s)
        yield self.v == self.k * self.velocity
        yield self.flange.f == -self.k * self.i
