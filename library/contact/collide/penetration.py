"""Penetration depth, normal and witness points of two convex shapes, as a function that equations can call.

    mpr = penetration(Sphere(0.1), Box((1.0, 1.0, 0.2)))
    depth, normal, point_a, point_b = mpr(ball.r_0, ball.R, plate.r_0, plate.R)

Inputs are the position r [m] of the frame of each shape in world axes and its orientation R, which transforms
components in the frame into world components. Outputs: `depth` [m], positive where the shapes overlap, else minus their
distance; `normal`, the unit vector in world axes from a to b along which the shapes have to move apart by the depth;
and the two witness points [m] in world axes, with `point_a - point_b == depth * normal`.

MPR, with an interior point chosen by `Pair.inner`, decides where the shapes touch; the search is one call, without
derivatives. Equations for the contact found then give exact derivatives: the depth changes with the relative velocity
of the witness points along the normal.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np

from acausal import External
from acausal.errors import DeclarationError
from acausal.library.contact.collide.checks import check_shape
from acausal.library.contact.collide.shapes import HalfSpace, Shape

_INPUTS = ((3,), (3, 3), (3,), (3, 3))
_OUTPUTS = ((), (3,), (3,), (3,))


@lru_cache(maxsize=256)
def penetration(shape_a: Shape, shape_b: Shape) -> External:
    """The function `(r_a, R_a, r_b, R_b) -> (depth, normal, point_a, point_b)`; the same object for equal shapes.

    Raises
    ------
    DeclarationError
        AC174 for a shape without volume, AC177 for two half-spaces.
    """
    check_shape(shape_a, "the first body")
    check_shape(shape_b, "the second body")
    if isinstance(shape_a, HalfSpace) and isinstance(shape_b, HalfSpace):
        raise DeclarationError(
            "AC177", "two half-spaces have no contact", help="one of the two bodies must be of finite size"
        )
    names = type(shape_a).__name__.lower(), type(shape_b).__name__.lower()

    return External(
        f"penetration_{names[0]}_{names[1]}",
        partial(collision_function, shape_a, shape_b),
        inputs=_INPUTS,
        outputs=_OUTPUTS,
        units=("m", "1", "m", "m"),
        jumps=True,
    )


@lru_cache(maxsize=256)
def collision_function(shape_a: Shape, shape_b: Shape) -> Any:
    """The CasADi Function of `penetration`, SX; its search is one call of a Function named `contact_search`."""
    import casadi as ca

    r_a, r_b = ca.SX.sym("r_a", 3), ca.SX.sym("r_b", 3)
    R_a, R_b = ca.SX.sym("R_a", 3, 3), ca.SX.sym("R_b", 3, 3)
    if isinstance(shape_a, HalfSpace):
        depth, normal, b, a = _plane(shape_b, r_b, R_b, r_a, R_a)
        normal = -normal
    elif isinstance(shape_b, HalfSpace):
        depth, normal, a, b = _plane(shape_a, r_a, R_a, r_b, R_b)
    else:
        depth, n, x, y = _relative(shape_a, shape_b, R_a.T @ (r_b - r_a), R_a.T @ R_b)
        normal, a, b = R_a @ n, r_a + R_a @ x, r_a + R_a @ y
    return ca.Function(
        "penetration",
        [r_a, R_a, r_b, R_b],
        [depth, normal, a, b],
        ["r_a", "R_a", "r_b", "R_b"],
        ["depth", "normal", "point_a", "point_b"],
    )


def _plane(shape: Shape, r: Any, R: Any, r_plane: Any, R_plane: Any) -> tuple[Any, Any, Any, Any]:
    """Contact of a shape with a half-space: the lowest point of the shape."""
    import casadi as ca

    from acausal.library.contact.collide.minkowski import core, on_ring, ring

    up = R_plane[:, 2]
    d = -(R.T @ up)
    lowest = r + R @ on_ring(ring(core(shape, 1.0), d), d) - shape.margin * up
    depth = ca.dot(r_plane - lowest, up)
    return depth, -up, lowest, lowest + depth * up


def _relative(shape_a: Shape, shape_b: Shape, p: Any, R: Any) -> tuple[Any, Any, Any, Any]:
    """Contact in the frame of the first shape."""
    from acausal.library.contact.collide import polish
    from acausal.library.contact.collide.minkowski import Pair, core
    from acausal.library.contact.collide.search import search

    unit = _size(shape_a, shape_b)
    pair = Pair(core(shape_a, unit), core(shape_b, unit), p / unit, R)
    found = polish.contact(search(pair.a, pair.b)(pair.p, pair.R))
    for _ in range(2):
        found = polish.newton(pair, found)
    offset, point = polish.witness(pair, found)
    n = found.normal
    depth = unit * offset + shape_a.margin + shape_b.margin
    deepest = unit * point + shape_a.margin * n
    return depth, n, deepest, deepest - depth * n


def _size(*shapes: Shape) -> float:
    """A length [m] by which coordinates are scaled to order 1."""
    bounds = [np.array(s.bounding_box()) for s in shapes]
    return float(min(np.abs(b).max() for b in bounds))
