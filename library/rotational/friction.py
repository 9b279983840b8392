"""Dry friction with stiction: brake, clutch and bearing. Names as in Modelica.Mechanics.Rotational.

The state machine is that of `blocks/dry_friction.py`.
"""

from __future__ import annotations

from acausal import (
    Equations,
    Real,
    after_reset,
    as_expr,
    assert_,
    boolean,
    der,
    infinitesimal,
    initial,
    maximum,
    no_event,
    parameter,
    pre,
    signal_input,
    structural,
    unitless,
    variable,
    where,
)
from acausal.library.blocks.dry_friction import DryFriction, Surfaces, checked_friction, reach, within
from acausal.library.blocks.tables import Points, table
from acausal.library.rotational.interfaces import PartialCompliantWithRelativeStates, PartialTwoFlanges


class PartialFriction(DryFriction):
    """Element with dry friction; subclasses define `w_relfric`, `a_relfric`, `tau0`, `tau0_max` and `free`."""

    w_relfric: Real = variable(unit="rad/s", doc="Relative angular velocity of the surfaces")
    a_relfric: Real = variable(unit="rad/s2", doc="Relative angular acceleration of the surfaces")
    tau0: Real = variable(unit="N.m", doc="Friction torque at w_relfric = 0, sliding forward")
    tau0_max: Real = variable(unit="N.m", doc="Largest friction torque at w_relfric = 0, stuck")

    def surfaces(self) -> Surfaces:
        return Surfaces(self.w_relfric, self.a_relfric, self.tau0_max)


class PartialNormalForce(PartialFriction):
    """Friction between surfaces pressed together by `fn_max*f_normalized`."""

    mu_pos: Points = structural(
        default=((0.0, 0.5),), doc="Coefficient of friction over speed: points (w [rad/s], mu), w >= 0"
    )
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck torque over sliding torque at w_relfric = 0")
    cgeo: Real = parameter(default=1.0, unit="m", min=0.0, doc="Sum of the effective radii of all surfaces")
    fn_max: Real = parameter(unit="N", min=0.0, doc="Largest normal force")
    f_normalized: Real = signal_input(unit="1", doc="Normal force over fn_max; none acts where it is not positive")
    fn: Real = variable(unit="N", doc="Normal force")
    tau: Real = variable(unit="N.m", doc="Friction torque")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_friction(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        yield self.fn == self.fn_max * self.f_normalized
        yield self.tau0 == mu0 * self.cgeo * self.fn
        yield self.tau0_max == self.peak * self.tau0
        yield self.free == (self.fn <= 0.0)
        yield from self.within(self.mu_pos)
        sliding = self.cgeo * self.fn * self.characteristic(self.mu_pos)
        yield self.tau == where(self.locked, unitless(self.sa), where(self.free, 0.0, sliding))
        yield self.loss_power == self.tau * self.w_relfric


class PartialBetweenShaftAndGround(PartialTwoFlanges):
    """Shaft without inertia through both flanges, on which a torque acts that reacts on the ground."""

    phi: Real = variable(unit="rad", doc="Angle of the shaft")
    w: Real = variable(unit="rad/s", doc="Angular velocity of the shaft")
    a: Real = variable(unit="rad/s2", doc="Angular acceleration of the shaft")

    def equations(self) -> Equations:
        yield self.flange_a.phi == self.phi
        yield self.flange_b.phi == self.phi
        yield self.w == der(self.phi)
        yield self.a == der(self.w)


class Brake(PartialNormalForce, PartialBetweenShaftAndGround):
    """Brake: friction between a shaft and the ground."""

    def equations(self) -> Equations:
        yield self.w_relfric == self.w
        yield self.a_relfric == self.a
        yield self.flange_a.tau + self.flange_b.tau - self.tau == 0.0


class Clutch(PartialNormalForce, PartialCompliantWithRelativeStates):
    """Clutch: friction between two shafts."""

    a_rel: Real = variable(unit="rad/s2", doc="Rate of w_rel")

    def equations(self) -> Equations:
        yield self.a_rel == der(self.w_rel)
        yield self.w_relfric == self.w_rel
        yield self.a_relfric == self.a_rel


class BearingFriction(PartialFriction, PartialBetweenShaftAndGround):
    """Friction in the bearings of a shaft, which does not depend on a normal force."""

    tau_pos: Points = structural(
        default=((0.0, 1.0),), doc="Friction torque over speed: points (w [rad/s], tau [N.m]), w >= 0"
    )
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck torque over sliding torque at w = 0")
    tau: Real = variable(unit="N.m", doc="Friction torque")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_friction(self.tau_pos)

    def equations(self) -> Equations:
        yield self.w_relfric == self.w
        yield self.a_relfric == self.a
        yield self.tau0 == table(self.tau_pos, as_expr(0.0))
        yield self.tau0_max == self.peak * self.tau0
        yield from self.within(self.tau_pos)
        yield self.tau == where(self.locked, unitless(self.sa), self.characteristic(self.tau_pos))
        yield self.flange_a.tau + self.flange_b.tau - self.tau == 0.0
        yield self.loss_power == self.tau * self.w_relfric


class OneWayClutch(PartialCompliantWithRelativeStates):
    """Freewheel and clutch in parallel: the relative speed `w_rel` cannot become negative.

    They form one element because the distribution of torque between two stuck elements in parallel is undetermined. The
    initial `w_rel` must not be negative. Source: Modelica.Mechanics.Rotational.Components.OneWayClutch.
    """

    mu_pos: Points = structural(
        default=((0.0, 0.5),), doc="Coefficient of friction over speed: points (w_rel [rad/s], mu), w_rel >= 0"
    )
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck torque over sliding torque at w_rel = 0")
    cgeo: Real = parameter(default=1.0, unit="m", min=0.0, doc="Sum of the effective radii of all surfaces")
    fn_max: Real = parameter(unit="N", min=0.0, doc="Largest normal force")
    f_normalized: Real = signal_input(unit="1", doc="Normal force over fn_max; none acts where it is not positive")
    a_rel: Real = variable(unit="rad/s2", doc="Rate of w_rel")
    mu: Real = variable(unit="1", doc="Coefficient of friction")
    fn: Real = variable(unit="N", doc="Normal force")
    tau0: Real = variable(unit="N.m", doc="Friction torque at w_rel = 0, sliding")
    tau0_max: Real = variable(unit="N.m", doc="Largest friction torque at w_rel = 0, stuck")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")
    sa: Real = variable(unit="1", doc="Path: a torque [N.m] while stuck, else an acceleration [rad/s2]")
    free: Real = boolean(doc="The clutch is not pressed")
    startForward: Real = boolean(doc="w_rel = 0, and sliding begins")
    locked: Real = boolean(doc="w_rel = 0, and nothing slides")
    stuck: Real = boolean(doc="w_rel = 0: locked, or sliding begins")
    backward: Real = boolean(doc="The start, or a reset, has made w_rel negative, which ends the run")

    def build(self) -> None:
        checked_friction(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        sa, w_rel = unitless(self.sa), self.w_rel
        anew = initial() | after_reset()
        # A negative speed would be kept, as if it were zero.
        yield self.backward == (pre(self.backward) | anew & no_event(w_rel < -1e-9))
        yield assert_(~self.backward, "the start, or a reset, must have w_rel >= 0: flange_b ahead of flange_a")
        yield self.a_rel == der(w_rel)
        yield self.free == (self.f_normalized <= 0.0)
        yield self.fn == where(self.free, 0.0, self.fn_max * self.f_normalized)
        yield self.tau0 == mu0 * self.cgeo * self.fn
        # Positive even without a normal force, so that the freewheel alone releases with a margin.
        least, peak = _HYSTERESIS * mu0 * self.cgeo * self.fn_max, maximum(self.peak, 1.0 + _HYSTERESIS)
        yield self.tau0_max == where(self.free, least, peak * self.tau0)
        yield self.startForward == (pre(self.stuck) & (sa > self.tau0_max) | anew & (w_rel > 0.0))
        yield self.locked == (pre(self.stuck) & ~self.startForward)
        yield from within(w_rel, reach(self.mu_pos), self.free)
        yield self.mu == table(self.mu_pos, w_rel, located=False)
        yield self.a_rel == where(self.locked, infinitesimal() * sa, sa - unitless(self.tau0_max))
        yield self.tau == where(self.locked, sa, where(self.free, 0.0, self.mu * self.cgeo * self.fn))
        yield self.stuck == (self.locked | (w_rel <= 0.0))
        yield self.loss_power == where(self.stuck, 0.0, self.tau * w_rel)


_HYSTERESIS = 1e-4
