"""The smallest translation that separates deeply overlapping shapes: the portal's ray finds one of several minima.

A deep overlap has a nearest face on each side. The one found is the lowest of all if a ball of its height around the
origin lies in the tetrahedron of the portal and the start of the ray, which is part of the difference. Otherwise the
heights of many directions are compared, and the search is restarted from the lowest ones that may lead to other faces.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import casadi as ca
import numpy as np

from acausal.library.contact.collide import polish, portal
from acausal.library.contact.collide.minkowski import Core, Pair
from acausal.library.contact.collide.shapes import Vector

_SHALLOW = 1e-10
"""Offset below which no other face is searched for."""

_LATTICE = 400
_STARTS = 8
_SLIDES = 60
_TILTS, _AROUND = (0.02, 0.06, 0.15), 12
_SAME_WAY, _ITSELF = 0.9, 1 - 1e-9
"""Cosines of the angles within which two directions may lead to the same face, and within which they coincide."""

_WORTH = 1.5
"""Ratio of a direction's height to the best offset up to which a face near it may be lower."""

_UNSOUND, _ROUNDING, _MISSED, _TINY = 1e-6, 1e-12, 1e-9, 1e-150
_MOST_NORMALS, _MOST_EDGES = 400, 4000
_BIG = 1e3
_CALL = {"never_inline": True}


def least(pair: Pair, data: Any, local: Any, finely: Any) -> Any:
    """`(contact, triangle, pose) -> contact` with the lowest offset.

    `local` and `finely` are `(start of a ray, pose) -> contact`; the second is used if the first does not converge.
    `triangle` holds the vertices of the portal and the start of its ray, (12, 1).
    """
    c, triangle, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("triangle", 12), ca.MX.sym("pose", 12)
    searched = _searched(pair, data, local)
    found = ca.Function("searched", [c, triangle, pose], [searched(c, pose)], _CALL)
    same = ca.Function("same", [c, triangle, pose], [c])
    switch = ca.Function.conditional("deep_switch", [found], same)
    certified = _certified(data)
    best = switch(certified(c, triangle), c, triangle, pose)
    tool = pair.tool()
    if tool is not None:
        best = _drawn_back(data, *tool, local)(best, pose)
    return ca.Function(
        "deep", [c, triangle, pose], [_slid(pair, data)(_settled(pair, data, finely)(best, pose), pose)], _CALL
    )


def _settled(pair: Pair, data: Any, finely: Any) -> Any:
    """`(contact, pose) -> contact`: a contact that did not converge is searched again with a small portal."""
    c, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("pose", 12)
    inner = ca.Function("inner", [data], [portal.inner(pair)])
    overlap = c[polish.OFFSET] > 0
    new = finely(ca.if_else(overlap, _behind(c[polish.NORMAL], c[polish.OFFSET]), inner(pose)), pose)
    lower = _rank(new) < _rank(c)
    search = ca.Function("fine", [c, pose], [ca.if_else(lower, new, c)], _CALL)
    same = ca.Function("not_fine", [c, pose], [c])
    switch = ca.Function.conditional("fine_switch", [search], same)
    return ca.Function("settled", [c, pose], [switch(ca.if_else(_good(c), 1, 0), c, pose)], _CALL)


def _slid(pair: Pair, data: Any) -> Any:
    """`(contact, pose) -> contact`: a contact that did not converge descends along the kinks of the offset.

    These are circles of directions around the axes of the shapes, on which two features have equal heights.
    """
    n, height, angle = ca.SX.sym("n", 3), ca.SX.sym("height"), ca.SX.sym("angle")
    best, least = n, height
    for axis in (ca.SX(ca.DM([0, 0, 1])), pair.R[:, 2]):
        for side in (1, -1):
            turned = n * ca.cos(angle) + side * ca.cross(axis, n) * ca.sin(angle)
            turned += axis * ca.dot(axis, n) * (1 - ca.cos(angle))
            turned /= ca.sqrt(ca.sumsqr(turned))
            other = pair.height(turned)
            best, least = ca.if_else(other < least, turned, best), ca.fmin(least, other)
    step = ca.Function("slide", [n, height, angle, data], [best, least], _CALL)
    c, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("pose", 12)
    at = ca.SX.sym("c", polish.SIZE)
    found = polish.plane(pair, at[polish.NORMAL])
    plane = ca.Function("plane", [at, data], [found], _CALL)
    direction, lowest = c[polish.NORMAL], c[polish.OFFSET]
    for k in range(_SLIDES):
        # The angles decrease twice: the descent may be longer than one sequence covers.
        direction, lowest = step(direction, lowest, 0.1 * 0.5 ** (k % (_SLIDES // 2)), pose)
    moved = plane(ca.vertcat(c[: polish.NORMAL.start], direction, c[polish.NORMAL.stop :]), pose)
    lower = moved[polish.OFFSET] < c[polish.OFFSET]
    search = ca.Function("sliding", [c, pose], [ca.if_else(lower, moved, c)], _CALL)
    same = ca.Function("not_sliding", [c, pose], [c])
    switch = ca.Function.conditional("slide_switch", [search], same)
    stays = ca.logic_or(c[polish.SOUND] > 0.5, ca.logic_or(c[polish.OFFSET] <= 0, ca.logic_not(_directed(c))))
    return ca.Function("slid", [c, pose], [switch(ca.if_else(stays, 1, 0), c, pose)], _CALL)


def _certified(data: Any) -> Any:
    """`(contact, triangle) -> 0` where another face may be lower, else 1."""
    c, t = ca.SX.sym("c", polish.SIZE), ca.SX.sym("triangle", 12)
    found = polish.contact(c)
    w, v0 = [t[3 * k : 3 * k + 3] for k in range(3)], t[9:]
    room = ca.SX(_BIG)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        across = ca.cross(w[i] - v0, w[j] - v0)
        across = ca.if_else(ca.dot(across, w[k] - v0) > 0, -across, across)
        room = ca.fmin(room, ca.dot(across, v0) / ca.fmax(ca.norm_2(across), 1e-300))
    enough = ca.logic_and(found.sound, room >= found.offset)
    shallow = ca.logic_and(found.offset <= _SHALLOW, _directed(c))
    return ca.Function("certified", [c, t], [ca.logic_or(shallow, enough)], _CALL)


def _searched(pair: Pair, data: Any, local: Any) -> Any:
    """`(contact, pose) -> contact`: the lowest of the given contact and the results of new searches."""
    c, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("pose", 12)
    candidates, points = _sample(pair.a, pair.b)(pose)
    n = ca.SX.sym("n", 3)
    direct = ca.Function("direct", [n, data], [polish.plane(pair, n / ca.sqrt(ca.sumsqr(n)))], _CALL)
    # Parallel edges have no common perpendicular.
    heights = ca.sum1(candidates * points) + _BIG * (ca.sum1(candidates**2) < 0.5)
    try_one, best, ended = _tried(local), c, c
    near = ca.mmin(heights)
    downhill = ca.MX(1, candidates.size2())
    tried = ca.MX(1, candidates.size2())
    for _ in range(_STARTS):
        # If the height decreases all along the way to a known normal, a search would end there again.
        normal = ended[polish.NORMAL]
        cosine = normal.T @ candidates
        leads = ca.logic_and(cosine > _SAME_WAY, normal.T @ points <= cosine * heights)
        downhill = ca.logic_or(downhill, ca.logic_and(leads, _good(ended)))
        known = ca.logic_and(downhill, heights >= best[polish.OFFSET] - _ROUNDING)
        open_heights = heights + _BIG * ca.logic_or(known, tried)
        lowest = ca.mmin(open_heights)
        direction = candidates[:, ca.find(open_heights.T <= lowest)]
        ended = try_one(best, direction, lowest, near, pose)
        best = ca.if_else(_rank(ended) < _rank(best), ended, best)
        tried = ca.logic_or(tried, direction.T @ candidates > _ITSELF)
    # If no search has reached its height, the lowest direction itself is the result.
    direction = candidates[:, ca.find(heights.T <= near)]
    plane = direct(direction, pose)
    missed = plane[polish.OFFSET] + _MISSED < best[polish.OFFSET]
    best = ca.if_else(ca.logic_or(missed, ca.logic_not(_directed(best))), plane, best)
    return ca.Function("all_ways", [c, pose], [best], _CALL)


def _tried(local: Any) -> Any:
    """`(best, direction, its height, lowest height, pose) -> contact`: the result of a search from there if it may be
    lower, else `best`."""
    c, m, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("m", 3), ca.MX.sym("pose", 12)
    height, near = ca.MX.sym("height"), ca.MX.sym("near")
    offset = c[polish.OFFSET]
    given = [c, m, height, near, pose]
    search = ca.Function("start", given, [local(_behind(m, ca.fmin(near, offset)), pose)], _CALL)
    same = ca.Function("no_start", given, [c])
    switch = ca.Function.conditional("start_switch", [search], same)
    worth = ca.logic_or(height < _WORTH * offset, ca.logic_not(_good(c)))
    return ca.Function("tried", given, [switch(ca.if_else(worth, 0, 1), *given)], _CALL)


def _behind(m: Any, room: Any) -> Any:
    """Start of a ray through the origin that leaves in direction m."""
    return (ca.DM(portal.ASIDE) - 0.4 * m) * ca.fmax(ca.fmin(room, 0.1), 1e-6)


def _rank(c: Any) -> Any:
    """The offset for comparisons: a plane that did not converge must be lower by more than rounding errors."""
    height = c[polish.OFFSET] + _UNSOUND * ca.logic_not(_good(c))
    return ca.if_else(_directed(c), height, _BIG)


def _directed(c: Any) -> Any:
    """Whether there is a normal: a ray through an edge may end without one."""
    return ca.sumsqr(c[polish.NORMAL]) > 0.5


def _good(c: Any) -> Any:
    """Whether a search has converged, with witness points inside the shapes."""
    one, two = c[polish.WEIGHTS[0]], c[polish.WEIGHTS[1]]
    least = ca.fmin(ca.fmin(one, two), 1 - one - two)
    return ca.logic_and(_directed(c), ca.logic_and(c[polish.SOUND] > 0.5, least > -1e-6))


def _drawn_back(data: Any, direction: Any, most: tuple[float, float], local: Any) -> Any:
    """`(contact, pose) -> contact`: a tool that would be pushed through is drawn back, unless that is much farther.

    Shapes alone cannot tell a tool whose tip has come through from one that was set down on its base, but the depths
    can. `most` holds the ratios of depths up to which it is drawn back rather than pushed through, or aside.
    """
    way = ca.Function("way_back", [data], [direction])
    c, pose = ca.MX.sym("c", polish.SIZE), ca.MX.sym("pose", 12)
    back, offset = way(pose), c[polish.OFFSET]
    along = ca.dot(c[polish.NORMAL], back)
    other = local(_behind(back, offset), pose)
    near = other[polish.OFFSET] < ca.if_else(along < -0.5, *most) * offset
    taken = ca.logic_and(ca.logic_and(ca.dot(other[polish.NORMAL], back) > 0.7, near), _good(other))
    search = ca.Function("back", [c, pose], [ca.if_else(taken, other, c)], _CALL)
    same = ca.Function("not_back", [c, pose], [c])
    switch = ca.Function.conditional("back_switch", [search], same)
    wrong = ca.logic_and(along < (0.5 if most[1] else -0.5), offset > _SHALLOW)
    return ca.Function("drawn_back", [c, pose], [switch(ca.if_else(wrong, 0, 1), c, pose)], _CALL)


def _sample(a: Core, b: Core) -> Any:
    """`pose -> (directions (3, k), support points (3, k))`: normals of faces, normals of two edges, a lattice."""
    pose = ca.MX.sym("pose", 12)
    p, R = pose[:3], ca.reshape(pose[3:], 3, 3)
    own = np.vstack([_normals(a), _beside(a), _lattice(_LATTICE)])
    d = ca.horzcat(ca.DM(own.T), -(R @ ca.DM(np.vstack([_normals(b), _beside(b)]).T)))
    pairs = list(product(_edges(a), _edges(b)))
    if pairs and len(pairs) <= _MOST_EDGES:
        one, other = (ca.DM(np.array(side).T) for side in zip(*pairs, strict=True))
        two = R @ other
        across = ca.vertcat(
            one[1, :] * two[2, :] - one[2, :] * two[1, :],
            one[2, :] * two[0, :] - one[0, :] * two[2, :],
            one[0, :] * two[1, :] - one[1, :] * two[0, :],
        )
        # Parallel edges have no common normal; the floor keeps the vector finite, and short.
        across = across / ca.repmat(ca.sqrt(ca.fmax(ca.sum1(across**2), 1e-8)), 3, 1)
        d = ca.horzcat(d, across, -across)
    points = _supports(a, d) - ca.repmat(p, 1, d.size2()) - R @ _supports(b, -(R.T @ d))
    return ca.Function("sample", [pose], [d, points], _CALL)


def _supports(body: Core, d: Any) -> Any:
    """Support points (3, k) of a core for directions (3, k)."""
    if body.half is not None:
        return ca.vertcat(*(ca.if_else(d[k, :] < 0, -h, h) for k, h in enumerate(body.half)))
    count = d.size2()
    across = ca.sqrt(d[0, :] ** 2 + d[1, :] ** 2)
    outward = ca.vertcat(d[:2, :] / ca.repmat(ca.fmax(across, _TINY), 2, 1), ca.MX(1, count))
    best, height = ca.MX(3, count), ca.MX(-_BIG * ca.DM.ones(1, count))
    for row in body.rings:
        centre = ca.DM(row[:3])
        point = ca.repmat(centre, 1, count) + float(row[3]) * outward
        reach = centre.T @ d + float(row[3]) * across
        best = ca.if_else(ca.repmat(reach > height, 3, 1), point, best)
        height = ca.fmax(height, reach)
    return best


def _normals(body: Core) -> Vector:
    """Outward normals (n, 3) of the faces of a core; for one with circles, those of their discs."""
    if body.half is not None or body.round or body.dimension < 3:
        axes = np.eye(3) if body.half is not None else np.eye(3)[2:]
        return np.vstack([axes, -axes])
    from scipy.spatial import ConvexHull as Hull

    return np.asarray(Hull(body.rings[:, :3]).equations[:_MOST_NORMALS, :3])


def _beside(body: Core) -> Vector:
    """Directions (n, 3) near the normals of discs: the lowest plane at a rim may be close to that of its disc."""
    if not body.round:
        return np.zeros((0, 3))
    tilts, around = np.meshgrid(_TILTS, np.arange(_AROUND) * (2 * np.pi / _AROUND))
    across, up = np.sin(tilts.ravel()), np.cos(tilts.ravel())
    one = np.stack([across * np.cos(around.ravel()), across * np.sin(around.ravel()), up], axis=1)
    return np.vstack([one, one * [1, 1, -1]])


def _edges(body: Core) -> Vector:
    """Directions (n, 3) of the edges of a core, and of the straight lines of a round one, of arbitrary sign."""
    if body.half is not None:
        return np.eye(3)
    if body.round or body.dimension < 3:
        return np.eye(3)[2:]
    from scipy.spatial import ConvexHull as Hull

    points = body.rings[:, :3]
    sides = {tuple(sorted(pair)) for face in Hull(points).simplices for pair in combinations(face.tolist(), 2)}
    edges = np.array([points[j] - points[i] for i, j in sorted(sides)])
    return np.asarray(edges / np.linalg.norm(edges, axis=1)[:, None])


def _lattice(count: int) -> Vector:
    """Directions (count, 3) spread evenly over the sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, around = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - z**2)
    return np.stack([np.cos(around) * across, np.sin(around) * across, z], axis=1)
