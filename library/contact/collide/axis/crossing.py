"""Depth of a point in a convex shape along a line, as a function that equations can call.

    depth, beyond, beside, normal = crossing(Box((0.1, 0.1, 0.05)))(tip, axis)

`tip` [m] and the unit vector `axis` are in the axes of the shape. Outputs: `depth` [m], the distance of the tip behind
the face through which the line enters; `beyond` [m], that behind the face through which it leaves; `beside`, positive
if the line misses the shape (`depth` and `beyond` then count from the planes perpendicular to the line that touch the
shape in front and behind, so that they do not jump where a line moves off a face); and `normal`, the outward unit
normal where the line enters.

Minkowski Portal Refinement finds the faces, with the line as its ray: one call, without derivatives. For shapes with
flat faces, what remains is an intersection with a plane; for round ones, two steps of Newton's method make it exact. In
both cases the result can be differentiated repeatedly. Balls and cylinders have closed forms.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import Any

import numpy as np

from acausal import External
from acausal.library.contact.collide.shapes import Cylinder, HalfSpace, Shape, Sphere

_FAR = 1e3
"""Depth [m] that stands for the exit face, which a half-space does not have."""

_GRAZING = math.sin(math.radians(1.0))
"""Sine of the angle between line and face below which the line counts as grazing the shape."""

_FLOOR = 1e-12


@lru_cache(maxsize=256)
def crossing(shape: Shape) -> External:
    """The function `(tip, axis) -> (depth, beyond, beside, normal)`; the same object for equal shapes."""
    return External(
        f"crossing_{type(shape).__name__.lower()}",
        partial(crossing_function, shape),
        inputs=((3,), (3,)),
        outputs=((), (), (), (3,)),
        units=("m", "m", "1", "1"),
        jumps=True,
    )


@lru_cache(maxsize=256)
def crossing_function(shape: Shape) -> Any:
    """The CasADi Function behind `crossing`, SX; its search is one call of a Function named `crossing_search`."""
    import casadi as ca

    tip, axis = ca.SX.sym("tip", 3), ca.SX.sym("axis", 3)
    depth, beyond, hit, n, front, back = crossed(shape, tip, axis)
    into = ca.logic_and(hit, ca.dot(n, axis) < -_GRAZING)
    outputs = [
        ca.if_else(into, depth, ca.dot(axis, tip) - front),
        ca.if_else(into, beyond, ca.dot(axis, tip) - back),
        ca.logic_not(into),
        ca.if_else(into, n, -axis),
    ]
    names = ["tip", "axis"], ["depth", "beyond", "beside", "normal"]
    return ca.Function("crossing", [tip, axis], outputs, *names)


def crossed(shape: Shape, tip: Any, axis: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Depth behind entry and exit [m], whether the line meets the shape, normal, start and end along the line [m]."""
    import casadi as ca

    from acausal.library.contact.collide.axis.search import faces
    from acausal.library.contact.collide.minkowski import core, height

    if isinstance(shape, HalfSpace):
        return tip[2] / ca.fmin(axis[2], -_GRAZING), -_FAR, 1, ca.SX(ca.DM([0, 0, 1])), 0, _FAR
    if isinstance(shape, Sphere):
        middle, half, hit = _chord(ca.dot(tip, axis), ca.sumsqr(tip) - shape.radius**2, 1)
        depth = middle + half
        return depth, middle - half, hit, (tip - depth * axis) / shape.radius, -shape.radius, shape.radius
    if isinstance(shape, Cylinder):
        return _cylinder(shape, tip, axis)
    unit = float(np.abs(shape.bounding_box()).max())
    n, entry, out, leaving, hit, front = faces(shape, tip, axis)
    depth = ca.dot(n, tip - entry) / ca.fmin(ca.dot(n, axis), -_FLOOR)
    beyond = ca.dot(out, tip - leaving) / ca.fmax(ca.dot(out, axis), _FLOOR)
    back = unit * height(core(shape, unit), axis) + shape.margin
    return depth, beyond, hit, n, ca.dot(axis, front), back


def _cylinder(shape: Cylinder, p: Any, e: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    import casadi as ca

    # Square of the component across the axis; a line along the axis does not cross the lateral surface.
    share = ca.fmax(e[0] ** 2 + e[1] ** 2, _FLOOR)
    middle, half, hit = _chord(p[0] * e[0] + p[1] * e[1], p[0] ** 2 + p[1] ** 2 - shape.radius**2, share)
    sense, side, steep = ca.copysign(1, e[2]), shape.length / 2, ca.fmax(ca.fabs(e[2]), _FLOOR)
    first, last = (sense * p[2] + side) / steep, (sense * p[2] - side) / steep
    depth, beyond = ca.fmin(first, middle + half), ca.fmax(last, middle - half)
    entered = (p - depth * e) / shape.radius
    through_cap = first < middle + half
    n = ca.if_else(through_cap, ca.vertcat(0, 0, -sense), ca.vertcat(entered[:2], 0))
    back = shape.radius * ca.sqrt(share) + side * ca.fabs(e[2])
    return depth, beyond, ca.logic_and(hit, depth > beyond), n, -back, back


def _chord(along: Any, inside: Any, share: Any) -> tuple[Any, Any, Any]:
    """Distance of a point beyond the middle of a line's chord in a circle, half the chord, and whether there is one.

    They solve share x**2 - 2 along x + inside = 0 for the distance x back to the circle.
    """
    import casadi as ca

    middle = along / share
    square = middle**2 - inside / share
    return middle, ca.sqrt(ca.fmax(square, 1e-30)), square > 0
