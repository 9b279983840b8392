"""Points at which two shapes touch and forces act, each with a depth and a normal.

A round body touches at one point; a box that lies on a surface touches at its corners. A single deepest point of a
face would jump from corner to corner with the slightest tilt, and no box would come to rest on it. Hence closed forms
with several points are used where faces lie on faces, and MPR (one point, any convex shapes) for everything else.

The relations that select a face or a corner are not events, because the resulting forces are continuous.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

from acausal import Expr, as_expr, clamp, dot, fabs, maximum, minimum, no_event, norm, quantity, sqrt, unitless, where
from acausal.library.contact.collide.penetration import penetration
from acausal.library.contact.collide.shapes import Box, Capsule, ConvexHull, HalfSpace, Shape, Sphere
from acausal.library.contact.manifold.boxes import boxes
from acausal.library.contact.manifold.point import Touch as Touch
from acausal.library.contact.manifold.point import sense

Touches = Callable[[Expr, Expr, Expr, Expr], tuple[Touch, ...]]
"""`(r_a, R_a, r_b, R_b) -> points`: positions [m] and rotations of the two shapes, as `Frame.r_0` and `Frame.R`."""


def touches(a: Shape, b: Shape) -> Touches:
    """The function that finds the points of contact of `a` and `b`: a closed form if there is one, else MPR."""
    found = _found(a, b)

    # The functions below compute with the sizes of the shapes, which are plain numbers without units.
    def in_metres(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr) -> tuple[Touch, ...]:
        metre = quantity(1.0, "m")
        points = found(unitless(r_a), R_a, unitless(r_b), R_b)
        return tuple(
            replace(
                p,
                depth=unitless(p.depth) * metre,
                place=unitless(p.place) * metre,
                overlap=None if p.overlap is None else unitless(p.overlap) * metre,
            )
            for p in points
        )

    return in_metres


def _found(a: Shape, b: Shape) -> Touches:
    for first, second, swapped in ((a, b, False), (b, a, True)):
        found = _closed_form(first, second)
        if found is not None:
            return _swapped(found) if swapped else found
    return _by_mpr(a, b)


def method(a: Shape, b: Shape) -> str:
    """How the contact of two shapes is found: "closed form" or "MPR"."""
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
        return lambda r_a, R_a, r_b, R_b: boxes(r_a, R_a, r_b, R_b, *sizes)
    return None


def _round_points(a: Shape) -> list[tuple[tuple[float, ...], float]] | None:
    """Points in body axes [m] with a radius [m] whose hull is the shape; None if there are infinitely many."""
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
    # Concentric spheres have no normal; a length that is never zero keeps the equations defined there.
    apart = r_b - r_a
    distance = norm(apart)
    normal = apart / maximum(distance, 1e-12)
    depth = radius_a + radius_b - distance
    return Touch(depth, normal, r_a + normal * (radius_a - depth / 2))


def _sphere_in_box(r_a: Expr, r_b: Expr, R_b: Expr, radius: float, half: list[float]) -> Touch:
    """A ball and the nearest point of a box; a ball whose centre is inside leaves through the nearest face."""
    centre = R_b.T @ (r_a - r_b)
    outside = as_expr([centre[k] - clamp(centre[k], -half[k], half[k]) for k in range(3)])
    # The tiny number keeps derivatives finite inside, where this branch is not used.
    distance = sqrt(dot(outside, outside) + 1e-30)
    sideways = outside / maximum(distance, 1e-12)
    x, y, z = (half[k] - fabs(centre[k]) for k in range(3))
    is_x, is_y = no_event((x <= y) & (x <= z)), no_event(y <= z)
    faces = (
        where(is_x, sense(centre[0]), 0.0),
        where(is_x, 0.0, where(is_y, sense(centre[1]), 0.0)),
        where(is_x, 0.0, where(is_y, 0.0, sense(centre[2]))),
    )
    apart = no_event(distance > 1e-12)
    out = R_b @ as_expr([where(apart, sideways[k], faces[k]) for k in range(3)])
    height = where(apart, distance, -minimum(x, minimum(y, z)))
    depth = radius - height
    return Touch(depth, -out, r_a - out * (height + depth / 2))


def _by_mpr(a: Shape, b: Shape) -> Touches:
    find = penetration(a, b)

    def found(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr) -> tuple[Touch, ...]:
        depth, normal, point_a, point_b = find(r_a, R_a, r_b, R_b)
        return (Touch(depth, normal, (point_a + point_b) / 2),)

    return found


def _swapped(found: Touches) -> Touches:
    def turned(r_a: Expr, R_a: Expr, r_b: Expr, R_b: Expr) -> tuple[Touch, ...]:
        return tuple(replace(t, normal=-t.normal) for t in found(r_b, R_b, r_a, R_a))

    return turned
