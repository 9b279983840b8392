"""Where two shapes touch: the points at which forces act, each with a depth and a normal.

A round body touches at one point; a box that lies on something touches at its corners. A single deepest point of a
face would jump from corner to corner with the slightest tilt, and no box would come to rest on it. Hence closed forms
with several points where faces lie on faces, and MPR (one point, any convex shapes) for everything else.

Which face, which corner: these relations are not events. The forces that follow from them are continuous.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from acausal import Expr, as_expr, clamp, dot, fabs, maximum, minimum, no_event, norm, sqrt, where
from acausal.library.contact.penetration import penetration
from acausal.library.contact.shapes import Box, Capsule, ConvexHull, HalfSpace, Shape, Sphere


@dataclass(frozen=True, eq=False)
class Touch:
    """One point of contact: depth [m], unit normal from a to b and place [m], both in world axes.

    `share` is the part of the point's force that counts: 1, less where a corner of one box slides over an edge of the
    other.
    """

    depth: Expr
    normal: Expr
    place: Expr
    share: Expr | None = None


Touches = Callable[[Expr, Expr, Expr, Expr], tuple[Touch, ...]]
"""`(r_a, R_a, r_b, R_b) -> points`: places [m] and rotations of the two shapes, as `Frame.r_0` and `Frame.R`."""


def touches(a: Shape, b: Shape) -> Touches:
    """How the shapes `a` and `b` touch: a closed form where there is one, else MPR."""
    for first, second, swapped in ((a, b, False), (b, a, True)):
        found = _closed_form(first, second)
        if found is not None:
            return _swapped(found) if swapped else found
    return _by_mpr(a, b)


def method(a: Shape, b: Shape) -> str:
    """What finds the contact of two shapes: "closed form" or "MPR"."""
    return "MPR" if _closed_form(a, b) is None and _closed_form(b, a) is None else "closed form"


def _closed_form(a: Shape, b: Shape) -> Touches | None:
    if isinstance(b, HalfSpace):
        points = _round_points(a)
        if points is not None:
            return lambda r_a, R_a, r_b, R_b: tuple(_on_plane(r_a, R_a, p, d, r_b, R_b) for p, d in points)
    if isinstance(a, Sphere) and isinstance(b, Sphere):
        radii = (a.radius, b.radius)
        return lambda r_a, R_a, r_b, R_b: (_spheres(r_a, r_b, *radii),)
    if isinstance(a, Sphere) and isinstance(b, Box):
        radius, half = a.radius, [s / 2 for s in b.size]
        return lambda r_a, R_a, r_b, R_b: (_sphere_in_box(r_a, r_b, R_b, radius, half),)
    if isinstance(a, Box) and isinstance(b, Box):
        sizes = (a.size, b.size)
        return lambda r_a, R_a, r_b, R_b: _boxes(r_a, R_a, r_b, R_b, *sizes)
    return None


def _round_points(a: Shape) -> list[tuple[tuple[float, ...], float]] | None:
    """Points in body axes [m] with a radius [m] whose hull is the shape; None when there are infinitely many."""
    if isinstance(a, Sphere):
        return [((0.0, 0.0, 0.0), a.radius)]
    if isinstance(a, Capsule):
        return [((0.0, 0.0, s * a.length / 2), a.radius) for s in (-1.0, 1.0)]
    if isinstance(a, Box):
        return [(tuple(s * length / 2 for s, length in zip(signs, a.size, strict=True)), 0.0) for signs in _CORNERS]
    if isinstance(a, ConvexHull) and len(a.points) <= _MOST_POINTS:
        return [(tuple(map(float, p)), 0.0) for p in a.points]
    return None


_CORNERS = tuple(product((-1.0, 1.0), repeat=3))
_MOST_POINTS = 32


def _on_plane(r_a: Expr, R_a: Expr, point: tuple[float, ...], radius: float, r_b: Expr, R_b: Expr) -> Touch:
    """A ball fixed to body a, on the half-space z <= 0 of b."""
    up = R_b @ as_expr((0.0, 0.0, 1.0))
    centre = r_a if not any(point) else r_a + R_a @ as_expr(point)
    height = dot(up, centre - r_b)
    depth = radius - height
    return Touch(depth, -up, centre - up * (height + depth / 2))


def _spheres(r_a: Expr, r_b: Expr, radius_a: float, radius_b: float) -> Touch:
    # Concentric spheres have no normal; a length that never is zero keeps the equations defined there.
    apart = r_b - r_a
    distance = norm(apart)
    normal = apart / maximum(distance, 1e-12)
    depth = radius_a + radius_b - distance
    return Touch(depth, normal, r_a + normal * (radius_a - depth / 2))


def _sphere_in_box(r_a: Expr, r_b: Expr, R_b: Expr, radius: float, half: list[float]) -> Touch:
    """A ball and the nearest point of a box; one whose centre is inside leaves through the nearest face."""
    centre = R_b.T @ (r_a - r_b)
    outside = as_expr([centre[k] - clamp(centre[k], -half[k], half[k]) for k in range(3)])
    # The tiny number keeps derivatives finite inside, where this branch is not used.
    distance = sqrt(dot(outside, outside) + 1e-30)
    sideways = outside / maximum(distance, 1e-12)
    x, y, z = (half[k] - fabs(centre[k]) for k in range(3))
    is_x, is_y = no_event((x <= y) & (x <= z)), no_event(y <= z)
    faces = (
        where(is_x, _sense(centre[0]), 0.0),
        where(is_x, 0.0, where(is_y, _sense(centre[1]), 0.0)),
        where(is_x, 0.0, where(is_y, 0.0, _sense(centre[2]))),
    )
    apart = no_event(distance > 1e-12)
    out = R_b @ as_expr([where(apart, sideways[k], faces[k]) for k in range(3)])
    height = where(apart, distance, -minimum(x, minimum(y, z)))
    depth = radius - height
    return Touch(depth, -out, r_a - out * (height + depth / 2))


def _sense(x: Expr) -> Expr:
    return where(no_event(x < 0), -1.0, 1.0)


def _boxes(
    r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr, size_a: tuple[float, ...], size_b: tuple[float, ...]
) -> tuple[Touch, ...]:
    """Corners of the two faces that lie on each other, pressed along the face normal with the smallest overlap.

    A corner that hangs over the other face is moved to the edge there: so two planks that cross touch at the four
    corners of the area they share. The normal belongs to the pair, not to a corner: with equal boxes on top of each
    other, all corners lie on edges. Two edges that cross away from all faces are pressed along a face normal too.
    """
    half_a, half_b = ([s / 2 for s in size] for size in (size_a, size_b))
    normal = _face_normal(r_a, R_a, r_b, R_b, half_a, half_b)
    margin = 0.02 * min(*half_a, *half_b)
    found = []
    for r, R, half, other_r, other_R, other, direction in (
        (r_a, R_a, half_a, r_b, R_b, half_b, normal),
        (r_b, R_b, half_b, r_a, R_a, half_a, -normal),
    ):
        along_own, along = R.T @ direction, other_R.T @ direction
        outward, first, second = _facing(R, along_own, half)
        across, _, _ = _facing(other_R, -along, other)
        for one, two in product((-1.0, 1.0), repeat=2):
            corner = r + outward + first * one + second * two
            seen = other_R.T @ (corner - other_r)
            shift = other_R @ as_expr([where(_pressed(along[k]), 0.0, _back(seen[k], other[k])) for k in range(3)])
            # Along the own face, which need not be parallel to the other; then from face to face, each a plane.
            slope = dot(outward, shift) / dot(outward, direction)
            point = corner + shift - direction * slope
            depth = dot(across, point - other_r - across) / dot(across, direction)
            place = point - direction * (depth / 2)
            share = _inside(R.T @ (place - r), along_own, half, margin)
            found.append(Touch(depth, normal, place, share))
    return tuple(found)


def _back(x: Expr, half: float) -> Expr:
    """What moves `x` into the interval from -half to half."""
    return clamp(x, -half, half) - x


def _pressed(along: Expr) -> Expr:
    """Whether an axis of a box is the one its face is pressed along."""
    return no_event(fabs(along) > 0.71)


def _facing(R: Expr, along: Expr, half: list[float]) -> tuple[Expr, Expr, Expr]:
    """From a box's centre to the face that looks along a direction, and half its edges [m], all in world axes."""
    columns = [as_expr([R[i, k] for i in range(3)]) * half[k] for k in range(3)]
    x, y, z = (fabs(along[k]) for k in range(3))
    is_x, is_y = no_event((x >= y) & (x >= z)), no_event(y >= z)
    sense = where(is_x, along[0], where(is_y, along[1], along[2]))

    def pick(of_x: Expr, of_y: Expr, of_z: Expr) -> Expr:
        return as_expr([where(is_x, of_x[i], where(is_y, of_y[i], of_z[i])) for i in range(3)])

    outward = pick(*columns) * _sense(sense)
    return outward, pick(columns[1], columns[2], columns[0]), pick(columns[2], columns[0], columns[1])


def _extent(direction: Expr, half: list[float]) -> Expr:
    """How far a box reaches from its centre along a direction in its own axes [m]."""
    return sum((fabs(direction[k]) * half[k] for k in range(3)), as_expr(0.0))


def _face_normal(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr, half_a: list[float], half_b: list[float]) -> Expr:
    """The normal of a face of either box along which they overlap least, from a to b."""
    apart = r_b - r_a
    best: Expr | None = None
    normal: Expr | None = None
    for own, R in enumerate((R_a, R_b)):
        for k in range(3):
            axis = as_expr([R[i, k] for i in range(3)])
            across = dot(axis, apart)
            sense = _sense(across)
            reach = half_a[k] + _extent(R_b.T @ axis, half_b) if own == 0 else half_b[k] + _extent(R_a.T @ axis, half_a)
            overlap = reach - fabs(across)
            if best is None or normal is None:
                best, normal = overlap, axis * sense
                continue
            # An equal overlap changes nothing: faces that lie on each other have two equal normals.
            nearer = no_event(overlap < best - _TIE)
            normal = as_expr([where(nearer, axis[i] * sense, normal[i]) for i in range(3)])
            best = where(nearer, overlap, best)
    assert normal is not None
    return normal


_TIE = 1e-9


def _inside(place: Expr, along: Expr, half: list[float], margin: float) -> Expr:
    """1 inside a box, seen along its pressed axis; falls to 0 within `margin` [m] beyond the other edges."""
    share: Expr = as_expr(1.0)
    for k in range(3):
        # The axis along the normal does not limit: how deep the point lies is another question.
        beyond = where(_pressed(along[k]), 0.0, clamp((fabs(place[k]) - half[k]) / margin, 0.0, 1.0))
        share = share * (1 - beyond * beyond * (3 - 2 * beyond))
    return share


def _by_mpr(a: Shape, b: Shape) -> Touches:
    find = penetration(a, b)

    def found(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr) -> tuple[Touch, ...]:
        depth, normal, point_a, point_b = find(r_a, R_a, r_b, R_b)
        return (Touch(depth, normal, (point_a + point_b) / 2),)

    return found


def _swapped(found: Touches) -> Touches:
    def turned(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr) -> tuple[Touch, ...]:
        return tuple(Touch(t.depth, -t.normal, t.place, t.share) for t in found(r_b, R_b, r_a, R_a))

    return turned
