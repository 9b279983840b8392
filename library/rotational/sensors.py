"""Ideal sensors. Names and signs as in Modelica.Mechanics.Rotational.Sensors."""

from __future__ import annotations

from acausal import Equations, Real, der, signal_output, variable
from acausal.library.rotational.interfaces import PartialAbsoluteSensor, PartialCutSensor, PartialRelativeSensor


class AngleSensor(PartialAbsoluteSensor):
    """Absolute angle of the flange."""

    phi: Real = signal_output(unit="rad", doc="Angle")

    def equations(self) -> Equations:
        yield self.phi == self.flange.phi


class SpeedSensor(PartialAbsoluteSensor):
    """Absolute angular velocity of the flange."""

    w: Real = signal_output(unit="rad/s", doc="Angular velocity")

    def equations(self) -> Equations:
        yield self.w == der(self.flange.phi)


class AccSensor(PartialAbsoluteSensor):
    """Absolute angular acceleration of the flange."""

    w: Real = variable(unit="rad/s", doc="Angular velocity")
    a: Real = signal_output(unit="rad/s2", doc="Angular acceleration")

    def equations(self) -> Equations:
        yield self.w == der(self.flange.phi)
        yield self.a == der(self.w)


class RelAngleSensor(PartialRelativeSensor):
    """Twist between two flanges."""

    phi_rel: Real = signal_output(unit="rad", doc="flange_b.phi - flange_a.phi")

    def equations(self) -> Equations:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi


class RelSpeedSensor(PartialRelativeSensor):
    """Relative angular velocity of two flanges."""

    phi_rel: Real = variable(unit="rad", doc="flange_b.phi - flange_a.phi")
    w_rel: Real = signal_output(unit="rad/s", doc="Rate of phi_rel")

    def equations(self) -> Equations:
        yield self.phi_rel == self.flange_b.phi - self.flange_a.phi
        yield self.w_rel == der(self.phi_rel)


class TorqueSensor(PartialCutSensor):
    """Cut torque between two flanges: `tau = flange_a.tau`."""

    tau: Real = signal_output(unit="N.m", doc="Torque transmitted from flange_a to flange_b")

    def equations(self) -> Equations:
        yield self.tau == self.flange_a.tau


class PowerSensor(PartialCutSensor):
    """Power that flows from flange_a to flange_b."""

    power: Real = signal_output(unit="W", doc="flange_a.tau * angular velocity")

    def equations(self) -> Equations:
        yield self.power == self.flange_a.tau * der(self.flange_a.phi)
