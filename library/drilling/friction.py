"""Friction of the drill apart from cutting: margins on the wall of the hole, and lateral motion of the tip.

Both use regularised Coulomb friction, mu N v / sqrt(v**2 + v_0**2) against the vector v of the sliding velocity: exact
in direction, with a stiff damper instead of stiction at rest (such laws are compared by J. Wojewoda et al., Phil.
Trans. R. Soc. A 366 (2008) 747-765).
"""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    cross,
    der,
    dot,
    maximum,
    parameter,
    signal_input,
    signal_output,
    sqrt,
    structural,
    tan,
)
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector


class PartialFriction(Component):
    """Position and motion of a drill relative to a plate, from DrillGeometry."""

    frame_a: Frame = Frame()
    frame_w: Frame = Frame()

    axis_a: Vector = structural(default=(0.0, 0.0, 1.0), doc="Direction from shank to tip, resolved in frame_a")
    mu: Real = parameter(default=0.0, unit="1", min=0.0, doc="Coefficient of friction")
    v_0: Real = parameter(
        default=1e-3, unit="m/s", min=0.0, doc="Sliding velocity at which the friction is 0.7 of its full value"
    )

    tip: Real = signal_input(unit="m", shape=3, doc="Tip, seen from frame_w and resolved there")
    axis: Real = signal_input(unit="1", shape=3, doc="Drill axis towards the tip, resolved in frame_w")
    omega: Real = signal_input(
        unit="rad/s", doc="Angular velocity of the drill relative to the plate, about the drill axis"
    )
    power: Real = signal_output(unit="W", doc="Power lost by this friction")

    def build(self) -> None:
        self._e = unit_vector(self.axis_a, "axis_a")


def inside(depth: Expr, beyond: Expr) -> Expr:
    """Length [m] within a workpiece of a line that ends `depth` behind its entry and `beyond` behind its exit."""
    return maximum(depth, 0.0) - maximum(beyond, 0.0)


class MarginFriction(PartialFriction):
    """Friction of the margins on the wall of the hole, along the axis and around it.

    The wall springs back onto the margins with the force `line_load` per length of margin in the hole, for all margins
    together. The friction has the direction of the helix on which the margins slide: nearly all of it is torque while
    the drill turns, and all of it is thrust when the drill is pulled out without turning. `length` is the length of
    drill along which the margins touch: because of the back taper, the contact ends farther up.

    Source: M. C. Shaw, C. J. Oxford, On the drilling of metals, Trans. ASME 79 (1957) 139-148, on the friction of the
    margins as the part of the torque that grows with the depth of the hole. The line load must be measured.
    """

    d: Real = parameter(unit="m", min=0.0, doc="Diameter of the drill")
    sigma: Real = parameter(unit="rad", min=0.0, max=math.pi, doc="Point angle of the drill")
    line_load: Real = parameter(
        default=0.0, unit="N/m", min=0.0, doc="Normal force of the wall per length of engaged margin"
    )
    length: Real = parameter(default=1.0, unit="m", min=0.0, doc="Length of the margins, from the corner up the drill")

    s: Real = signal_input(unit="m", doc="Depth of the tip behind the entry face, from DrillGeometry")
    s_exit: Real = signal_input(unit="m", doc="Depth of the tip behind the exit face, from DrillGeometry")
    engaged: Real = signal_output(unit="m", nominal=1e-2, doc="Length of the margins in the hole")
    F: Real = signal_output(unit="N", nominal=100.0, doc="Force on the drill along its axis, against its motion")
    torque: Real = signal_output(unit="N.m", nominal=1.0, doc="Torque on the drill, against its rotation")

    def equations(self) -> Equations:
        # From the corner, where the cone ends, to the upper end of the margins, limited to the workpiece.
        cone = self.d / (2 * tan(self.sigma / 2))
        yield self.engaged == inside(self.s - cone, self.s_exit - cone) - inside(
            self.s - cone - self.length, self.s_exit - cone - self.length
        )

        along = dot(self.axis, der(self.tip))
        around = self.omega * self.d / 2
        per_velocity = self.mu * self.line_load * self.engaged / sqrt(along**2 + around**2 + self.v_0**2)
        yield self.F == per_velocity * along
        yield self.torque == per_velocity * around * self.d / 2
        yield self.power == self.F * along + self.torque * self.omega

        a, w = self.frame_a, self.frame_w
        yield a.f == self.F * self._e
        yield a.t == self.torque * self._e
        yield w.f == -self.F * self.axis
        yield w.t == -self.torque * self.axis - cross(self.tip, self.F * self.axis)


class TipFriction(PartialFriction):
    """Friction against motion of the tip across the drill axis, under the thrust.

    A drill that does not turn sticks where it is pressed on; a turning one yields much more easily, since its edges
    already slide around the axis: the sliding velocity contains omega r at the mean radius r of the engaged edges. The
    torque of the edges is that of the cut and not repeated here.

    Source: P. Contensou, Couplage entre frottement de glissement et frottement de pivotement dans la théorie de la
    toupie, in: Kreiselprobleme, IUTAM Symposium Celerina 1962, Springer (1963) 201-216, in the simplest form: the
    whole contact at one radius, averaged over a turn.
    """

    length: Real = parameter(default=0.0, unit="m", doc="Distance from frame_a to the tip along the axis")
    thrust: Real = signal_input(unit="N", doc="Force between drill and plate along the axis")
    radius: Real = signal_input(unit="m", doc="Mean radius of the engaged edges")
    F: Real = signal_output(unit="N", shape=3, nominal=100.0, doc="Force on the plate, resolved in frame_w")

    def equations(self) -> Equations:
        v = der(self.tip)
        across = v - dot(self.axis, v) * self.axis
        around = self.omega * self.radius
        yield self.F == across * (self.mu * self.thrust / sqrt(dot(across, across) + around**2 + self.v_0**2))
        yield self.power == dot(self.F, across)

        a, w = self.frame_a, self.frame_w
        yield w.f == -self.F
        yield w.t == -cross(self.tip, self.F)
        yield a.f == a.R.T @ (w.R @ self.F)
        yield a.t == cross(self._e * self.length, a.f)
