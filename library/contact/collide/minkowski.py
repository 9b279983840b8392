"""The Minkowski difference of two shapes: its support points, and the points of the shapes that they come from.

All is in the frame of the first shape and divided by a length, so that coordinates are of order 1. `p` and `R` are the
position and the orientation of the second shape in that frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.library.contact.collide.shapes import Box, Inner, Shape, Vector

VERTEX = 11
"""Size of a vertex of the difference: the point, then its feature.

A feature is a point and the radius of the circle around z on which it lies, of each of the two shapes in its own frame.
"""

FLAT = 1e-6
"""Sine of the angle between a direction and the axis of a circle below which the whole disc is the support."""

_TINY = 1e-30


@dataclass(frozen=True)
class Core:
    """A shape without its margin, in units of some length: circles, half lengths if it is a box, and the inner body."""

    rings: Vector
    half: tuple[float, float, float] | None
    inner: Inner
    way_back: tuple[float, float] = (0.0, 0.0)

    @property
    def round(self) -> bool:
        """Whether there is a circle of positive radius."""
        return bool((self.rings[:, 3] > 0.0).any())

    @property
    def dimension(self) -> int:
        """0 for a point, 1 for a line, 3 for a body."""
        if self.round:
            return 3
        points = self.rings[:, :3]
        return int(np.linalg.matrix_rank(points - points[0], tol=1e-12))


def core(shape: Shape, unit: float) -> Core:
    """The core of a shape in units of a length [m]."""
    half = shape.half if isinstance(shape, Box) else None
    inner = shape.inner
    return Core(
        shape.rings / unit,
        None if half is None else (half[0] / unit, half[1] / unit, half[2] / unit),
        Inner(
            (inner.centre[0] / unit, inner.centre[1] / unit, inner.centre[2] / unit),
            (inner.half[0] / unit, inner.half[1] / unit, inner.half[2] / unit),
            None if inner.radius is None else inner.radius / unit,
        ),
        shape.way_back,
    )


def ring(body: Core, d: Any) -> Any:
    """The circle (4, 1) on which the support point of a core in direction d lies, in the frame of the shape."""
    if body.half is not None:
        return ca.vertcat(*(ca.copysign(h, d[k]) for k, h in enumerate(body.half)), 0)
    across = ca.sqrt(d[0] ** 2 + d[1] ** 2) if body.round else 0
    best = ca.SX(ca.DM(body.rings[0]))
    height = _height(body.rings[0], d, across)
    for row in body.rings[1:]:
        other = _height(row, d, across)
        best = ca.if_else(other > height, ca.SX(ca.DM(row)), best)
        height = ca.fmax(height, other)
    return best


def height(body: Core, d: Any) -> Any:
    """The support function of a core in direction d, also near an axis, where `on_ring` treats a disc as a point."""
    if body.half is not None:
        return sum((h * ca.fabs(d[k]) for k, h in enumerate(body.half)), ca.SX(0))
    across = ca.sqrt(d[0] ** 2 + d[1] ** 2) if body.round else 0
    best = _height(body.rings[0], d, across)
    for row in body.rings[1:]:
        best = ca.fmax(best, _height(row, d, across))
    return best


def _height(row: Vector, d: Any, across: Any) -> Any:
    terms = [float(c) * d[k] for k, c in enumerate(row[:3]) if c]
    if row[3]:
        terms.append(float(row[3]) * across)
    return sum(terms, ca.SX(0))


def on_ring(circle: Any, d: Any) -> Any:
    """The point (3, 1) of a circle farthest in direction d; its centre where d is along the axis."""
    square, flat = _across(d)
    scale = ca.if_else(flat, 0, circle[3] / ca.sqrt(square))
    return ca.vertcat(circle[0] + scale * d[0], circle[1] + scale * d[1], circle[2])


def curvature(circle: Any, d: Any) -> Any:
    """Derivative (3, 3) of `on_ring` with respect to d."""
    square, flat = _across(d)
    scale = ca.if_else(flat, 0, circle[3] / (square * ca.sqrt(square)))
    found = ca.SX(3, 3)
    found[0, 0], found[1, 1] = scale * d[1] ** 2, scale * d[0] ** 2
    found[0, 1] = found[1, 0] = -scale * d[0] * d[1]
    return found


def settled(half: Any, d: Any) -> Any:
    """Half a feature as a circle (4, 1): about z, or its point alone where d is along z and selects a whole disc."""
    point = ca.logic_or(_across(d)[1], half[3] <= 0)
    return ca.if_else(point, ca.vertcat(half[:3], 0), ca.vertcat(0, 0, half[2:]))


def _across(d: Any) -> tuple[Any, Any]:
    """Square of the component of d across z, 1 where d is along z; and whether it is."""
    square = d[0] ** 2 + d[1] ** 2
    flat = square <= FLAT**2 * ca.sumsqr(d)
    return ca.if_else(flat, 1, square), flat


@dataclass(frozen=True)
class Pair:
    """Two cores and the pose of the second in the frame of the first."""

    a: Core
    b: Core
    p: Any
    R: Any

    def support(self, d: Any) -> Any:
        """Vertex (11, 1) of the difference a - b farthest in direction d."""
        e = -(self.R.T @ d)
        circle_a, circle_b = ring(self.a, d), ring(self.b, e)
        a, b = on_ring(circle_a, d), on_ring(circle_b, e)
        return ca.vertcat(a - self.p - self.R @ b, a, circle_a[3], b, circle_b[3])

    def height(self, d: Any) -> Any:
        """The support function of the difference in direction d."""
        return height(self.a, d) + height(self.b, -(self.R.T @ d)) - ca.dot(d, self.p)

    def settled(self, vertex: Any, d: Any) -> Any:
        """The circles (8, 1) on which a vertex can move when direction d changes."""
        e = -(self.R.T @ d)
        return ca.vertcat(settled(vertex[3:7], d), settled(vertex[7:], e))

    def points(self, feature: Any, d: Any) -> tuple[Any, Any]:
        """Points on the circles of both shapes farthest in d and against it, in the frame of the first."""
        e = -(self.R.T @ d)
        return on_ring(feature[:4], d), self.p + self.R @ on_ring(feature[4:], e)

    def bend(self, feature: Any, d: Any) -> Any:
        """Derivative (3, 3) of the feature's point of the difference with respect to d."""
        e = -(self.R.T @ d)
        return curvature(feature[:4], d) + self.R @ curvature(feature[4:], e) @ self.R.T

    def tool(self) -> tuple[Any, tuple[float, float]] | None:
        """Direction (3, 1) from a to b in which a tool is drawn back, and the ratios `way_back`; None without one."""
        a, b = self.a.way_back, self.b.way_back
        if any(a) == any(b):
            return None
        return (ca.SX(ca.DM([0, 0, -1])), a) if any(a) else (self.R[:, 2], b)

    def aside(self) -> Any:
        """A direction (3, 1) across the axes of both shapes, which separates points and lines that coincide."""
        axis = self.R[:, 2]
        both = ca.cross(ca.DM([0, 0, 1]), axis)
        across = ca.sqrt(ca.sumsqr(both))
        if self.a.dimension == 0:  # a point on a line: across the line
            return self.R[:, 0]
        return ca.if_else(across > 1e-9, both / ca.fmax(across, 1e-9), ca.DM([1, 0, 0]))

    def inner(self) -> Any:
        """A point inside the difference from which the origin is seen through the nearest faces, (3, 1).

        It is the difference of the points of the two inner bodies that are nearest to each other, found by alternating
        projections; from the difference of the centres, as published, the ray would leave a wide plate through its rim.
        Wide inner bodies are preferred as long as they are far enough apart to define a direction.
        """
        wide, deep = self._inner(True), self._inner(False)
        return ca.if_else(ca.sumsqr(wide) > 0.5 * ca.sumsqr(deep), wide, deep)

    def _inner(self, wide: bool) -> Any:
        a, b = ca.SX(3, 1), self.p + self.R @ ca.DM(self.b.inner.centre)
        for _ in range(2):
            a = _nearest(self.a.inner, wide, b)
            b = self.p + self.R @ _nearest(self.b.inner, wide, self.R.T @ (a - self.p))
        return a - b


def _nearest(inner: Inner, wide: bool, y: Any) -> Any:
    half, radius = inner.reduced(wide)
    centre = ca.DM(inner.centre)
    d = y - centre
    if radius is None:
        return centre + ca.vertcat(*(ca.fmin(ca.fmax(d[k], -h), h) for k, h in enumerate(half)))
    scale = ca.fmin(1, radius / ca.sqrt(d[0] ** 2 + d[1] ** 2 + _TINY))
    return centre + ca.vertcat(scale * d[0], scale * d[1], ca.fmin(ca.fmax(d[2], -half[2]), half[2]))
