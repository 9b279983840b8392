"""Flange and the partial components of one-dimensional rotation.

Signs as in Modelica.Mechanics.Rotational: the cut torque `tau` of a flange is positive into the component;
the torque of a line element is positive when it reduces a positive twist `phi_rel`.
"""

from __future__ import annotations

from acausal import Component, Connector, Equations, Real, der, flow, variable
from acausal.library.translational.interfaces import Flange as TranslationalFlange


class Flange(Connector):
    """One-dimensional rotational flange."""

    phi: Real = variable(
        unit="rad",
        doc="Absolute angle of the flange",
        hint="is this flange connected to an inertia, to Fixed or to a Position source?",
    )
    tau: Real = flow(
        unit="N.m",
        doc="Cut torque directed into the component",
        hint="is the angle of this flange fixed twice, by two components such as Fixed or Position?",
    )


class PartialTwoFlanges(Component):
    """Component with two flanges."""

    flange_a: Flange = Flange()
    flange_b: Flange = Flange()


class PartialCompliant(PartialTwoFlanges):
    """Element without inertia whose torque depends on its twist."""

    phi_rel: Real = variable(unit="rad", doc="Twist: flange_b.phi - flange_a.phi")
    tau: Real = variable(unit="N.m", doc="Torque between the flanges: flange_b.tau")

    def equations(self) -> Equations:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.flange_b.tau == self.tau
        yield self.flange_a.tau == -self.tau


class PartialCompliantWithRelativeStates(PartialTwoFlanges):
    """Element without inertia whose torque depends on its twist and the rate of it."""

    phi_rel: Real = variable(unit="rad", prefer_state=True, doc="Twist: flange_b.phi - flange_a.phi")
    w_rel: Real = variable(unit="rad/s", prefer_state=True, doc="Rate of phi_rel")
    tau: Real = variable(unit="N.m", doc="Torque between the flanges: flange_b.tau")

    def equations(self) -> Equations:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.w_rel == der(self.phi_rel)
        yield self.flange_b.tau == self.tau
        yield self.flange_a.tau == -self.tau


class PartialTorque(Component):
    """Torque that acts on one flange and reacts on the ground."""

    flange: Flange = Flange()


class PartialRotationToTranslation(Component):
    """Element between a rotational and a translational flange; both supports are the ground."""

    flange_r: Flange = Flange()
    flange_t: TranslationalFlange = TranslationalFlange()


class PartialAbsoluteSensor(Component):
    """Device without inertia that measures the motion of a flange."""

    flange: Flange = Flange()

    def equations(self) -> Equations:
        yield self.flange.tau == 0.0


class PartialRelativeSensor(PartialTwoFlanges):
    """Device without inertia that measures between two flanges and transmits no torque."""

    def equations(self) -> Equations:
        yield self.flange_a.tau == 0.0
        yield self.flange_b.tau == 0.0


class PartialCutSensor(PartialTwoFlanges):
    """Device without inertia inserted into a connection."""

    def equations(self) -> Equations:
        yield self.flange_a.phi == self.flange_b.phi
        yield self.flange_a.tau + self.flange_b.tau == 0.0
