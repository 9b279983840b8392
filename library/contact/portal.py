"""Minkowski Portal Refinement: the face of the difference of two shapes through which a ray from inside leaves.

Sources: G. Snethen, XenoCollide: Complex Collision Made Simple, Game Programming Gems 7 (2008); improved as in
A. Neumayr, M. Otter, Collision Handling with Variable-step Integrators, EOOLT (2017): the ray is followed through the
origin and beyond, so that the signed distance of the face is found whether the shapes touch or not. Here moreover the
ray starts from an interior point of its own (`Pair.inner`), and is shot again from the origin along the normal found,
until the face is the nearest around.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.library.contact.minkowski import VERTEX, Pair

# The state: start of the ray, three vertices, normal, offset of the support plane, the phase, and the number of steps.
_V = [slice(3 + k * VERTEX, 3 + (k + 1) * VERTEX) for k in range(3)]
_N = slice(3 + 3 * VERTEX, 6 + 3 * VERTEX)
OFFSET = 6 + 3 * VERTEX
GOING = OFFSET + 1
_COUNT = GOING + 1
SIZE = _COUNT + 1

# Phases, counted down to the end.
_FIRST, _SECOND, _DISCOVER, _REFINE = 4.0, 3.0, 2.0, 1.0

_ASIDE = (0.43e-4, 0.27e-4, -0.61e-4)
"""Moves the ray out of the planes of symmetry in which it would meet edges: the answer does not depend on it."""

# Steps after which no new ray is shot: it would not come to an end.
_LAST_RAY = 36
_TINY = 1e-300


def start(pair: Pair) -> Any:
    """The state before the first step."""
    v0 = pair.inner() + ca.DM(_ASIDE)
    return ca.vertcat(v0, ca.SX.zeros(3 * VERTEX + 3), 0, _FIRST, 0)


def step(pair: Pair, state: Any, tolerance: float, near: float) -> Any:
    """One support point more.

    `tolerance` is how far the last support point may lie outside the portal. A new ray is shot when the foot of the
    origin on its plane lies outside the portal, and farther than `near` from its vertices.
    """
    v0, phase = state[:3], state[GOING]
    v = [state[place] for place in _V]
    w = [x[:3] for x in v]
    n = _normal(v0, w, phase)
    found = pair.support(_direction(v0, w, n, phase))
    f = found[:3]

    left, right = ca.dot(ca.cross(w[0], f), v0) < 0, ca.dot(ca.cross(f, w[1]), v0) < 0
    opened = _opened(v0, v, found, left, right, phase)
    refined = _refined(v0, v, found)
    gap = ca.dot(n, f - w[0])
    offset = ca.dot(n, f)
    close = gap <= tolerance

    searching = phase >= _DISCOVER
    portal = [ca.if_else(searching, o, ca.if_else(close, x, r)) for o, x, r in zip(opened, v, refined, strict=True)]
    turning = ca.logic_and(phase == _DISCOVER, ca.logic_or(left, right))
    following = ca.if_else(searching, ca.if_else(turning, phase, phase - 1), ca.if_else(close, 0, phase))

    # The nearest point of the plane is outside the portal: a ray along the normal leaves elsewhere, and sooner.
    worth = ca.logic_and(state[_COUNT] < _LAST_RAY, offset > 1e-6)
    again = ca.logic_and(ca.logic_and(phase == _REFINE, close), ca.logic_and(worth, _outside(w, n, offset, near)))
    restart = (ca.DM(_ASIDE) - 0.5 * n) * ca.fmin(offset, 0.1)
    retreat = pair.retreat()
    if retreat is not None:
        # The way out leads on through: the tool goes back where it came from.
        direction, deep = retreat
        forward = ca.logic_and(ca.dot(n, direction) < -0.5, offset > deep)
        through = ca.logic_and(ca.logic_and(phase == _REFINE, close), ca.logic_and(worth, forward))
        back = (ca.DM(_ASIDE) - 0.5 * direction) * ca.fmin(offset, 0.1)
        restart, again = ca.if_else(through, back, restart), ca.logic_or(through, again)
    return ca.vertcat(
        ca.if_else(again, restart, v0),
        *portal,
        n,
        offset,
        ca.if_else(again, _FIRST, following),
        state[_COUNT] + 1,
    )


def result(state: Any) -> tuple[list[Any], Any, Any]:
    """Vertices of the portal, its unit normal, and the offset of the support plane."""
    return [state[place] for place in _V], state[_N], state[OFFSET]


def _normal(v0: Any, w: list[Any], phase: Any) -> Any:
    """Unit normal: of the wedge from the ray's start while searching, of the portal afterwards; away from the start."""
    wedge = ca.cross(w[0] - v0, w[1] - v0)
    face = ca.cross(w[1] - w[0], w[2] - w[0])
    searching = phase >= _DISCOVER
    n = ca.if_else(searching, wedge, face)
    wrong = ca.if_else(searching, ca.dot(wedge, v0), -ca.dot(face, w[0] - v0)) > 0
    return ca.if_else(wrong, -n, n) / ca.sqrt(ca.sumsqr(n) + _TINY)


def _direction(v0: Any, w: list[Any], n: Any, phase: Any) -> Any:
    across = ca.cross(w[0], v0)
    small = ca.sumsqr(across) < 1e-24 * ca.sumsqr(v0)
    across = ca.if_else(small, ca.vertcat(v0[1] - v0[2], v0[2] - v0[0], v0[0] - v0[1]), across)
    return ca.if_else(phase == _FIRST, -v0, ca.if_else(phase == _SECOND, across, n))


def _opened(v0: Any, v: list[Any], found: Any, left: Any, right: Any, phase: Any) -> list[Any]:
    """Vertices after a step of the search; the first two keep the origin's ray on the inner side of their wedge."""
    discovering = phase == _DISCOVER
    first = ca.if_else(
        phase == _FIRST,
        found,
        ca.if_else(ca.logic_and(discovering, ca.logic_and(right, ca.logic_not(left))), found, v[0]),
    )
    second = ca.if_else(ca.logic_or(phase == _SECOND, ca.logic_and(discovering, left)), found, v[1])
    swap = ca.logic_and(phase <= _SECOND, ca.dot(ca.cross(first[:3] - v0, second[:3] - v0), v0) > 0)
    # When a portal is complete its first two vertices are as they were: nothing is swapped then.
    swap = ca.logic_and(swap, ca.logic_or(phase == _SECOND, ca.logic_or(left, right)))
    return [ca.if_else(swap, second, first), ca.if_else(swap, first, second), ca.if_else(discovering, found, v[2])]


def _refined(v0: Any, v: list[Any], found: Any) -> list[Any]:
    """The part of the portal, split by the new vertex, through which the ray goes."""
    across = ca.cross(found[:3], v0)
    one, two, three = (ca.dot(x[:3], across) > 0 for x in v)
    replace_first = ca.if_else(one, two, ca.logic_not(three))
    replace_third = ca.logic_and(one, ca.logic_not(two))
    replace_second = ca.logic_and(ca.logic_not(one), three)
    return [
        ca.if_else(replace_first, found, v[0]),
        ca.if_else(replace_second, found, v[1]),
        ca.if_else(replace_third, found, v[2]),
    ]


def _outside(w: list[Any], n: Any, offset: Any, near: float) -> Any:
    """Whether the point of the plane nearest to the origin lies outside the portal."""
    x = n * offset
    area = ca.dot(ca.cross(w[1] - w[0], w[2] - w[0]), n)
    parts = [ca.dot(ca.cross(w[i] - x, w[j] - x), n) for i, j in ((0, 1), (1, 2), (2, 0))]
    # The portal may run either way round.
    lowest = ca.fmin(ca.fmin(parts[0] * area, parts[1] * area), parts[2] * area)
    distance = ca.fmin(ca.fmin(*(ca.sumsqr(v - x) for v in w[:2])), ca.sumsqr(w[2] - x))
    return ca.logic_and(lowest < -1e-9 * area**2, distance > near**2)
