"""Drill against any convex workpiece: level 1 of the drill's geometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

from acausal import (
    Equations,
    Expr,
    Real,
    as_expr,
    dot,
    maximum,
    minimum,
    no_event,
    signal_output,
    sqrt,
    structural,
    where,
)
from acausal.errors import DeclarationError
from acausal.library.contact.penetration import penetration
from acausal.library.contact.shapes import Box, ConvexHull, Cylinder, HalfSpace, PointedDrill, Shape, Sphere
from acausal.library.drilling.geometry import PartialDrillGeometry
from acausal.library.multibody.orientation import IDENTITY, Rotation, Vector, across, axes_rotation

Pose = tuple[Vector, Rotation]


@dataclass(frozen=True)
class PlateLevel:
    """Level 0 of the drill's geometry: a plate in closed form, `DrillGeometry`."""


@dataclass(frozen=True)
class ConvexLevel:
    """Level 1 of the drill's geometry: any convex workpiece, `ConvexDrillGeometry`.

    Parameters
    ----------
    shape
        Of the workpiece.
    pose
        Place [m] and rotation of the shape in frame_w.
    name
        How errors call the workpiece.
    """

    shape: Shape
    pose: Pose = ((0.0, 0.0, 0.0), IDENTITY)
    name: str = "the workpiece"


_NEVER = 1e3
"""Depth [m] at which a face that the axis does not cross is put: farther than any workpiece is thick."""


class ConvexDrillGeometry(PartialDrillGeometry):
    """Level 1: a convex workpiece of any shape, entered and left through any of its faces.

    Collision detection by MPR gives `overlap` and `normal`: whether, and along which direction, drill and workpiece
    overlap. Neither is what the force law needs: a penetration depth is measured along the normal of a face, and past
    the middle of the workpiece the shortest way out is another one. So depth and diameters come from where the axis
    of the drill enters and leaves the workpiece, exactly; they do not depend on the search, which is evaluated for the
    result only. Drilling begins when the tip passes the surface; a drill whose axis misses the workpiece is beside it.

    With a box of thickness t at `pose` (0, 0, t/2) it agrees with the analytic plate.
    """

    workpiece: Shape = structural(doc="Shape of the workpiece")
    pose: Pose = structural(default=((0.0, 0.0, 0.0), IDENTITY), doc="Place [m] and rotation of the shape in frame_w")
    drill: PointedDrill = structural(doc="Shape of the drill, for MPR")
    body: str = structural(default="the workpiece", doc="How errors call the workpiece")

    overlap: Real = signal_output(unit="m", doc="Penetration depth along `normal`, by MPR")
    normal: Real = signal_output(unit="1", shape=3, doc="From drill to workpiece, in world axes, by MPR")

    def build(self) -> None:
        super().build()
        self.workpiece.check(self.body)

    def equations(self) -> Equations:
        r, R = as_expr(self.pose[0]), as_expr(self.pose[1])
        place, direction = R.T @ (self.tip - r), R.T @ self.axis
        depth, beyond, beside = _crossed(self.workpiece, place, direction, self.body)
        # Beside it there is no contact to locate the beginning of.
        in_front = where(no_event(depth < 0), depth, 0.0)
        yield self.s == where(no_event(beside), in_front, depth)
        yield self.s_exit == minimum(beyond, self.s)
        a, w = self.frame_a, self.frame_w
        turned = a.R @ as_expr(shank_along_z(self._e))
        tip = a.r_0 + (a.R @ self._e) * self.length
        overlap, normal, _, _ = penetration(self.drill, self.workpiece)(tip, turned, w.r_0 + w.R @ r, w.R @ R)
        yield self.overlap == overlap
        yield self.normal == normal


def _crossed(shape: Shape, p: Expr, e: Expr, body: str) -> tuple[Expr, Expr, Expr]:
    """Depth of a point behind where a line enters a shape, and behind where it leaves it [m]; whether it misses.

    `p` and the unit vector `e` are in the axes of the shape.
    """
    faces = _faces(shape)
    if faces is not None:
        return _faces_crossed(faces, p, e)
    if isinstance(shape, Sphere):
        half, middle, missed = _chord(dot(p, e), dot(p, p) - shape.radius**2, as_expr(1.0))
        return middle + half, middle - half, missed
    if isinstance(shape, Cylinder):
        caps = _faces_crossed([((0.0, 0.0, s), shape.length / 2) for s in (-1.0, 1.0)], p, e)
        # The part across the axis; a line along the axis crosses no side.
        share = maximum(1 - e[2] * e[2], 1e-12)
        inside = p[0] * p[0] + p[1] * p[1] - shape.radius**2
        half, middle, missed = _chord(p[0] * e[0] + p[1] * e[1], inside, share)
        depth, beyond = minimum(caps[0], middle + half), maximum(caps[1], middle - half)
        return depth, beyond, caps[2] | missed | (beyond >= depth)
    raise DeclarationError(
        "AC173",
        f"{body}: a drill cannot enter a {type(shape).__name__}",
        help="give a Box, Cylinder, Sphere, HalfSpace or ConvexHull",
    )


def _chord(along: Expr, inside: Expr, share: Expr) -> tuple[Expr, Expr, Expr]:
    """Half the chord of a line in a circle, how far the point is beyond its middle [m], and whether they miss.

    They solve share x**2 - 2 along x + inside = 0 for the way x back to the circle.
    """
    middle = along / share
    square = middle * middle - inside / share
    return sqrt(maximum(square, 1e-30)), middle, square <= 0


def _faces(shape: Shape) -> list[tuple[Vector, float]] | None:
    """Faces of a polyhedron: outward normals and their distances from the origin [m]; None for round shapes."""
    if isinstance(shape, HalfSpace):
        return [((0.0, 0.0, 1.0), 0.0)]
    if isinstance(shape, Box):
        axes: list[Vector] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        return [
            ((s * n[0], s * n[1], s * n[2]), size / 2)
            for n, size in zip(axes, shape.size, strict=True)
            for s in (-1, 1)
        ]
    if isinstance(shape, ConvexHull):
        return _hull_faces(shape)
    return None


def _hull_faces(shape: ConvexHull) -> list[tuple[Vector, float]]:
    """Faces of a hull, each once: triangles of one plane are one face."""
    import numpy as np
    from scipy.spatial import ConvexHull as Hull

    equations = Hull(np.array(shape.points)).equations
    scale = float(np.abs(equations[:, 3]).max())
    keys = np.round(equations / [1.0, 1.0, 1.0, scale], 9)
    _, first = np.unique(keys, axis=0, return_index=True)
    rows = [[float(x) for x in equations[k]] for k in sorted(first)]
    return [((x, y, z), -offset) for x, y, z, offset in rows]


def _faces_crossed(faces: list[tuple[Vector, float]], p: Expr, e: Expr) -> tuple[Expr, Expr, Expr]:
    """As `_crossed`, for an intersection of half-spaces n p <= distance."""
    depth: Expr = as_expr(_NEVER)
    beyond: Expr = as_expr(-_NEVER)
    beside: Expr | None = None
    for n, distance in faces:
        below, slope = distance - dot(as_expr(n), p), dot(as_expr(n), e)
        # What stands along the axis is not crossed by it; the limits are constants, so nothing is divided by zero.
        entered = where(no_event(slope < -_STEEP), below / maximum(-slope, _STEEP), _NEVER)
        left = where(no_event(slope > _STEEP), -below / maximum(slope, _STEEP), -_NEVER)
        outside = (below < 0) & (slope >= -_STEEP) & (slope <= _STEEP)
        depth, beyond = minimum(depth, entered), maximum(beyond, left)
        beside = outside if beside is None else beside | outside
    assert beside is not None
    return depth, beyond, beside | (beyond > depth)


_STEEP = math.sin(math.radians(1.0))


def shank_along_z(e: Vector) -> Rotation:
    """Rotation that turns the z axis of a `PointedDrill`, which points to its shank, against `e`."""
    one, two = across(e)
    return axes_rotation(two, one)
