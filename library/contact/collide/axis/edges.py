"""Distance between a line and a convex shape, as a function that equations can call.

    outside = edge_distance(Box((0.1, 0.1, 0.05)))(tip, axis)

Point `tip` [m] and unit vector `axis` of the line are in the axes of the shape; `outside` [m] is 0 where they meet.
Projected along the line, they are a point and a plane convex shape, whose distance is found as in
`library/contact/collide/distance.py`; for a box there is a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from acausal import External
from acausal.library.contact.collide.shapes import Box, HalfSpace, Shape

_FLOOR = 1e-30
_MOST = 32
"""Largest number of iterations: hulls take 3 to 5, circles up to 12."""

_TOLERANCE = 1e-6
"""Tolerance of the distance relative to the size of the shape."""

_FAR = 1e3


@lru_cache(maxsize=256)
def edge_distance(shape: Shape) -> External:
    """The function `(tip, axis) -> outside`; the same object for equal shapes."""
    name = f"edge_distance_{type(shape).__name__.lower()}"
    lines = partial(edge_distance_function, shape)
    return External(name, lines, inputs=((3,), (3,)), outputs=((),), units=("m",), jumps=True)


@dataclass(frozen=True)
class _Shadow:
    """The shape projected along the line, with the line at the origin; support points for `distance.step`."""

    shape: Any
    p: Any
    e: Any

    def support(self, d: Any) -> Any:
        import casadi as ca

        from acausal.library.contact.collide.minkowski import VERTEX

        far = self.shape.support(d)[:3] - self.p
        return ca.vertcat(far - ca.dot(far, self.e) * self.e, ca.SX(VERTEX - 3, 1))


@lru_cache(maxsize=256)
def edge_distance_function(shape: Shape) -> Any:
    """The CasADi Function of `edge_distance`; a search, if needed, is one call without derivatives."""
    import casadi as ca

    p, e = ca.SX.sym("tip", 3), ca.SX.sym("axis", 3)
    if isinstance(shape, HalfSpace):
        found: Any = ca.SX(0)
    else:
        found = _of_box(shape, p, e) if isinstance(shape, Box) else _search(shape)(p, e)
    return ca.Function("edge_distance", [p, e], [found])


def _of_box(box: Box, p: Any, e: Any) -> Any:
    """Closed form for a box, whose projection is a hexagon with three pairs of parallel edges."""
    import casadi as ca

    outside, inside = ca.SX(_FAR), ca.SX(_FAR)
    for k in range(3):
        h, i, j = box.half[k], (k + 1) % 3, (k + 2) % 3
        # Projected along the line, all edges along k have this half length and direction.
        half = h * (ca.DM.eye(3)[:, k] - e[k] * e)
        square = ca.fmax(ca.sumsqr(half), _FLOOR)
        for one in (-1, 1):
            for other in (-1, 1):
                middle = ca.SX(3, 1)
                middle[i], middle[j] = one * box.half[i], other * box.half[j]
                to = middle - p
                to -= ca.dot(to, e) * e
                share = ca.fmin(ca.fmax(-ca.dot(to, half) / square, -1), 1)
                outside = ca.fmin(outside, ca.norm_2(to + share * half))
        across = ca.cross(e, ca.DM.eye(3)[:, k])
        length = ca.norm_2(across)
        room = sum(b * ca.fabs(across[m]) for m, b in enumerate(box.half)) - ca.fabs(ca.dot(across, p))
        # A line parallel to axis k sees no pair of edges along it.
        inside = ca.fmin(inside, ca.if_else(length > 1e-9, room / ca.fmax(length, 1e-9), _FAR))
    return ca.if_else(inside > 0, 0, outside)


def _search(shape: Shape) -> Any:
    """The Function `(tip, axis) -> outside` for any shape."""
    import casadi as ca

    from acausal.library.contact.collide import distance
    from acausal.library.contact.collide.axis.portal import Body
    from acausal.library.contact.collide.chain import frozen, repeat
    from acausal.library.contact.collide.minkowski import core

    bounds = np.array(shape.bounding_box())
    unit = float(np.abs(bounds).max())
    body = Body(core(shape, unit), shape.margin / unit, float((bounds[1] - bounds[0]).min()) / (2 * unit))
    line, state = ca.SX.sym("line", 6), ca.SX.sym("state", distance.SIZE)
    shadow: Any = _Shadow(body, line[:3], line[3:])
    aside = body.inside - line[:3]
    first = shadow.support(ca.dot(aside, line[3:]) * line[3:] - aside)
    begin = ca.Function("begin", [line], [distance.start([first, first, first])])
    step = ca.Function("gap_step", [state, line], [distance.step(shadow, state, _TOLERANCE)], {"never_inline": True})
    tip, axis = ca.MX.sym("tip", 3), ca.MX.sym("axis", 3)
    given = ca.vertcat(tip / unit, axis)
    end = repeat(step, distance.GOING, _MOST)(begin(given), given)
    return frozen("gap", ca.Function("gap", [tip, axis], [unit * ca.norm_2(distance.result(end)[2])]))
