"""Geometry of a drill in any convex workpiece (level 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from acausal import (
    Equations,
    Real,
    as_expr,
    der,
    dot,
    maximum,
    minimum,
    no_event,
    quantity,
    signal_output,
    structural,
    where,
)
from acausal.library.contact.collide.axis.crossing import crossing
from acausal.library.contact.collide.axis.edges import edge_distance
from acausal.library.contact.collide.axis.engaged import engaged
from acausal.library.contact.collide.shapes import Shape
from acausal.library.drilling.geometry import PartialDrillGeometry
from acausal.library.multibody.orientation import IDENTITY, Rotation, Vector, across, axes_rotation, checked_rotation

Pose = tuple[Vector, Rotation]


@dataclass(frozen=True)
class PlateLevel:
    """Level 0 of the drill geometry: a plate in closed form, `DrillGeometry`.

    Parameters
    ----------
    name
        Name of the workpiece in error messages.
    """

    name: str = "the material"


@dataclass(frozen=True)
class ConvexLevel:
    """Level 1 of the drill geometry: any convex workpiece, `ConvexDrillGeometry`.

    Parameters
    ----------
    shape
        Shape of the workpiece.
    pose
        Position [m], shape (3,), and rotation of the shape in frame_w.
    name
        Name of the workpiece in error messages.
    """

    shape: Shape
    pose: Pose = ((0.0, 0.0, 0.0), IDENTITY)
    name: str = "the workpiece"


class ConvexDrillGeometry(PartialDrillGeometry):
    """Level 1: a convex workpiece of any shape, entered and left through any of its faces.

    Collision detection by MPR is part of the equations: it decides whether the axis of the drill meets the workpiece,
    and finds the faces through which it enters and leaves. Depth and diameters are those of the tip behind these faces,
    along the axis; the usual penetration depth, along the shortest way out, would change its direction past the middle
    of the workpiece. Hence MPR's ray is the axis, which makes the faces unique
    (`library/contact/collide/axis/crossing.py`). Drilling begins when the tip passes the surface; if the axis of the
    drill misses the workpiece, `s` is the smaller of the depth and minus the distance from the workpiece.

    With a box of thickness t at `pose` (0, 0, t/2) it agrees with the analytic plate.
    """

    workpiece: Shape = structural(doc="Shape of the workpiece")
    pose: Pose = structural(
        default=((0.0, 0.0, 0.0), IDENTITY), doc="Position [m] and rotation of the shape in frame_w"
    )
    body: str = structural(default="the workpiece", doc="Name of the workpiece in errors")

    overlap: Real = signal_output(unit="m", doc="Depth of the tip behind the face, along `normal`")
    normal: Real = signal_output(unit="1", shape=3, doc="Normal of the face entered, into the workpiece, in frame_w")

    def build(self) -> None:
        super().build()
        self.workpiece.check(self.body)
        checked_rotation(self.pose[1], "pose[1]")

    def equations(self) -> Equations:
        r, R = quantity(self.pose[0], "m"), as_expr(self.pose[1])
        tip, axis = R.T @ (self.tip - r), R.T @ self.axis
        depth, beyond, beside, outward = crossing(self.workpiece)(tip, axis)
        # No contact starts beside the workpiece, so the depth stays away from zero there.
        missed = no_event(beside > 0.5)
        yield self.s == where(missed, minimum(depth, -edge_distance(self.workpiece)(tip, axis)), depth)
        yield self.s_exit == minimum(beyond, self.s)
        yield self.normal == -(R @ outward)
        # Velocity at the witness point, which equals the derivative of the search result and is cheaper.
        along = dot(self.normal, self.axis)
        yield self.v == dot(self.normal, der(self.tip) - der(self.axis) * self.s) / maximum(along, _STEEP)
        yield self.overlap == self.s * along
        yield from self.full_circle(engaged(self.workpiece)(tip, axis, *self.engagement), self.body)


_STEEP = math.sin(math.radians(1.0))


def shank_along_z(e: Vector) -> Rotation:
    """Rotation, shape (3, 3), that turns the z axis of a `PointedDrill`, which points to its shank, to -e.

    `e`: Unit vector from shank to tip, shape (3,).
    """
    one, two = across(e)
    return axes_rotation(two, one)
