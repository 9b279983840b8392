"""Dry friction that sticks: brake, guide and sliding mass between stops. Names as in Modelica.Mechanics.Translational.

The state machine is that of `acausal.library.rotational.friction`, where it is explained, with `v`, `f` for `w`, `tau`.
"""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    boolean,
    der,
    equals,
    exp,
    fabs,
    initial,
    integer,
    parameter,
    pre,
    reset,
    signal_input,
    structural,
    variable,
    when,
    where,
)
from acausal.library.blocks.tables import Points, checked_points, table
from acausal.library.translational.interfaces import PartialRigid


class PartialFriction(Component):
    """Modes of a friction element; a subclass says what `v_relfric`, `a_relfric`, `f0`, `f0_max`, `free` are.

    `may_move` gives the conditions under which it can begin to slide, and slide, forward and backward.
    """

    BACKWARD: ClassVar[int] = -1
    STUCK: ClassVar[int] = 0
    FORWARD: ClassVar[int] = 1
    FREE: ClassVar[int] = 2
    UNKNOWN: ClassVar[int] = 3

    v_small: Real = parameter(
        default=1e10,
        unit="m/s",
        doc="Speed beyond which sliding turns round without sticking; small only where resets make the speed jump",
    )
    v_relfric: Real = variable(unit="m/s", doc="Relative velocity of the surfaces")
    a_relfric: Real = variable(unit="m/s2", doc="Relative acceleration of the surfaces")
    f0: Real = variable(unit="N", doc="Friction force at v_relfric = 0, sliding forward")
    f0_max: Real = variable(unit="N", doc="Largest friction force at v_relfric = 0, stuck")
    free: Real = boolean(doc="The element is not active")
    sa: Real = variable(unit="1", doc="Path: a force [N] while stuck, else an acceleration [m/s2]")
    startForward: Real = boolean(doc="v_relfric = 0, and sliding forward begins")
    startBackward: Real = boolean(doc="v_relfric = 0, and sliding backward begins")
    locked: Real = boolean(doc="v_relfric = 0, and nothing slides")
    mode: Real = integer(default=3, doc="-1 sliding backward, 0 stuck, 1 sliding forward, 2 free, 3 not known yet")

    def was(self, mode: int) -> Expr:
        """Condition that the element was in a mode; between events it still is."""
        return equals(pre(self.mode), mode)

    def may_move(self) -> tuple[Expr | bool, Expr | bool]:
        """Conditions under which nothing stops a motion forward, and backward."""
        return True, True

    def equations(self) -> Equations:
        v, sa = self.v_relfric, 1.0 * self.sa  # without a unit: a force and an acceleration
        forward, backward, stuck, idle = map(self.was, (self.FORWARD, self.BACKWARD, self.STUCK, self.FREE))
        ahead, behind = self.may_move()
        # What does not count in a mode is kept away from its guard there: a stuck element whose speed is zero up to
        # rounding would make events for nothing, and so would the force on the path of a sliding one.
        path = where(stuck, sa, 0.0)
        breaks_forward = (path > self.f0_max) | (pre(self.startForward) & (path > self.f0))
        breaks_backward = (path < -self.f0_max) | (pre(self.startBackward) & (path < -self.f0))
        positive = where(forward | idle | self.startForward | initial(), v, -1.0 * self.v_small) > 0.0
        negative = where(backward | idle | self.startBackward | initial(), v, 1.0 * self.v_small) < 0.0
        yield self.startForward == (
            stuck & breaks_forward & ahead | backward & (v > self.v_small) | initial() & positive
        )
        yield self.startBackward == (
            stuck & breaks_backward & behind | forward & (v < -self.v_small) | initial() & negative
        )
        yield self.locked == (~self.free & ~(forward | self.startForward | backward | self.startBackward))
        slides_forward = self.startForward | ~self.startBackward & forward
        shifted = where(slides_forward, sa - 1.0 * self.f0_max, sa + 1.0 * self.f0_max)
        yield self.a_relfric == where(self.locked, 0.0, where(self.free, sa, shifted))
        yield self.mode == where(
            self.free,
            self.FREE,
            where(
                (forward | idle | self.startForward) & positive & ahead,
                self.FORWARD,
                where((backward | idle | self.startBackward) & negative & behind, self.BACKWARD, self.STUCK),
            ),
        )

    def against_motion(self, magnitude: Expr) -> Expr:
        """A magnitude with the sign of the motion."""
        backward = self.startBackward | ~self.startForward & ~self.was(self.FORWARD)
        return where(backward, -magnitude, magnitude)

    def characteristic(self, points: Points) -> Expr:
        """Force or coefficient of friction from a table of the speed, with the sign of the motion."""
        return self.against_motion(table(points, self.against_motion(self.v_relfric), located=False))


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
    cgeo: Real = parameter(default=1.0, unit="1", min=0.0, doc="Number of surfaces, by their share of the force")
    fn_max: Real = parameter(unit="N", min=0.0, doc="Largest normal force")
    f_normalized: Real = signal_input(unit="1", doc="Normal force over fn_max; none acts where it is not positive")
    fn: Real = variable(unit="N", doc="Normal force")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_points(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        yield self.v_relfric == self.v
        yield self.a_relfric == self.a
        yield self.fn == self.fn_max * self.f_normalized
        yield self.f0 == mu0 * self.cgeo * self.fn
        yield self.f0_max == self.peak * self.f0
        yield self.free == (self.fn <= 0.0)
        sliding = self.cgeo * self.fn * self.characteristic(self.mu_pos)
        yield self.f == where(self.locked, 1.0 * self.sa, where(self.free, 0.0, sliding))
        yield self.flange_a.f + self.flange_b.f - self.f == 0.0
        yield self.loss_power == self.f * self.v_relfric


class SupportFriction(PartialFriction, PartialGuided):
    """Friction in a guide, which does not depend on a normal force."""

    f_pos: Points = structural(default=((0.0, 1.0),), doc="Friction force over speed: points (v [m/s], f [N]), v >= 0")
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck force over sliding force at v = 0")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def build(self) -> None:
        checked_points(self.f_pos)

    def equations(self) -> Equations:
        yield self.v_relfric == self.v
        yield self.a_relfric == self.a
        yield self.f0 == table(self.f_pos, as_expr(0.0))
        yield self.f0_max == self.peak * self.f0
        yield self.f == where(self.locked, 1.0 * self.sa, self.characteristic(self.f_pos))
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
    F_Stribeck: Real = parameter(default=10.0, unit="N", min=0.0, doc="Friction that fades away with the velocity")
    fexp: Real = parameter(default=2.0, unit="s/m", min=0.0, doc="How fast F_Stribeck fades away")
    smax: Real = parameter(default=25.0, unit="m", doc="Right stop, for the right end of the mass")
    smin: Real = parameter(default=-25.0, unit="m", doc="Left stop, for the left end of the mass")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Absolute velocity")
    a: Real = variable(unit="m/s2", doc="Absolute acceleration")
    f: Real = variable(unit="N", doc="Friction force")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")
    stopped: Real = integer(doc="-1 at the left stop, 1 at the right stop, else 0")

    def may_move(self) -> tuple[Expr, Expr]:
        """Conditions under which no stop is in the way of a motion forward, and backward."""
        half = self.L / 2.0
        return self.s < self.smax - half, self.s > self.smin + half

    def equations(self) -> Equations:
        yield assert_(self.smin + self.L <= self.smax, "the mass is longer than the way between its stops")
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
        yield self.f == where(self.locked, 1.0 * self.sa, where(self.free, 0.0, sliding))
        yield self.loss_power == self.f * self.v_relfric
        yield self.stopped == where(self.s <= self.smin + half, -1.0, where(self.s >= self.smax - half, 1.0, 0.0))
        stop = where(self.stopped < 0.0, self.smin + half, self.smax - half)
        yield when((self.stopped < 0.0, self.stopped > 0.0), reset(self.s, stop), reset(self.v, 0.0))
        inside = (self.s >= self.smin + half) & (self.s <= self.smax - half)
        yield assert_(~initial() | inside, "the mass starts beyond one of its stops")
