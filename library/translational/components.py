"""Masses, rods, springs and dampers. Names and signs as in Modelica.Mechanics.Translational.Components."""

from __future__ import annotations

from acausal import Component, Equations, Real, clamp, der, parameter, variable, where
from acausal.library.translational.interfaces import (
    Flange,
    PartialCompliant,
    PartialCompliantWithRelativeStates,
    PartialRigid,
)


class Fixed(Component):
    """Flange held at the position `s0`."""

    flange: Flange = Flange()
    s0: Real = parameter(default=0.0, unit="m", doc="Position of the flange")

    def equations(self) -> Equations:
        yield self.flange.s == self.s0


class Rod(PartialRigid):
    """Rigid rod without mass, of length L."""

    def equations(self) -> Equations:
        yield self.flange_a.f + self.flange_b.f == 0.0


class Mass(PartialRigid):
    """Sliding mass of length L; `s` is the position of its middle."""

    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Absolute velocity")
    a: Real = variable(unit="m/s2", doc="Absolute acceleration")

    def equations(self) -> Equations:
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.m * self.a == self.flange_a.f + self.flange_b.f


class Spring(PartialCompliant):
    """Linear spring: f = c*(s_rel - s_rel0), positive when it pulls."""

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness")
    s_rel0: Real = parameter(default=0.0, unit="m", doc="Unstretched length")

    def equations(self) -> Equations:
        yield self.f == self.c * (self.s_rel - self.s_rel0)


class Damper(PartialCompliantWithRelativeStates):
    """Linear damper."""

    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping constant")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.f == self.d * self.v_rel
        yield self.loss_power == self.f * self.v_rel


class SpringDamper(PartialCompliantWithRelativeStates):
    """Linear spring and linear damper side by side."""

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness")
    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping constant")
    s_rel0: Real = parameter(default=0.0, unit="m", doc="Unstretched length")
    f_c: Real = variable(unit="N", doc="Spring force")
    f_d: Real = variable(unit="N", doc="Damping force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.f_c == self.c * (self.s_rel - self.s_rel0)
        yield self.f_d == self.d * self.v_rel
        yield self.f == self.f_c + self.f_d
        yield self.loss_power == self.f_d * self.v_rel


class Backlash(PartialCompliantWithRelativeStates):
    """Spring and damper in parallel, in series with a backlash of total width `b`, within which there is no force.

    The magnitude of the damping force is limited to that of the spring force, so that the ends never pull.
    """

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness of the ends")
    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping constant of the ends")
    b: Real = parameter(default=0.0, unit="m", min=0.0, doc="Total play")
    s_rel0: Real = parameter(default=0.0, unit="m", doc="Distance in the middle of the backlash")
    f_c: Real = variable(unit="N", doc="Spring force")
    f_d: Real = variable(unit="N", doc="Damping force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        offset, half = self.s_rel - self.s_rel0, self.b / 2.0
        damping = self.d * self.v_rel
        beyond, below = offset > half, offset < -half
        yield self.f_c == self.c * where(beyond, offset - half, where(below, offset + half, 0.0))
        pushed = where(below, clamp(damping, self.f_c, -self.f_c), 0.0)
        yield self.f_d == where(beyond, clamp(damping, -self.f_c, self.f_c), pushed)
        yield self.f == self.f_c + self.f_d
        yield self.loss_power == self.f_d * self.v_rel


class ElastoGap(PartialCompliantWithRelativeStates):
    """Spring and damper that act only while the flanges are closer than `s_rel0`.

    The magnitude of the damping force is limited to that of the spring force, so that the contact never pulls.
    """

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness of the contact")
    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping constant of the contact")
    s_rel0: Real = parameter(default=0.0, unit="m", doc="Distance at which contact begins")
    f_c: Real = variable(unit="N", doc="Spring force, negative in contact")
    f_d: Real = variable(unit="N", doc="Damping force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.f_c == where(self.s_rel < self.s_rel0, self.c * (self.s_rel - self.s_rel0), 0.0)
        yield self.f_d == where(self.s_rel < self.s_rel0, clamp(self.d * self.v_rel, self.f_c, -self.f_c), 0.0)
        yield self.f == self.f_c + self.f_d
        yield self.loss_power == self.f_d * self.v_rel
