"""Dry friction with stiction: brake, guide, sliding mass between stops. Names as in Modelica.Mechanics.Translational.

The state machine is that of `blocks/dry_friction.py`.
"""

from __future__ import annotations

from acausal import (
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    der,
    exp,
    fabs,
    initial,
    integer,
    parameter,
    reset,
    signal_input,
    structural,
    unitless,
    variable,
    when,
    where,
)
from acausal.library.blocks.dry_friction import DryFriction, Surfaces, checked_friction
from acausal.library.blocks.tables import Points, table
from acausal.library.translational.interfaces import PartialRigid


class PartialFriction(DryFriction):
    """Element with dry friction; subclasses define `v_relfric`, `a_relfric`, `f0`, `f0_max` and `free`."""

    v_relfric: Real = variable(unit="m/s", doc="Relative velocity of the surfaces")
    a_relfric: Real = variable(unit="m/s2", doc="Relative acceleration of the surfaces")
    f0: Real = variable(unit="N", doc="Friction force at v_relfric = 0, sliding forward")
    f0_max: Real = variable(unit="N", doc="Largest friction force at v_relfric = 0, stuck")

    def surfaces(self) -> Surfaces:
        return Surfaces(self.v_relfric, self.a_relfric, self.f0_max)


class PartialGuided(PartialRigid):
    """Rod without mass on which a force acts that reacts on the ground."""

    v: Real = variable(unit="m/s", doc="Velocity")
    a: Real = variable(unit="m/s2", doc="Acceleration")

    def equations(self) -> Equations:
        yield self.v == der(self.s)
        yield self.a == der(self.v)


class Brake(PartialFriction, PartialGuided):
    """Brake: friction between a rod and the ground, pressed together by `fn_max*f_normalized`."""

    mu_pos: Points = structural(
        default=((0.0, 0.5),), doc="Coefficient of friction over speed: points (v [m/s], mu), v >= 0"
    )
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck force over sliding force at v = 0")
    cgeo: Real = parameter(
        default=1.0, unit="1", min=0.0, doc="Number of surfaces, weighted by their fraction of the force"
    )
    fn_max: Real = parameter(unit="N", min=0.0, doc="Largest normal force")
    f_normalized: Real = signal_input(unit="1", doc="Normal force over fn_max; none acts where it is not positive")
    fn: Real = variable(unit="N", doc="Normal force")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_friction(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        yield self.v_relfric == self.v
        yield self.a_relfric == self.a
        yield self.fn == self.fn_max * self.f_normalized
        yield self.f0 == mu0 * self.cgeo * self.fn
        yield self.f0_max == self.peak * self.f0
        yield self.free == (self.fn <= 0.0)
        yield from self.within(self.mu_pos)
        sliding = self.cgeo * self.fn * self.characteristic(self.mu_pos)
        yield self.f == where(self.locked, unitless(self.sa), where(self.free, 0.0, sliding))
        yield self.flange_a.f + self.flange_b.f - self.f == 0.0
        yield self.loss_power == self.f * self.v_relfric


class SupportFriction(PartialFriction, PartialGuided):
    """Friction in a guide, which does not depend on a normal force."""

    f_pos: Points = structural(default=((0.0, 1.0),), doc="Friction force over speed: points (v [m/s], f [N]), v >= 0")
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck force over sliding force at v = 0")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_friction(self.f_pos)

    def equations(self) -> Equations:
        yield self.v_relfric == self.v
        yield self.a_relfric == self.a
        yield self.f0 == table(self.f_pos, as_expr(0.0))
        yield self.f0_max == self.peak * self.f0
        yield from self.within(self.f_pos)
        yield self.f == where(self.locked, unitless(self.sa), self.characteristic(self.f_pos))
        yield self.flange_a.f + self.flange_b.f - self.f == 0.0
        yield self.loss_power == self.f * self.v_relfric


class MassWithStopAndFriction(PartialFriction, PartialRigid):
    """Sliding mass with Stribeck friction between two hard stops, where it comes to rest.

    Sliding forward the force is `F_prop*v + F_Coulomb + F_Stribeck*exp(-fexp*v)`; stuck it goes up to 1.001 times the
    value of this at v = 0.
    """

    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    F_prop: Real = parameter(default=1.0, unit="N.s/m", min=0.0, doc="Friction proportional to the velocity")
    F_Coulomb: Real = parameter(default=5.0, unit="N", min=0.0, doc="Constant friction")
    F_Stribeck: Real = parameter(default=10.0, unit="N", min=0.0, doc="Friction that decays with the velocity")
    fexp: Real = parameter(default=2.0, unit="s/m", min=0.0, doc="Rate of decay of F_Stribeck")
    smax: Real = parameter(default=25.0, unit="m", doc="Right stop, for the right end of the mass")
    smin: Real = parameter(default=-25.0, unit="m", doc="Left stop, for the left end of the mass")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Absolute velocity")
    a: Real = variable(unit="m/s2", doc="Absolute acceleration")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")
    stopped: Real = integer(doc="-1 at the left stop, 1 at the right stop, else 0")

    def may_move(self) -> tuple[Expr, Expr]:
        """Conditions under which motion forward, and backward, is not blocked by a stop."""
        half = self.L / 2.0
        return self.s < self.smax - half, self.s > self.smin + half

    def equations(self) -> Equations:
        yield assert_(self.smin + self.L <= self.smax, "the mass is longer than the distance between its stops")
        ahead, behind = self.may_move()
        half = self.L / 2.0
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.v_relfric == self.v
        yield self.a_relfric == self.a
        yield self.f0 == self.F_Coulomb + self.F_Stribeck
        yield self.f0_max == 1.001 * self.f0
        yield self.free == ((self.f0 <= 0.0) & (self.F_prop <= 0.0) & behind & ahead)
        yield self.m * self.a == self.flange_a.f + self.flange_b.f - self.f
        starts = self.startForward | self.startBackward
        dry = self.F_Coulomb + self.F_Stribeck * where(starts, 1.0, exp(-self.fexp * fabs(self.v)))
        sliding = self.F_prop * self.v + self.against_motion(dry)
        yield self.f == where(self.locked, unitless(self.sa), where(self.free, 0.0, sliding))
        yield self.loss_power == self.f * self.v_relfric
        yield self.stopped == where(self.s <= self.smin + half, -1.0, where(self.s >= self.smax - half, 1.0, 0.0))
        stop = where(self.stopped < 0.0, self.smin + half, self.smax - half)
        yield when((self.stopped < 0.0, self.stopped > 0.0), reset(self.s, stop), reset(self.v, 0.0))
        inside = (self.s >= self.smin + half) & (self.s <= self.smax - half)
        yield assert_(~initial() | inside, "the mass starts beyond one of its stops")
