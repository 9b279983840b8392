"""Relative position of drill and workpiece: depth, engaged diameters, rotation. Purely geometric, without forces.

Two levels of detail share their connectors: the analytic plate here, and any convex body in `geometry_convex.py`.
"""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    assert_,
    clamp,
    der,
    dot,
    fabs,
    maximum,
    no_event,
    parameter,
    quantity,
    signal_output,
    structural,
    tan,
    where,
    zeros,
)
from acausal.library.contact.collide.axis.engaged import engaged_in_box
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector


class PartialDrillGeometry(Component):
    """Depth of the drill in a workpiece, and the diameters between which it cuts.

    `frame_a` is fixed to the drill, its axis points from the shank to the tip; `frame_w` is fixed to the workpiece.
    Both may move and turn in any way. Subclasses define the depth of the tip and its rate.

    The depth `s` is measured along the drill axis, as the force law requires, not along the normal of the face, as a
    penetration depth in collision detection. A tip beside the workpiece is not in contact, however deep it is: `s` is
    then not positive. The diameters are those of a flat face perpendicular to the axis. If the width or the area of the
    real cut deviates from theirs by more than 5 %, the run has a note (AC191): when an edge, a ridge, a slope or a
    curved face lies within the cut, and when the axis misses the workpiece but the cone meets it.

    Source: founding paper, section 2 and Figure 3; the paper computes the same quantities by collision detection.
    """

    frame_a: Frame = Frame()
    frame_w: Frame = Frame()

    axis_a: Vector = structural(default=(0.0, 0.0, 1.0), doc="Direction from shank to tip, resolved in frame_a")
    d: Real = parameter(unit="m", min=0.0, doc="Diameter of the drill")
    sigma: Real = parameter(unit="rad", min=0.0, max=math.pi, doc="Point angle of the drill")
    length: Real = parameter(default=0.0, unit="m", doc="Distance from frame_a to the tip along the axis")

    tip: Real = signal_output(unit="m", shape=3, doc="Tip, seen from frame_w and resolved there")
    axis: Real = signal_output(unit="1", shape=3, doc="Drill axis towards the tip, resolved in frame_w")
    s: Real = signal_output(unit="m", doc="Depth of the tip behind the entry face, along the drill axis")
    s_exit: Real = signal_output(unit="m", doc="Depth of the tip behind the exit face, along the drill axis")
    v: Real = signal_output(unit="m/s", doc="Rate of the depth s, in front of and inside the workpiece")
    d_O: Real = signal_output(unit="m", doc="Outer diameter of the engaged part of the edges")
    d_I: Real = signal_output(unit="m", doc="Inner diameter of the engaged part of the edges")
    omega: Real = signal_output(
        unit="rad/s", doc="Angular velocity of the drill relative to the workpiece, about the drill axis"
    )
    n: Real = signal_output(unit="1/s", doc="Rotational speed, without sign")

    def build(self) -> None:
        self._e = unit_vector(self.axis_a, "axis_a")

    def equations(self) -> Equations:
        a, w = self.frame_a, self.frame_w
        yield self.axis == w.R.T @ (a.R @ self._e)
        yield self.tip == w.R.T @ (a.r_0 - w.r_0) + self.axis * self.length
        # One clamp covers free, entering, inside, leaving and through; kinks at s in {0, h_c, t, t + h_c}.
        slope = tan(self.sigma / 2)
        h_c = self.d / (2 * slope)
        yield self.d_O == 2 * slope * clamp(self.s, 0.0, h_c)
        yield self.d_I == 2 * slope * clamp(self.s_exit, 0.0, h_c)

        yield self.omega == dot(a.w, self._e) - dot(w.w, self.axis)
        yield self.n == fabs(self.omega) / (2 * math.pi)

        yield a.f == zeros(3)
        yield a.t == zeros(3)
        yield w.f == zeros(3)
        yield w.t == zeros(3)

    @property
    def engagement(self) -> tuple[Expr, Expr, Expr, Expr]:
        """The cut as assumed by the force model: depths behind entry and exit, diameter [m], slope of the cone."""
        return self.s, self.s_exit, self.d, tan(self.sigma / 2)

    def full_circle(self, room: Expr, body: str) -> Equations:
        """Note AC191 unless `room` is positive, i.e. if the cut is not the ring that the force model assumes."""
        yield assert_(
            room > 0,
            f"AC191: in {body} the cut of the drill is not a full ring: an edge, a ridge, a slope or a curved face "
            "lies within it, and its width or area differs by more than 5 % from that of a flat face across the axis, "
            "which the force assumes; if the axis misses the body, there is no force. Enter flat faces at a right "
            "angle, a radius of the drill away from their edges, and move sideways only above them",
            level="warning",
        )


class DrillGeometry(PartialDrillGeometry):
    """Level 0: a plate with parallel faces, in closed form.

    `frame_w` lies in the centre of the entry face, its z axis points into the plate.
    """

    max_tilt: float = structural(
        default=math.radians(60.0),
        doc="Angle between drill axis and face normal [rad] beyond which there is no contact",
    )
    body: str = structural(default="the plate", doc="Name of the plate in messages")
    t: Real = parameter(unit="m", min=0.0, doc="Thickness of the plate")
    width: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent of the plate along x of frame_w")
    height: Real = parameter(default=0.1, unit="m", min=0.0, doc="Extent of the plate along y of frame_w")

    def equations(self) -> Equations:
        # The constant lower limit avoids a division by zero if the drill is parallel to the plate.
        cos_min = math.cos(self.max_tilt)
        cos_tilt = maximum(self.axis[2], cos_min)
        depth = self.tip[2] / cos_tilt
        # Avoids `fabs`, whose kinks lie in the middle, where most drills are and rounding errors would decide.
        x, y, a, b = self.tip[0], self.tip[1], self.width / 2, self.height / 2
        beside = (x > a) | (-x > a) | (y > b) | (-y > b) | (self.axis[2] < cos_min)
        # No contact starts beside the plate, so s stays below zero there.
        in_front = where(no_event(depth < 0), depth, 0.0)
        yield self.s == where(no_event(beside), in_front, depth)
        yield self.s_exit == self.s - self.t / cos_tilt
        yield self.v == der(self.s)
        half = as_expr([self.width / 2, self.height / 2, self.t / 2])
        middle = self.tip - as_expr([quantity(0.0, "m"), quantity(0.0, "m"), self.t / 2])
        yield from self.full_circle(engaged_in_box()(middle, self.axis, *self.engagement, half), self.body)
