"""Finds the features of two shapes that touch: portal, distance if apart, polishing, and other minima if deep."""

from __future__ import annotations

from typing import Any

import casadi as ca

from acausal.library.contact.collide import deep, distance, polish, portal
from acausal.library.contact.collide.chain import frozen, repeat
from acausal.library.contact.collide.minkowski import Core, Pair

_MOST_PORTAL, _MOST_DISTANCE, _MOST_POLISH = 64, 32, 48
"""Largest numbers of iterations; typical are 8, 3 and 2."""

_CURVED, _FINE, _FLAT = (1e-3, 0.3), (1e-8, 0.01), (1e-12, 0.0)
"""`tolerance` and `near` of the portal steps: with circles, with circles after failed convergence, without circles.

A portal on a round surface shrinks by half at each step; polishing then needs two or three steps.
"""


def search(a: Core, b: Core) -> Any:
    """The Function `(p, R) -> contact` (see `polish`) of two cores, without derivatives."""
    R, p = ca.SX.sym("R", 3, 3), ca.SX.sym("p", 3)
    pair = Pair(a, b, p, R)
    data = ca.vertcat(p, ca.vec(R))
    tolerance = _CURVED if a.round or b.round else _FLAT
    pose = ca.MX.sym("pose", 12)

    apart, polished = _apart(pair, data, tolerance), _polished(pair, data)
    if a.dimension + b.dimension < 3:
        # The difference of points and lines has no interior: there is neither a portal nor an overlap.
        d0 = pair.inner()
        v = pair.support(-d0)
        begin = ca.Function("begin", [data], [distance.start([v, v, v])])
        contact = polished(apart(begin(pose), pose), pose)
    else:
        v0 = ca.MX.sym("v0", 3)
        ray = _from_ray(pair, data, tolerance, apart, polished)
        fine = _from_ray(pair, data, _FINE, _apart(pair, data, _FINE), polished)
        local = ca.Function("local", [v0, pose], [ray(v0, pose)[0]], _CALL)
        finely = ca.Function("finely", [v0, pose], [fine(v0, pose)[0]], _CALL)
        first = ca.Function("inner", [data], [portal.inner(pair)])
        contact = deep.least(pair, data, local, finely)(*ray(first(pose), pose), pose)
    whole = ca.Function("contact", [pose], [contact], _CALL)
    P, Q = ca.MX.sym("p", 3), ca.MX.sym("R", 3, 3)
    return frozen("contact_search", ca.Function("pose", [P, Q], [whole(ca.vertcat(P, ca.vec(Q)))], _CALL))


def _polished(pair: Pair, data: Any) -> Any:
    """`(state of polish, pose) -> contact`."""
    state, s, pose = ca.SX.sym("state", polish.WORKING), ca.MX.sym("s", polish.WORKING), ca.MX.sym("pose", 12)
    step = ca.Function("polish", [state, data], [polish.step(pair, state)], _CALL)
    finish = ca.Function("finish", [state, data], [polish.finish(pair, state)], _CALL)
    end = repeat(step, polish.GOING, _MOST_POLISH)(s, pose)
    return ca.Function("polished", [s, pose], [finish(end, pose)], _CALL)


def _apart(pair: Pair, data: Any, tolerance: tuple[float, float]) -> Any:
    """`(state of distance, pose) -> state of polish`."""
    state = ca.SX.sym("state", distance.SIZE)
    step = ca.Function("distance", [state, data], [distance.step(pair, state, tolerance[0])], _CALL)
    vertices, _, x = distance.result(state)
    length = ca.sqrt(ca.sumsqr(x))
    n = ca.if_else(length > distance.TOUCHING, -x / ca.fmax(length, distance.TOUCHING), pair.aside())
    finish = ca.Function("nearest", [state, data], [polish.start(pair, vertices, n, -length)], _CALL)
    s, pose = ca.MX.sym("s", distance.SIZE), ca.MX.sym("pose", 12)
    end = repeat(step, distance.GOING, _MOST_DISTANCE)(s, pose)
    return ca.Function("apart", [s, pose], [finish(end, pose)], _CALL)


def _from_ray(pair: Pair, data: Any, tolerance: tuple[float, float], apart: Any, polished: Any) -> Any:
    """`(start of the ray, pose) -> (contact, portal and start of the last ray (12, 1))`."""
    state = ca.SX.sym("state", portal.SIZE)
    phases = [
        ca.Function(f"portal_phase_{k}", [state, data], [after])
        for k, after in enumerate(portal.steps(pair, state, *tolerance), start=1)
    ]
    vertices, n, offset = portal.result(state)
    start = ca.SX.sym("v0", 3)
    begin = ca.Function("begin", [start], [portal.start(start)], _CALL)
    corners = ca.Function("corners", [state], [portal.corners(state)], _CALL)
    overlap = ca.Function("overlap", [state, data], [polish.start(pair, vertices, n, offset)], _CALL)
    separate = ca.Function("separate", [state], [distance.start(vertices), offset], _CALL)

    s, pose, v0 = ca.MX.sym("s", portal.SIZE), ca.MX.sym("pose", 12), ca.MX.sym("v0", 3)
    chosen = ca.Function.conditional("portal_phases", phases[:-1], phases[-1])
    step = ca.Function("portal", [s, pose], [chosen(s[portal.GOING] - 1, s, pose)], _CALL)
    inside = ca.Function("inside", [s, pose], [overlap(s, pose)], _CALL)
    outside = ca.Function("outside", [s, pose], [apart(separate(s)[0], pose)], _CALL)
    switch = ca.Function.conditional("side", [outside], inside)
    end = repeat(step, portal.GOING, _MOST_PORTAL)(begin(v0), pose)
    value = switch(ca.if_else(end[portal.OFFSET] < -1e-10, 0, 1), end, pose)
    return ca.Function("from_ray", [v0, pose], [polished(value, pose), corners(end)], _CALL)


_CALL = {"never_inline": True}
