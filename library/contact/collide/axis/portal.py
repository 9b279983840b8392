"""Minkowski Portal Refinement with a given line as its ray: the faces through which it enters and leaves a shape.

A penetration depth is measured along the normal of some face, but the depth of a drill along its axis. So the ray is
the axis rather than a line from an interior point through the origin: first a triangle inside the shape that the axis
crosses is found by the same search in the plane across the axis. Then G. Snethen's refinement (XenoCollide, Game
Programming Gems 7, 2008) is applied once towards either end. Only the projection along the axis is used, so the result
does not depend on the depth of the tip.

Coordinates are those of the shape, divided by a length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from acausal.library.contact.collide.minkowski import Core, on_ring, ring

VERTEX = 7
"""Size of a vertex: the point, then that of the shape without its margin, and the radius of its circle about z."""

_V = [slice(k * VERTEX, (k + 1) * VERTEX) for k in range(3)]

SEARCHING = 3 * VERTEX
HIT = SEARCHING + 1
TRIANGLE = HIT + 1
"""State of the search for a triangle that the line crosses: its vertices, the phase, and whether it has been found."""

_N = slice(3 * VERTEX, 3 * VERTEX + 3)
REFINING = 3 * VERTEX + 3
PORTAL = REFINING + 1
"""State of the refinement: vertices, normal, whether it continues."""

_WEDGE, _EDGE = 2.0, 1.0

_ASIDE = (0.43e-4, 0.27e-4, -0.61e-4)
"""Moves the interior point out of planes of symmetry, where the line would meet vertices and edges."""

_INSIDE = 1e-12
"""Least distance of a line from the rim of the projected shape: a line along a face or an edge does not enter."""

_TINY = 1e-300


@dataclass(frozen=True)
class Body:
    """A shape in units of some length."""

    core: Core
    margin: float
    least: float
    """The smallest of its half extents."""

    @property
    def round(self) -> bool:
        """Whether it has circles in addition to corners."""
        return self.core.round or self.margin > 0.0

    @property
    def inside(self) -> Any:
        """An interior point (3, 1)."""
        return ca.DM(self.core.inner.centre) + ca.DM(_ASIDE) * min(self.least, 1.0)

    def support(self, d: Any) -> Any:
        """Vertex (VERTEX, 1) farthest in direction d, which need not be a unit vector."""
        circle = ring(self.core, d)
        point = on_ring(circle, d) if self.core.round else circle[:3]
        grown = point + d * (self.margin / ca.sqrt(ca.sumsqr(d) + _TINY)) if self.margin else point
        return ca.vertcat(grown, point, circle[3])


def vertices(state: Any) -> list[Any]:
    """The three vertices of a portal."""
    return [state[v] for v in _V]


def normal(state: Any) -> Any:
    """Outward unit normal of a refined portal."""
    n = state[_N]
    return n / ca.sqrt(ca.sumsqr(n) + _TINY)


def outset(body: Body, p: Any, e: Any) -> Any:
    """Direction of the first vertex: from an interior point to the line p + t e."""
    seen = body.inside - p
    return e * ca.dot(e, seen) - seen


def begin(body: Body, p: Any, d: Any, found: Any) -> Any:
    """Initial state of the search, from an interior point and the vertex found on the other side of the line."""
    inside = ca.vertcat(body.inside, ca.DM.zeros(4))
    missed = ca.dot(d, found[:3] - p) <= _INSIDE * ca.sqrt(ca.sumsqr(d))
    return ca.vertcat(found, found, inside, ca.if_else(missed, 0, _WEDGE), 0)


def beside(state: Any, p: Any, e: Any) -> Any:
    """Direction of the next vertex: off the plane of the axis and the first vertex, or beyond the edge of two."""
    a, b, inside = vertices(state)
    first = state[SEARCHING] > 1.5
    to_a, to_line = a[:3] - inside[:3], p - inside[:3]
    out = ca.cross(e, ca.if_else(first, to_a, b[:3] - a[:3]))
    return out * ca.copysign(1, ca.dot(out, ca.if_else(first, to_line, to_a)))


def step(state: Any, p: Any, e: Any, out: Any, found: Any) -> Any:
    """The state after adding the vertex found in direction `out`; a finished search is returned unchanged.

    First, vertices are sought beside the plane of the axis and the previous vertex, until the line lies in the wedge of
    two vertices, seen from inside; then beyond their edge, until the line is within it or turns out to be unreachable.
    """
    a, b, inside = vertices(state)
    first = state[SEARCHING] > 1.5
    to_a, to_line = a[:3] - inside[:3], p - inside[:3]
    least = ca.sqrt(ca.sumsqr(out)) * _INSIDE
    hit = ca.logic_and(ca.logic_not(first), ca.dot(out, a[:3] - p) > least)
    short = ca.logic_and(ca.logic_not(first), ca.dot(out, found[:3] - a[:3]) <= least)
    missed = ca.logic_or(ca.dot(out, found[:3] - p) <= least, short)
    # The line and the first vertex are on the same side of the new one.
    across = ca.cross(e, found[:3] - inside[:3])
    with_a = ca.dot(across, to_line) * ca.dot(across, to_a) >= 0
    ends = ca.logic_or(hit, missed)
    new_a = ca.logic_and(ca.logic_not(ends), ca.logic_not(with_a))
    new_b = ca.logic_and(ca.logic_not(ends), ca.logic_or(first, with_a))
    phase = ca.if_else(ends, 0, ca.if_else(ca.logic_and(first, ca.logic_not(with_a)), _WEDGE, _EDGE))
    return ca.vertcat(ca.if_else(new_a, found, a), ca.if_else(new_b, found, b), inside, phase, hit)


def ordered(state: Any, e: Any) -> Any:
    """Initial state of the refinement: the triangle found, its vertices counter-clockwise seen against e."""
    a, b, c = vertices(state)
    left = ca.dot(e, ca.cross(b[:3] - a[:3], c[:3] - a[:3])) >= 0
    return ca.vertcat(a, ca.if_else(left, b, c), ca.if_else(left, c, b), ca.SX.zeros(3), 1)


def outward(state: Any, e: Any, sense: float) -> Any:
    """Normal of a portal, oriented towards `sense` times e."""
    a, b, c = (x[:3] for x in vertices(state))
    n = ca.cross(b - a, c - a)
    return n * ca.copysign(1, sense * ca.dot(n, e))


def refined(state: Any, p: Any, e: Any, n: Any, found: Any, tolerance: float) -> Any:
    """The part of a portal with normal n, split by the vertex found there, through which the line leaves.

    A finished portal is returned unchanged.
    """
    v = vertices(state)
    a, b, c = (x[:3] for x in v)
    d = found[:3]
    more = ca.dot(n, d - a) > tolerance * ca.sqrt(ca.sumsqr(n))
    across = ca.cross(e, d - p)
    one, two, three = (ca.dot(across, x - p) > 0 for x in (a, b, c))
    # The line passes through the triangle of the new vertex and the edge whose ends are on either side, in this order.
    last, second = ca.logic_and(one, ca.logic_not(two)), ca.logic_and(three, ca.logic_not(one))
    first = ca.logic_not(ca.logic_or(last, second))
    parts = [ca.if_else(ca.logic_and(more, here), found, x) for here, x in zip((first, second, last), v, strict=True)]
    return ca.vertcat(*parts, n, more)


def again(state: Any) -> Any:
    """The state of a refinement, set to continue with a smaller tolerance."""
    return ca.vertcat(state[:REFINING], 1)
