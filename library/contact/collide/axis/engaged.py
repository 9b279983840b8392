"""Engagement of a drill's cone in a shape, compared with that assumed by a force law, as a function for equations.

    room = engaged(Box((0.1, 0.1, 0.05)))(tip, axis, s, s_exit, d, slope)

Point `tip` [m] and unit vector `axis` of the drill are in the axes of the shape; `s` and `s_exit` [m] are the depths of
the tip behind entry and exit along the axis, `d` [m] the diameter, `slope` the tangent of half the point angle. A force
law for a flat face across the axis assumes that the cut is a ring between the circles of these two depths. Here the
lines of the cone from the tip to the rim are intersected with the shape: their parts inside, averaged over the
directions around the axis, give the width and the area of the real cut of a turning drill. `room` is positive while
both agree with those of the ring up to the fraction `SHARE`, whatever is within the cut: an edge, a ridge, an apex, an
inclined or a curved face. The part of a line inside a convex shape is one interval, so it has no gaps; an edge between
two of the lines may cut off a hundredth unnoticed.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import Any

import numpy as np

from acausal import External
from acausal.library.contact.collide.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    HalfSpace,
    PointedDrill,
    Shape,
    Sphere,
)

SHARE = 0.05
"""Largest relative deviation of the width and the area of the real cut."""

_LINES = 12
_TINY = 1e-5
"""Width and area of a cut that count as none, relative to the diameter and its square."""
_PARALLEL = 1e-12
_FEW_FACES = 16

_UNITS = ("m", "1", "m", "m", "m", "1")
_LENGTHS = ((3,), (3,), (), (), (), ())


@lru_cache(maxsize=256)
def engaged(shape: Shape) -> External:
    """The function `(tip, axis, s, s_exit, d, slope) -> room`; the same object for equal shapes."""
    name = f"engaged_{type(shape).__name__.lower()}"
    made = partial(engaged_function, shape)
    return External(name, made, inputs=_LENGTHS, outputs=((),), units=("1",), jumps=True)


@lru_cache(maxsize=1)
def engaged_in_box() -> External:
    """The function `(tip, axis, s, s_exit, d, slope, half) -> room` in a box with half edge lengths `half` [m]."""
    return External("engaged_plate", _in_box, inputs=(*_LENGTHS, (3,)), outputs=((),), units=("1",), jumps=True)


@lru_cache(maxsize=256)
def engaged_function(shape: Shape) -> Any:
    """The CasADi Function of `engaged`."""
    import casadi as ca

    rows = _faces(shape)
    made: Any = ca.MX if rows is not None and len(rows) > _FEW_FACES else ca.SX
    given = _inputs(made)
    if rows is not None:
        low, high = _between(ca.DM(rows[:, :3]), ca.DM(rows[:, 3]), given[0], _cone(given[1], given[5]))
    else:
        low, high = _crossed(shape, given[0], _cone(given[1], given[5]))
    return _room(given, low, high)


def _in_box() -> Any:
    import casadi as ca

    given = _inputs(ca.SX)
    half = ca.SX.sym("half", 3)
    return _room([*given, half], *_in_slabs(half, given[0], _cone(given[1], given[5])))


def _inputs(made: Any) -> list[Any]:
    names = "tip", "axis", "s", "s_exit", "d", "slope"
    return [made.sym(name, 3 if name in ("tip", "axis") else 1) for name in names]


def _faces(shape: Shape) -> Any:
    """Faces of a polyhedral shape as (outward normal, offset), shape (m, 4); None for other shapes."""
    if isinstance(shape, HalfSpace):
        return np.array([[0.0, 0.0, 1.0, 0.0]])
    return shape.faces if isinstance(shape, ConvexHull) else None


def _cone(e: Any, slope: Any) -> Any:
    """Directions of the generating lines of a cone towards its tip, for its axis e; shape (3, n)."""
    import casadi as ca

    # T. Duff et al., Building an orthonormal basis, revisited, J. Computer Graphics Techniques 6 (2017).
    sense = ca.if_else(e[2] >= 0, 1.0, -1.0)
    a = -1 / (sense + e[2])
    b = e[0] * e[1] * a
    one = ca.vertcat(1 + sense * e[0] ** 2 * a, sense * b, -sense * e[0])
    two = ca.vertcat(b, sense + e[1] ** 2 * a, -e[1])
    angles = 2 * math.pi * np.arange(_LINES) / _LINES
    around = one @ ca.DM(np.cos(angles)).T + two @ ca.DM(np.sin(angles)).T
    return (ca.repmat(e, 1, _LINES) - slope * around) / ca.sqrt(1 + slope**2)


def _between(normals: Any, offsets: Any, tip: Any, g: Any) -> tuple[Any, Any]:
    """Distances back from the tip along lines g between which they are behind all faces, shapes (1, n)."""
    import casadi as ca

    steep, gap = normals @ g, normals @ tip - offsets
    ways = ca.repmat(gap, 1, _LINES) / ca.if_else(ca.fabs(steep) > _PARALLEL, steep, 1)
    outside = ca.repmat(gap > 0, 1, _LINES)
    low = ca.if_else(steep > _PARALLEL, ways, ca.if_else(ca.logic_and(steep >= -_PARALLEL, outside), _FAR, -_FAR))
    high = ca.if_else(steep < -_PARALLEL, ways, _FAR)
    columns = range(_LINES)
    return ca.horzcat(*(ca.mmax(low[:, k]) for k in columns)), ca.horzcat(*(ca.mmin(high[:, k]) for k in columns))


_FAR = 1e3


def _in_slabs(half: Any, tip: Any, g: Any) -> tuple[Any, Any]:
    """As `_between`, for a box: treating parallel faces in pairs halves the number of operations."""
    import casadi as ca

    per_length = 1 / ca.if_else(ca.fabs(g) > _PARALLEL, g, _PARALLEL)
    middle = ca.repmat(tip, 1, _LINES) * per_length
    room = ca.repmat(half, 1, _LINES) * ca.fabs(per_length)
    low, high = ca.vertsplit(middle - room), ca.vertsplit(middle + room)
    return ca.fmax(ca.fmax(*low[:2]), low[2]), ca.fmin(ca.fmin(*high[:2]), high[2])


def _crossed(shape: Shape, tip: Any, g: Any) -> tuple[Any, Any]:
    """As `_between`, for round shapes; a capsule is the union of a cylinder and two balls."""
    import casadi as ca

    if isinstance(shape, Box):
        return _in_slabs(ca.DM(shape.half), tip, g)
    if isinstance(shape, Capsule):
        high_end, low_end = (tip - ca.DM([0, 0, side * shape.length / 2]) for side in (1, -1))
        ball = Sphere(shape.radius)
        parts = [_chords(Cylinder(shape.radius, shape.length), tip, g)]
        parts += [_chords(ball, high_end, g), _chords(ball, low_end, g)]
        met = [low < high for low, high in parts]
        lows = [ca.if_else(there, low, _FAR) for there, (low, _) in zip(met, parts, strict=True)]
        highs = [ca.if_else(there, high, -_FAR) for there, (_, high) in zip(met, parts, strict=True)]
        return ca.fmin(lows[0], ca.fmin(*lows[1:])), ca.fmax(highs[0], ca.fmax(*highs[1:]))
    if isinstance(shape, Cone | PointedDrill):
        radius = shape.radius if isinstance(shape, Cone) else shape.diameter / 2
        end = shape.length if isinstance(shape, Cone) else shape.point_length
        low, high = _chords(Cylinder(radius, shape.length), tip - ca.DM([0, 0, shape.length / 2]), g)
        first, last = _in_cone(radius / end, tip, g)
        return ca.fmax(low, first), ca.fmin(high, last)
    return _chords(shape, tip, g)


def _chords(shape: Shape, tip: Any, g: Any) -> tuple[Any, Any]:
    import casadi as ca

    from acausal.library.contact.collide.axis.crossing import crossed

    # Grazing lines are included here; without them the cut would jump.
    found = [crossed(shape, tip, g[:, k]) for k in range(_LINES)]
    depth, beyond, hit = (ca.horzcat(*(f[k] for f in found)) for k in range(3))
    return beyond, ca.if_else(hit, depth, -_FAR)


def _in_cone(slope: float, tip: Any, g: Any) -> tuple[Any, Any]:
    """As `_between`, for an infinite cone about z with its apex at the origin: where across <= slope z."""
    import casadi as ca

    form = ca.diag([1.0, 1.0, -(slope**2)])
    square, linear = ca.sum1((form @ g) * g), (form @ tip).T @ g
    square = ca.if_else(ca.fabs(square) > _PARALLEL, square, _PARALLEL)
    middle = linear / square
    apart = middle**2 - ca.dot(tip, form @ tip) / square
    half = ca.sqrt(ca.fmax(apart, 1e-30))
    # A steep line meets both halves of the double cone, the valid one from here on; others meet one half or none.
    steep, up = square < 0, g[2, :] < 0
    one = ca.logic_and(apart > 0, tip[2] - middle * g[2, :] > 0)
    low = ca.if_else(steep, ca.if_else(up, middle + half, -_FAR), middle - half)
    high = ca.if_else(steep, ca.if_else(up, _FAR, middle - half), ca.if_else(one, middle + half, -_FAR))
    return low, high


def _room(given: list[Any], low: Any, high: Any) -> Any:
    """The Function `given -> room`; `low` and `high` bound the engaged part of each line."""
    import casadi as ca

    _, _, s, s_exit, d, slope = given[:6]
    # Component across the axis of a unit length along a line of the cone.
    across = slope / ca.sqrt(1 + slope**2)
    inner = ca.fmin(ca.fmax(across * low, 0), d / 2)
    outer = ca.fmax(ca.fmin(across * high, d / 2), inner)
    cone, thickness = d / 2 / slope, ca.fmax(s - s_exit, 0)
    width, area = _ring(slope, ca.fmin(ca.fmax(s, 0), cone), ca.fmin(ca.fmax(s_exit, 0), cone))
    # As the drill comes out the cut vanishes; deviations are therefore relative to that of the fully engaged cone.
    deep = ca.fmin(ca.fmax(s, 0), cone)
    most_width, most_area = _ring(slope, deep, ca.fmax(deep - thickness, 0))
    wide = SHARE * most_width + _TINY * d - ca.fabs(ca.sum2(outer - inner) / _LINES - width)
    large = SHARE * most_area + _TINY * d**2 - ca.fabs(ca.sum2(outer**2 - inner**2) / _LINES - area)
    return ca.Function("engaged", given, [ca.fmin(wide / d, large / d**2)])


def _ring(slope: Any, outer: Any, inner: Any) -> tuple[Any, Any]:
    """Width [m], and area divided by pi [m2], of the ring that a cone cuts between two depths."""
    return slope * (outer - inner), slope**2 * (outer**2 - inner**2)
