"""Dry friction with stiction as a finite state machine, shared by the friction elements of all mechanical libraries.

While stuck, the force is the one that keeps the relative speed at zero, up to a largest force; while sliding, it is a
function of the speed. The conditions for a change of mode depend on accelerations, and these on all other friction
elements: a mixed system of equations, solved at events. The path parameter `sa` is the force while stuck; while sliding
it is the acceleration, shifted by the largest force.

Source: M. Otter, H. Elmqvist, S. E. Mattsson, Hybrid modeling in Modelica based on the synchronous data flow principle,
CACSD'99, Hawaii (1999); Modelica.Mechanics.Rotational.Interfaces.PartialFriction.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    boolean,
    equals,
    infinitesimal,
    initial,
    integer,
    pre,
    unitless,
    variable,
    where,
)
from acausal.library.blocks.tables import Points, table


class Surfaces(NamedTuple):
    """Relative motion and limits of two surfaces: forces [N], or torques [N.m] if the speed is in rad/s.

    `small` is the speed above which a reversal does not stick, `most` the largest force while stuck.
    """

    speed: Expr
    acceleration: Expr
    small: Expr
    most: Expr


class DryFriction(Component):
    """Modes of a friction element; a subclass defines `surfaces`, and when the element is `free`."""

    BACKWARD: ClassVar[int] = -1
    STUCK: ClassVar[int] = 0
    FORWARD: ClassVar[int] = 1
    FREE: ClassVar[int] = 2
    UNKNOWN: ClassVar[int] = 3

    free: Real = boolean(doc="The element is not active")
    sa: Real = variable(unit="1", doc="Path: a force or torque while stuck, else an acceleration, all in SI units")
    startForward: Real = boolean(doc="The speed is zero, and sliding forward begins")
    startBackward: Real = boolean(doc="The speed is zero, and sliding backward begins")
    locked: Real = boolean(doc="The speed is zero, and nothing slides")
    mode: Real = integer(default=3, doc="-1 sliding backward, 0 stuck, 1 sliding forward, 2 free, 3 not known yet")

    def surfaces(self) -> Surfaces:
        """Speed, acceleration and limits of the surfaces."""
        raise NotImplementedError

    def may_move(self) -> tuple[Expr | bool, Expr | bool]:
        """Conditions under which motion forward, and backward, is not blocked by a stop."""
        return True, True

    def was(self, mode: int) -> Expr:
        """Condition that the element was in a mode before the event, or, between events, is in it."""
        return equals(pre(self.mode), mode)

    def equations(self) -> Equations:
        on, sa = self.surfaces(), unitless(self.sa)  # a force and an acceleration
        forward, backward, stuck, idle = map(self.was, (self.FORWARD, self.BACKWARD, self.STUCK, self.FREE))
        ahead, behind = self.may_move()
        # Guards that are irrelevant in a mode get constant arguments: otherwise rounding of the speed of a stuck
        # element, or the path parameter of a sliding one, would trigger events.
        path = where(stuck, sa, 0.0)
        # Of what begins to slide, the path is beyond `most` while it accelerates, and at it while others hold it. The
        # friction of sliding at speed zero is no bound for it, as in Modelica: an element with a peak would go on to
        # drag backward what the others move forward.
        breaks_forward, breaks_backward = path > on.most, path < -on.most
        positive = where(forward | idle | self.startForward | initial(), on.speed, -on.small) > 0.0
        negative = where(backward | idle | self.startBackward | initial(), on.speed, on.small) < 0.0
        yield self.startForward == (
            stuck & breaks_forward & ahead | backward & (on.speed > on.small) | initial() & positive
        )
        yield self.startBackward == (
            stuck & breaks_backward & behind | forward & (on.speed < -on.small) | initial() & negative
        )
        yield self.locked == (~self.free & ~(forward | self.startForward | backward | self.startBackward))
        slides_forward = self.startForward | ~self.startBackward & forward
        shifted = where(slides_forward, sa - unitless(on.most), sa + unitless(on.most))
        # zero while locked; the infinitesimal part makes the load shared by several elements on one shaft unique
        yield on.acceleration == where(self.locked, infinitesimal() * sa, where(self.free, sa, shifted))
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
        return self.against_motion(table(points, self.against_motion(self.surfaces().speed), located=False))
