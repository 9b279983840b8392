"""The face through which a line leaves a round shape, as the solution of equations: exact, and differentiable.

Given the circles that touch the face, its normal n, their weights l and the distance u along the line solve

    sum l_i w_i(n) = p + u g,   sum l_i = 1,   n . w_i(n) equal for all i,   n . g = 1

where w_i(n) is the point of circle i in direction n, grown by the margin, and g the direction in which the line leaves.
These are the conditions for a minimum of (h(n) - n . p) / (n . g), where h is the support function: a convex problem,
whose solution is unique.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.library.contact.collide.axis import portal as axis_portal
from acausal.library.contact.collide.minkowski import curvature, on_ring, settled
from acausal.library.contact.collide.polish import saddle

_F = [slice(4 * k, 4 * k + 4) for k in range(3)]
_ON = [12, 13]
_N = slice(14, 17)
_L = [17, 18]
SOUND = 19
SIZE = 20
"""Three circles, which of the last two are active, normal, weights of these two, whether it is a solution."""

_STEPS = 4
_SAME = 1e-14


def start(state: Any, g: Any) -> Any:
    """Initial contact (SIZE, 1) with the circles of a portal; equal ones count once."""
    n = axis_portal.normal(state)
    found = axis_portal.vertices(state)
    f = [settled(v[3:], n) for v in found]
    second = ca.logic_not(_same(f[1], f[0]))
    third = ca.logic_not(ca.logic_or(_same(f[2], f[0]), _same(f[2], f[1])))
    share = 1 / (1 + second + third)
    return ca.vertcat(*f, second, third, n / ca.dot(n, g), second * share, third * share, 1)


def solved(body: axis_portal.Body, contact: Any, p: Any, g: Any) -> Any:
    """The contact after a few steps, sound if it is a solution and no point of the shape lies outside the plane."""
    margin = body.margin
    for _ in range(_STEPS):
        contact = newton(margin, contact, p, g)
    check = newton(margin, contact, p, g)
    n = contact[_N]
    error = ca.norm_2(check[_N] - n)
    one, two = check[_L[0]], check[_L[1]]
    pulling = ca.fmin(ca.fmin(one, two), 1 - one - two) < -1e-9
    height = ca.dot(n, body.support(n)[:3])
    standing = height - ca.dot(n, point(margin, contact)) > 1e-12
    wrong = ca.logic_or(ca.logic_or(pulling, standing), ca.logic_not(error < 1e-9))
    return ca.vertcat(contact[:SOUND], ca.logic_not(wrong))


def newton(margin: float, contact: Any, p: Any, g: Any) -> Any:
    """One step of Newton's method; a contact that is not sound is returned unchanged."""
    circles, on, n, weights = _parts(contact)
    sound = contact[SOUND] > 0.5
    w = [_place(margin, f, n) for f in circles]
    every = [1 - weights[0] - weights[1], *weights]
    bend, mean = ca.SX(3, 3), ca.SX(3, 1)
    for share, f, x in zip(every, circles, w, strict=True):
        bend += share * _bend(margin, f, n)
        mean += share * x
    edges = [(x - w[0]) * use for x, use in zip(w[1:], on, strict=True)]
    lengths = [ca.if_else(use, ca.norm_2(edge), 1) for edge, use in zip(edges, on, strict=True)]
    rows = [*(edge / length for edge, length in zip(edges, lengths, strict=True)), g]
    right = [*(-ca.dot(row, n) for row in rows[:2]), 1 - ca.dot(n, g)]
    turn, changes = saddle(bend, rows, p - mean, right, [*on, 1])
    moved = n + ca.if_else(sound, turn, 0)
    shares = [
        ca.if_else(ca.logic_and(sound, use), share + change / length, share)
        for share, change, length, use in zip(weights, changes[:2], lengths, on, strict=True)
    ]
    return ca.vertcat(*circles, *contact[_ON[0] : _ON[1] + 1].nz, moved, *shares, contact[SOUND])


def plane(margin: float, contact: Any, p: Any, g: Any) -> tuple[Any, Any]:
    """Unit normal of the face and a point of it, with derivatives up to the third order."""
    for _ in range(2):
        contact = newton(margin, contact, p, g)
    n = contact[_N]
    return n / ca.sqrt(ca.sumsqr(n)), point(margin, contact)


def point(margin: float, contact: Any) -> Any:
    """The point (3, 1) at which the line crosses the face; for a contact that is not sound, any point of the face."""
    circles, _, n, weights = _parts(contact)
    one, two, three = (_place(margin, f, n) for f in circles)
    mixed = (1 - weights[0] - weights[1]) * one + weights[0] * two + weights[1] * three
    return mixed


def _parts(contact: Any) -> tuple[list[Any], list[Any], Any, list[Any]]:
    on = [contact[k] > 0.5 for k in _ON]  # a frozen call adds rounding errors to the flags
    return [contact[f] for f in _F], on, contact[_N], [contact[k] for k in _L]


def _place(margin: float, circle: Any, n: Any) -> Any:
    point = on_ring(circle, n)
    return point + n * (margin / ca.sqrt(ca.sumsqr(n))) if margin else point


def _bend(margin: float, circle: Any, n: Any) -> Any:
    """Derivative (3, 3) of the point of a circle with respect to n, which need not be a unit vector."""
    bend = curvature(circle, n)
    if margin:
        square = ca.sumsqr(n)
        bend += (margin / ca.sqrt(square)) * (ca.SX.eye(3) - n @ n.T / square)
    return bend


def _same(f: Any, g: Any) -> Any:
    return ca.norm_inf(f - g) <= _SAME
