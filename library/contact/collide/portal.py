"""Minkowski Portal Refinement: finds the face through which a ray from inside leaves the difference of two shapes.

Sources: G. Snethen, XenoCollide: Complex Collision Made Simple, Game Programming Gems 7 (2008); improved as in
A. Neumayr, M. Otter, Collision Handling with Variable-step Integrators, EOOLT (2017): the ray is followed through the
origin and beyond, so that the signed distance of the face is found whether the shapes touch or not. In addition, the
ray starts here from a specially chosen interior point (`Pair.inner`), and is restarted from the origin along the normal
found, until the face is locally the nearest.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.library.contact.collide.minkowski import VERTEX, Pair

# The state: start of the ray, three vertices, normal, offset of the support plane, the phase, and the number of steps.
_V = [slice(3 + k * VERTEX, 3 + (k + 1) * VERTEX) for k in range(3)]
_N = slice(3 + 3 * VERTEX, 6 + 3 * VERTEX)
OFFSET = 6 + 3 * VERTEX
GOING = OFFSET + 1
_COUNT = GOING + 1
SIZE = _COUNT + 1

# Phases, counted down to the end.
_FIRST, _SECOND, _DISCOVER, _REFINE = 4.0, 3.0, 2.0, 1.0

ASIDE = (0.43e-4, 0.27e-4, -0.61e-4)
"""Moves the ray out of planes of symmetry, in which it would meet edges; the result does not depend on it."""

# Number of steps after which no new ray is started, since it could not be completed.
_LAST_RAY = 36
_TINY = 1e-300


def inner(pair: Pair) -> Any:
    """Start of the first ray."""
    return pair.inner() + ca.DM(ASIDE)


def start(v0: Any) -> Any:
    """The state before the first step of a ray from `v0`."""
    return ca.vertcat(v0, ca.SX.zeros(3 * VERTEX + 3), 0, _FIRST, 0)


def steps(pair: Pair, state: Any, tolerance: float, near: float) -> list[Any]:
    """The state after adding one support point, for each of the phases 1 to 4.

    `tolerance` is the largest distance of the last support point outside the portal. A new ray is started if the
    projection of the origin onto its plane lies outside the portal and farther than `near` from its vertices.
    """
    return [
        _refine(pair, state, tolerance, near),
        _discover(pair, state),
        _second(pair, state),
        _first(pair, state),
    ]


def _first(pair: Pair, state: Any) -> Any:
    v0 = state[:3]
    return _after(state, {0: pair.support(-v0)}, _SECOND)


def _second(pair: Pair, state: Any) -> Any:
    """Add a vertex beside the plane of the ray and the first one; the two are ordered so that it is in their wedge."""
    v0, first = state[:3], state[_V[0]]
    across = ca.cross(first[:3], v0)
    small = ca.sumsqr(across) < 1e-24 * ca.sumsqr(v0)
    across = ca.if_else(small, ca.vertcat(v0[1] - v0[2], v0[2] - v0[0], v0[0] - v0[1]), across)
    found = pair.support(across)
    swap = ca.dot(ca.cross(first[:3] - v0, found[:3] - v0), v0) > 0
    return _after(state, {0: ca.if_else(swap, found, first), 1: ca.if_else(swap, first, found)}, _DISCOVER)


def _discover(pair: Pair, state: Any) -> Any:
    """Add a third vertex; if the ray passes beside the portal, it replaces one of the first two."""
    v0, first, second = state[:3], state[_V[0]], state[_V[1]]
    n = ca.cross(first[:3] - v0, second[:3] - v0)
    n = ca.if_else(ca.dot(n, v0) > 0, -n, n)
    found = pair.support(n)
    f = found[:3]
    left = ca.dot(ca.cross(first[:3], f), v0) < 0
    right = ca.logic_and(ca.logic_not(left), ca.dot(ca.cross(f, second[:3]), v0) < 0)
    vertices = {0: ca.if_else(right, found, first), 1: ca.if_else(left, found, second), 2: found}
    return _after(state, vertices, ca.if_else(ca.logic_or(left, right), _DISCOVER, _REFINE))


def _refine(pair: Pair, state: Any, tolerance: float, near: float) -> Any:
    """Extend the portal by a vertex beyond it, or finish, or start a new ray."""
    v0 = state[:3]
    v = [state[place] for place in _V]
    w = [x[:3] for x in v]
    n = ca.cross(w[1] - w[0], w[2] - w[0])
    n = ca.if_else(ca.dot(n, w[0] - v0) < 0, -n, n) / ca.sqrt(ca.sumsqr(n) + _TINY)
    found = pair.support(n)
    offset = ca.dot(n, found[:3])
    close = offset - ca.dot(n, w[0]) <= tolerance
    worth = ca.logic_and(close, ca.logic_and(state[_COUNT] < _LAST_RAY, offset > 1e-6))

    # The nearest point of the plane is outside the portal: a ray along the normal leaves elsewhere, and earlier.
    again = ca.logic_and(worth, _outside(w, n, offset, near))
    restart = (ca.DM(ASIDE) - 0.5 * n) * ca.fmin(offset, 0.1)
    refined = _refined(v0, v, found, ca.logic_not(close))
    return ca.vertcat(
        ca.if_else(again, restart, v0),
        *refined,
        n,
        offset,
        ca.if_else(again, _FIRST, ca.if_else(close, 0, _REFINE)),
        state[_COUNT] + 1,
    )


def _after(state: Any, vertices: dict[int, Any], phase: Any) -> Any:
    kept = [vertices.get(k, state[place]) for k, place in enumerate(_V)]
    return ca.vertcat(state[:3], *kept, state[_N], state[OFFSET], phase, state[_COUNT] + 1)


def corners(state: Any) -> Any:
    """The vertices of the portal and the start of the ray as points, (12, 1)."""
    return ca.vertcat(*(state[place][:3] for place in _V), state[:3])


def result(state: Any) -> tuple[list[Any], Any, Any]:
    """Vertices of the portal, its unit normal, and the offset of the support plane."""
    return [state[place] for place in _V], state[_N], state[OFFSET]


def _refined(v0: Any, v: list[Any], found: Any, split: Any) -> list[Any]:
    """The part of the portal, `split` by the new vertex, through which the ray passes."""
    across = ca.cross(found[:3], v0)
    one, two, three = (ca.dot(x[:3], across) > 0 for x in v)
    replace_first = ca.if_else(one, two, ca.logic_not(three))
    replace_third = ca.logic_and(one, ca.logic_not(two))
    replace_second = ca.logic_and(ca.logic_not(one), three)
    replaced = zip((replace_first, replace_second, replace_third), v, strict=True)
    return [ca.if_else(ca.logic_and(split, here), found, x) for here, x in replaced]


def _outside(w: list[Any], n: Any, offset: Any, near: float) -> Any:
    """Whether the point of the plane nearest to the origin lies outside the portal."""
    x = n * offset
    area = ca.dot(ca.cross(w[1] - w[0], w[2] - w[0]), n)
    parts = [ca.dot(ca.cross(w[i] - x, w[j] - x), n) for i, j in ((0, 1), (1, 2), (2, 0))]
    # The portal may have either orientation.
    lowest = ca.fmin(ca.fmin(parts[0] * area, parts[1] * area), parts[2] * area)
    distance = ca.fmin(ca.fmin(*(ca.sumsqr(v - x) for v in w[:2])), ca.sumsqr(w[2] - x))
    return ca.logic_and(lowest < -1e-9 * area**2, distance > near**2)
