"""Inertias, springs, dampers and gears. Names and signs as in Modelica.Mechanics.Rotational.Components."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, maximum, minimum, parameter, variable, where
from acausal.library.rotational.interfaces import (
    Flange,
    PartialCompliant,
    PartialCompliantWithRelativeStates,
    PartialRotationToTranslation,
    PartialTwoFlanges,
)


class Fixed(Component):
    """Flange held at the angle `phi0`."""

    flange: Flange = Flange()
    phi0: Real = parameter(default=0.0, unit="rad", doc="Angle of the flange")

    def equations(self) -> Equations:
        yield self.flange.phi == self.phi0


class Inertia(PartialTwoFlanges):
    """Rigid shaft with the moment of inertia J about its axis."""

    J: Real = parameter(unit="kg.m2", min=0.0, doc="Moment of inertia")
    phi: Real = variable(unit="rad", prefer_state=True, doc="Absolute angle")
    w: Real = variable(unit="rad/s", prefer_state=True, doc="Absolute angular velocity")
    a: Real = variable(unit="rad/s2", doc="Absolute angular acceleration")

    def equations(self) -> Equations:
        yield self.phi == self.flange_a.phi
        yield self.phi == self.flange_b.phi
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield self.J * self.a == self.flange_a.tau + self.flange_b.tau


class Spring(PartialCompliant):
    """Linear torsion spring: tau = c*(phi_rel - phi_rel0)."""

    c: Real = parameter(unit="N.m/rad", min=0.0, doc="Stiffness")
    phi_rel0: Real = parameter(default=0.0, unit="rad", doc="Untwisted angle")

    def equations(self) -> Equations:
        yield self.tau == self.c * (self.phi_rel - self.phi_rel0)


class Damper(PartialCompliantWithRelativeStates):
    """Linear torsion damper."""

    d: Real = parameter(unit="N.m.s/rad", min=0.0, doc="Damping constant")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.tau == self.d * self.w_rel
        yield self.loss_power == self.tau * self.w_rel


class SpringDamper(PartialCompliantWithRelativeStates):
    """Linear torsion spring and damper side by side."""

    c: Real = parameter(unit="N.m/rad", min=0.0, doc="Stiffness")
    d: Real = parameter(unit="N.m.s/rad", min=0.0, doc="Damping constant")
    phi_rel0: Real = parameter(default=0.0, unit="rad", doc="Untwisted angle")
    tau_c: Real = variable(unit="N.m", doc="Spring torque")
    tau_d: Real = variable(unit="N.m", doc="Damping torque")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.tau_c == self.c * (self.phi_rel - self.phi_rel0)
        yield self.tau_d == self.d * self.w_rel
        yield self.tau == self.tau_c + self.tau_d
        yield self.loss_power == self.tau_d * self.w_rel


class ElastoBacklash(PartialCompliantWithRelativeStates):
    """Spring and damper in parallel, in series with a backlash of total width `b`; the flanks never pull.

    With tau_c = c*(phi_diff -/+ b/2) and tau_d = d*w_rel the torque outside the backlash is tau_c + tau_d, with the
    magnitude of tau_d limited to that of tau_c, and 0 where it would pull.
    """

    c: Real = parameter(unit="N.m/rad", min=0.0, doc="Stiffness")
    d: Real = parameter(unit="N.m.s/rad", min=0.0, doc="Damping constant")
    b: Real = parameter(default=0.0, unit="rad", min=0.0, doc="Total play")
    phi_rel0: Real = parameter(default=0.0, unit="rad", doc="Twist in the middle of the backlash")
    phi_diff: Real = variable(unit="rad", doc="Twist measured from the middle of the backlash")

    def equations(self) -> Equations:
        yield self.phi_diff == self.phi_rel - self.phi_rel0
        half = self.b / 2.0
        damping = self.d * self.w_rel
        right, left = self.c * (self.phi_diff - half), self.c * (self.phi_diff + half)
        pushing_right = where(right + damping <= 0.0, 0.0, right + minimum(right, damping))
        pushing_left = where(left + damping >= 0.0, 0.0, left + maximum(left, damping))
        beyond_left = where(self.phi_diff < -half, pushing_left, 0.0)
        yield self.tau == where(self.phi_diff > half, pushing_right, beyond_left)


Backlash = ElastoBacklash
"""Alias with a shorter name."""


class IdealGear(PartialTwoFlanges):
    """Gear without losses and inertia, with its housing fixed to the ground: `flange_a.phi = ratio*flange_b.phi`."""

    ratio: Real = parameter(unit="1", doc="Transmission ratio flange_a.phi / flange_b.phi")

    def equations(self) -> Equations:
        yield self.flange_a.phi == self.ratio * self.flange_b.phi
        yield self.ratio * self.flange_a.tau + self.flange_b.tau == 0.0


class IdealGearWithSupport(PartialTwoFlanges):
    """Gear without losses and inertia whose housing is the flange `support`.

    It is a separate class rather than an option of IdealGear: an unconnected support would be free instead of fixed,
    and the gear would transmit no torque. So it has to be connected.
    """

    _to_be_connected = ("support",)

    support: Flange = Flange()
    ratio: Real = parameter(unit="1", doc="Transmission ratio, measured relative to the housing")

    def equations(self) -> Equations:
        a, b, housing = self.flange_a, self.flange_b, self.support
        yield a.phi - housing.phi == self.ratio * (b.phi - housing.phi)
        yield self.ratio * a.tau + b.tau == 0.0
        yield a.tau + b.tau + housing.tau == 0.0


class IdealGearR2T(PartialRotationToTranslation):
    """Gear from rotation to translation: `flange_r.phi = ratio*flange_t.s`."""

    ratio: Real = parameter(unit="rad/m", doc="Transmission ratio flange_r.phi / flange_t.s")

    def equations(self) -> Equations:
        yield self.flange_r.phi == self.ratio * self.flange_t.s
        yield self.ratio * self.flange_r.tau + self.flange_t.f == 0.0


class IdealRollingWheel(PartialRotationToTranslation):
    """Wheel without inertia that rolls without slip: `flange_t.s = radius*flange_r.phi`."""

    radius: Real = parameter(unit="m", min=0.0, doc="Radius of the wheel")

    def equations(self) -> Equations:
        yield self.flange_r.phi * self.radius == self.flange_t.s
        yield self.radius * self.flange_t.f + self.flange_r.tau == 0.0
