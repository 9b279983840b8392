"""Dry friction that sticks: brake, clutch and bearing. Names as in Modelica.Mechanics.Rotational.

Stuck, the torque is whatever keeps the parts together, up to `tau0_max`; sliding, it is given by the speed. Which of
them holds is a finite state machine whose guards depend on accelerations, and these on all other friction elements: a
mixed system of equations, solved at events. `sa` runs along the characteristic: it is the torque while stuck and the
acceleration, shifted by `tau0_max`, while sliding.

Source: M. Otter, H. Elmqvist, S. E. Mattsson, Hybrid modeling in Modelica based on the synchronous data flow principle,
CACSD'99, Hawaii (1999); Modelica.Mechanics.Rotational.Interfaces.PartialFriction.
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
    initial,
    integer,
    maximum,
    no_event,
    parameter,
    pre,
    signal_input,
    structural,
    variable,
    where,
)
from acausal.library.blocks.tables import Points, checked_points, table
from acausal.library.rotational.interfaces import PartialCompliantWithRelativeStates, PartialTwoFlanges


class PartialFriction(Component):
    """Modes of a friction element; a subclass says what `w_relfric`, `a_relfric`, `tau0`, `tau0_max`, `free` are."""

    BACKWARD: ClassVar[int] = -1
    STUCK: ClassVar[int] = 0
    FORWARD: ClassVar[int] = 1
    FREE: ClassVar[int] = 2
    UNKNOWN: ClassVar[int] = 3

    w_small: Real = parameter(
        default=1e10,
        unit="rad/s",
        doc="Speed beyond which sliding turns round without sticking; small only where resets make the speed jump",
    )
    w_relfric: Real = variable(unit="rad/s", doc="Relative angular velocity of the surfaces")
    a_relfric: Real = variable(unit="rad/s2", doc="Relative angular acceleration of the surfaces")
    tau0: Real = variable(unit="N.m", doc="Friction torque at w_relfric = 0, sliding forward")
    tau0_max: Real = variable(unit="N.m", doc="Largest friction torque at w_relfric = 0, stuck")
    free: Real = boolean(doc="The element is not active")
    sa: Real = variable(unit="1", doc="Path: a torque [N.m] while stuck, else an acceleration [rad/s2]")
    startForward: Real = boolean(doc="w_relfric = 0, and sliding forward begins")
    startBackward: Real = boolean(doc="w_relfric = 0, and sliding backward begins")
    locked: Real = boolean(doc="w_relfric = 0, and nothing slides")
    mode: Real = integer(default=3, doc="-1 sliding backward, 0 stuck, 1 sliding forward, 2 free, 3 not known yet")

    def was(self, mode: int) -> Expr:
        """Condition that the element was in a mode; between events it still is."""
        return equals(pre(self.mode), mode)

    def equations(self) -> Equations:
        w, sa = self.w_relfric, 1.0 * self.sa  # without a unit: a torque and an acceleration
        forward, backward, stuck, idle = map(self.was, (self.FORWARD, self.BACKWARD, self.STUCK, self.FREE))
        # What does not count in a mode is kept away from its guard there: a stuck element whose speed is zero up to
        # rounding would make events for nothing, and so would the force on the path of a sliding one.
        path = where(stuck, sa, 0.0)
        breaks_forward = (path > self.tau0_max) | (pre(self.startForward) & (path > self.tau0))
        breaks_backward = (path < -self.tau0_max) | (pre(self.startBackward) & (path < -self.tau0))
        positive = where(forward | idle | self.startForward | initial(), w, -1.0 * self.w_small) > 0.0
        negative = where(backward | idle | self.startBackward | initial(), w, 1.0 * self.w_small) < 0.0
        yield self.startForward == (stuck & breaks_forward | backward & (w > self.w_small) | initial() & positive)
        yield self.startBackward == (stuck & breaks_backward | forward & (w < -self.w_small) | initial() & negative)
        yield self.locked == (~self.free & ~(forward | self.startForward | backward | self.startBackward))
        slides_forward = self.startForward | ~self.startBackward & forward
        shifted = where(slides_forward, sa - 1.0 * self.tau0_max, sa + 1.0 * self.tau0_max)
        yield self.a_relfric == where(self.locked, 0.0, where(self.free, sa, shifted))
        yield self.mode == where(
            self.free,
            self.FREE,
            where(
                (forward | idle | self.startForward) & positive,
                self.FORWARD,
                where((backward | idle | self.startBackward) & negative, self.BACKWARD, self.STUCK),
            ),
        )

    def characteristic(self, points: Points) -> Expr:
        """Torque or coefficient of friction from a table of the speed, with the sign of the motion."""
        backward = self.startBackward | ~self.startForward & ~self.was(self.FORWARD)
        magnitude = table(points, where(backward, -self.w_relfric, self.w_relfric), located=False)
        return where(backward, -magnitude, magnitude)


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
        checked_points(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        yield self.fn == self.fn_max * self.f_normalized
        yield self.tau0 == mu0 * self.cgeo * self.fn
        yield self.tau0_max == self.peak * self.tau0
        yield self.free == (self.fn <= 0.0)
        sliding = self.cgeo * self.fn * self.characteristic(self.mu_pos)
        yield self.tau == where(self.locked, 1.0 * self.sa, where(self.free, 0.0, sliding))
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
        checked_points(self.tau_pos)

    def equations(self) -> Equations:
        yield self.w_relfric == self.w
        yield self.a_relfric == self.a
        yield self.tau0 == table(self.tau_pos, as_expr(0.0))
        yield self.tau0_max == self.peak * self.tau0
        yield self.tau == where(self.locked, 1.0 * self.sa, self.characteristic(self.tau_pos))
        yield self.flange_a.tau + self.flange_b.tau - self.tau == 0.0
        yield self.loss_power == self.tau * self.w_relfric


class OneWayClutch(PartialCompliantWithRelativeStates):
    """Freewheel and clutch side by side: the relative speed `w_rel` cannot become negative.

    One element and not two, because two stuck ones in parallel would share the torque in no definite way. The start
    must have w_rel >= 0. Source: Modelica.Mechanics.Rotational.Components.OneWayClutch.
    """

    mu_pos: Points = structural(
        default=((0.0, 0.5),), doc="Coefficient of friction over speed: points (w_rel [rad/s], mu), w_rel >= 0"
    )
    peak: Real = parameter(default=1.0, unit="1", min=1.0, doc="Stuck torque over sliding torque at w_rel = 0")
    cgeo: Real = parameter(default=1.0, unit="m", min=0.0, doc="Sum of the effective radii of all surfaces")
    fn_max: Real = parameter(unit="N", min=0.0, doc="Largest normal force")
    w_small: Real = parameter(default=1e10, unit="rad/s", doc="Small only where resets make the speed jump")
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

    def build(self) -> None:
        checked_points(self.mu_pos)

    def equations(self) -> Equations:
        mu0 = table(self.mu_pos, as_expr(0.0))
        sa, w_rel = 1.0 * self.sa, self.w_rel
        # it would stay at the negative speed, as if that were zero
        yield assert_(
            ~initial() | no_event(w_rel >= -1e-9), "the start must have w_rel >= 0: flange_b ahead of flange_a"
        )
        yield self.a_rel == der(w_rel)
        yield self.free == (self.f_normalized <= 0.0)
        yield self.fn == where(self.free, 0.0, self.fn_max * self.f_normalized)
        yield self.tau0 == mu0 * self.cgeo * self.fn
        # above zero without a normal force too, so that the freewheel alone lets go by a margin
        least, peak = _HYSTERESIS * mu0 * self.cgeo * self.fn_max, maximum(self.peak, 1.0 + _HYSTERESIS)
        yield self.tau0_max == where(self.free, least, peak * self.tau0)
        lets_go = (sa > self.tau0_max) | (pre(self.startForward) & (sa > self.tau0)) | (w_rel > self.w_small)
        yield self.startForward == (pre(self.stuck) & lets_go | initial() & (w_rel > 0.0))
        yield self.locked == (pre(self.stuck) & ~self.startForward)
        yield self.mu == table(self.mu_pos, w_rel, located=False)
        yield self.a_rel == where(self.locked, 0.0, sa - 1.0 * self.tau0)
        yield self.tau == where(self.locked, sa, where(self.free, 0.0, self.mu * self.cgeo * self.fn))
        yield self.stuck == (self.locked | (w_rel <= 0.0))
        yield self.loss_power == where(self.stuck, 0.0, self.tau * w_rel)


_HYSTERESIS = 1e-4
