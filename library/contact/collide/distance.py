"""The point of the difference of two separate shapes that is nearest to the origin.

Source: E. G. Gilbert, D. W. Johnson, S. S. Keerthi, A fast procedure for computing the distance between complex
objects, IEEE J. Robotics and Automation 4 (1988). It starts from the portal, so that few steps remain.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.library.contact.collide.minkowski import VERTEX, Pair

# The state: three vertices, their weights, the nearest point, and whether the iteration continues.
_V = [slice(k * VERTEX, (k + 1) * VERTEX) for k in range(3)]
_WEIGHTS = slice(3 * VERTEX, 3 * VERTEX + 3)
_X = slice(3 * VERTEX + 3, 3 * VERTEX + 6)
GOING = 3 * VERTEX + 6
SIZE = GOING + 1

_TINY = 1e-300
TOUCHING = 1e-12
"""Distance below which the direction is undefined."""


def start(vertices: list[Any]) -> Any:
    """The state with the nearest point of a triangle."""
    chosen, weights, x = _nearest(vertices[0], [vertices[1], vertices[2]])
    return ca.vertcat(*chosen, weights, x, 1)


def step(pair: Pair, state: Any, tolerance: float) -> Any:
    """The state after adding one support point."""
    v, x = [state[place] for place in _V], state[_X]
    found = pair.support(-x)
    chosen, weights, nearest = _nearest(found, v)
    length = ca.sqrt(ca.sumsqr(x))
    # x . w never exceeds |x|^2, and equals it at the solution.
    close = ca.sumsqr(x) - ca.dot(x, found[:3]) <= tolerance * length
    done = ca.logic_or(close, ca.logic_or(length <= TOUCHING, ca.sumsqr(nearest) >= ca.sumsqr(x)))
    after = ca.vertcat(*chosen, weights, nearest, 1)
    return ca.if_else(done, ca.vertcat(state[:GOING], 0), after)


def result(state: Any) -> tuple[list[Any], Any, Any]:
    """Vertices, their weights (3, 1) and the nearest point (3, 1)."""
    return [state[place] for place in _V], state[_WEIGHTS], state[_X]


def _nearest(new: Any, old: list[Any]) -> tuple[list[Any], Any, Any]:
    """Of all triangles and edges at the vertex `new`, the one nearest to the origin: vertices, weights, point."""
    w = new[:3]
    best: list[Any] = [new, new, new]
    weights, x = ca.SX(ca.DM([1, 0, 0])), w
    for v in old:
        edge = v[:3] - w
        t = ca.fmin(ca.fmax(-ca.dot(w, edge) / (ca.sumsqr(edge) + _TINY), 0), 1)
        point = w + t * edge
        better = ca.sumsqr(point) < ca.sumsqr(x)
        best = [best[0], ca.if_else(better, v, best[1]), best[2]]
        weights = ca.if_else(better, ca.vertcat(1 - t, t, 0), weights)
        x = ca.if_else(better, point, x)
    for i in range(len(old)):
        for j in range(i):
            barycentric, inside = _inside(w, old[i][:3], old[j][:3])
            point = barycentric[0] * w + barycentric[1] * old[i][:3] + barycentric[2] * old[j][:3]
            better = ca.logic_and(inside, ca.sumsqr(point) < ca.sumsqr(x))
            best = [best[0], ca.if_else(better, old[i], best[1]), ca.if_else(better, old[j], best[2])]
            weights = ca.if_else(better, barycentric, weights)
            x = ca.if_else(better, point, x)
    return best, weights, x


def _inside(a: Any, b: Any, c: Any) -> tuple[Any, Any]:
    """Barycentric coordinates of the point of a plane nearest to the origin, and whether it lies in the triangle."""
    n = ca.cross(b - a, c - a)
    square = ca.sumsqr(n)
    flat = square <= 1e-28 * ca.sumsqr(b - a) * ca.sumsqr(c - a) + _TINY
    one, two, three = (ca.dot(n, ca.cross(p, q)) / (square + _TINY) for p, q in ((b, c), (c, a), (a, b)))
    inside = ca.logic_and(ca.logic_and(one >= 0, two >= 0), ca.logic_and(three >= 0, ca.logic_not(flat)))
    return ca.vertcat(one, two, three), inside
