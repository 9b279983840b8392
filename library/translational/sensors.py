"""Ideal sensors. Names and signs as in Modelica.Mechanics.Translational.Sensors."""

from __future__ import annotations

from acausal import Equations, Real, der, signal_output, variable
from acausal.library.translational.interfaces import PartialAbsoluteSensor, PartialCutSensor, PartialRelativeSensor


class PositionSensor(PartialAbsoluteSensor):
    """Absolute position of the flange."""

    s: Real = signal_output(unit="m", doc="Position")

    def equations(self) -> Equations:
        yield self.s == self.flange.s


class SpeedSensor(PartialAbsoluteSensor):
    """Absolute velocity of the flange."""

    v: Real = signal_output(unit="m/s", doc="Velocity")

    def equations(self) -> Equations:
        yield self.v == der(self.flange.s)


class AccSensor(PartialAbsoluteSensor):
    """Absolute acceleration of the flange."""

    v: Real = variable(unit="m/s", doc="Velocity")
    a: Real = signal_output(unit="m/s2", doc="Acceleration")

    def equations(self) -> Equations:
        yield self.v == der(self.flange.s)
        yield self.a == der(self.v)


class RelPositionSensor(PartialRelativeSensor):
    """Distance of two flanges."""

    s_rel: Real = signal_output(unit="m", doc="flange_b.s - flange_a.s")

    def equations(self) -> Equations:
        yield self.s_rel == self.flange_b.s - self.flange_a.s


class RelSpeedSensor(PartialRelativeSensor):
    """Relative velocity of two flanges."""

    s_rel: Real = variable(unit="m", doc="flange_b.s - flange_a.s")
    v_rel: Real = signal_output(unit="m/s", doc="Rate of s_rel")

    def equations(self) -> Equations:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.v_rel == der(self.s_rel)


class ForceSensor(PartialCutSensor):
    """Cut force between two flanges: `f = flange_a.f`."""

    f: Real = signal_output(unit="N", doc="Force transmitted from flange_a to flange_b")

    def equations(self) -> Equations:
        yield self.f == self.flange_a.f


class PowerSensor(PartialCutSensor):
    """Power that flows from flange_a to flange_b."""

    power: Real = signal_output(unit="W", doc="flange_a.f * velocity")

    def equations(self) -> Equations:
        yield self.power == self.flange_a.f * der(self.flange_a.s)
