"""Dry friction with stiction as a finite state machine, shared by the friction elements of all mechanical libraries.

While stuck, the force is the one that keeps the relative speed at zero, up to a largest force; while sliding, it is a
function of the speed. The conditions for a change of mode depend on accelerations, and these on all other friction
elements: a mixed system of equations, solved at events. The path parameter `sa` is the force while stuck; while sliding
it is the acceleration, shifted by the largest force.

Source: M. Otter, H. Elmqvist, S. E. Mattsson, Hybrid modeling in Modelica based on the synchronous data flow principle,
CACSD'99, Hawaii (1999); Modelica.Mechanics.Rotational.Interfaces.PartialFriction.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, isfinite
from typing import ClassVar, NamedTuple

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    after_reset,
    assert_,
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
from acausal.errors import DeclarationError
from acausal.library.blocks.tables import Points, checked_points, table


class Surfaces(NamedTuple):
    """Relative motion and limits of two surfaces: forces [N], or torques [N.m] if the speed is in rad/s.

    `most` is the largest force while stuck.
    """

    speed: Expr
    acceleration: Expr
    most: Expr


def checked_friction(points: Points) -> None:
    """Raise AC160 for an invalid table, and AC130 for one with negative friction, which would drive the motion."""
    known = checked_points(points)
    (x0, y0), (x1, y1) = known[0], known[min(1, len(known) - 1)]
    at_rest = y0 - x0 * (y1 - y0) / (x1 - x0) if len(known) > 1 else y0
    least = min(at_rest, *(y for _, y in known))
    if least < 0.0:
        raise DeclarationError(
            "AC130",
            f"friction over speed comes to {least:.6g}",
            cause="negative friction drives the motion instead of braking it",
            help="give values of at least 0 for speeds from 0 on; the direction of motion is accounted for",
        )


def reach(points: Iterable[tuple[float, float]], low: float = 0.0, high: float = inf) -> float:
    """Speed at which the line through the last two points leaves the values between `low` and `high`."""
    known = list(points)
    if len(known) < 2 or known[-2][1] == known[-1][1]:
        return inf
    (x0, y0), (x1, y1) = known[-2:]
    return x1 + ((high if y1 > y0 else low) - y1) * (x1 - x0) / (y1 - y0)


def within(speed: Expr, end: float, is_idle: Expr | bool = False) -> Equations:
    """Assert that a table of losses is not extrapolated so far that the line through its last points drives."""
    if isfinite(end):
        speed = unitless(speed)
        text = f"beyond {end:.6g} (SI) the line through the last points of the table of friction or losses gives power"
        yield assert_(
            (speed <= end) & (speed >= -end) | is_idle, f"{text}: give one more point, with the last value to hold it"
        )


class DryFriction(Component):
    """Modes of a friction element; a subclass defines `surfaces`, and when the element is `free`."""

    BACKWARD: ClassVar[int] = -1
    STUCK: ClassVar[int] = 0
    FORWARD: ClassVar[int] = 1
    FREE: ClassVar[int] = 2
    UNKNOWN: ClassVar[int] = 3

    free: Real = boolean(doc="The element is inactive")
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
        speed = unitless(on.speed)
        forward, backward, stuck, idle = map(self.was, (self.FORWARD, self.BACKWARD, self.STUCK, self.FREE))
        ahead, behind = self.may_move()
        # At the start, and where a reset makes the speed jump, it decides alone.
        anew = initial() | after_reset()
        # Guards that are irrelevant in a mode get constant arguments: otherwise rounding errors in the speed of a stuck
        # element, or the path parameter of a sliding one, would trigger events.
        path = where(stuck & ~anew, sa, 0.0)
        # When an element begins to slide, its path parameter exceeds `most` while it accelerates, and equals it while
        # other elements hold it. The friction of sliding at zero speed is not used as the bound, unlike in Modelica: an
        # element with a peak would then keep dragging backward what the others move forward.
        breaks_forward, breaks_backward = path > on.most, path < -on.most
        positive = where(forward | idle | self.startForward | anew, speed, -1.0) > 0.0
        negative = where(backward | idle | self.startBackward | anew, speed, 1.0) < 0.0
        yield self.startForward == (stuck & breaks_forward & ahead | anew & positive)
        yield self.startBackward == (stuck & breaks_backward & behind | anew & negative)
        yield self.locked == (~self.free & ~(forward | self.startForward | backward | self.startBackward))
        slides_forward = self.startForward | ~self.startBackward & forward
        shifted = where(slides_forward, sa - unitless(on.most), sa + unitless(on.most))
        # Zero while locked; the infinitesimal part makes the load shared by several elements on one shaft unique.
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

    def within(self, points: Points) -> Equations:
        """Assert that sliding is not so fast that the table, extrapolated linearly as in Modelica, becomes invalid."""
        yield from within(self.surfaces().speed, reach(points), self.free)

    def characteristic(self, points: Points) -> Expr:
        """Force or coefficient of friction from a table of the speed, with the sign of the motion."""
        return self.against_motion(table(points, self.against_motion(self.surfaces().speed), located=False))
