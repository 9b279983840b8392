"""Faces through which a line enters and leaves a shape: a search, followed by differentiable equations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from acausal.library.contact.collide.axis import polish as axis_polish
from acausal.library.contact.collide.axis import portal as axis_portal
from acausal.library.contact.collide.axis.portal import Body
from acausal.library.contact.collide.chain import frozen, repeat
from acausal.library.contact.collide.minkowski import core
from acausal.library.contact.collide.shapes import Shape

_MOST_TRIANGLE, _MOST_REFINE = 32, 64
"""Largest numbers of iterations; typical are 3 and 3 for boxes, 10 and 20 for round shapes."""

_AT_ONCE = (2, 4)
"""Numbers of steps of both that are done inline: calls would cost more than the steps."""

_FEW_CORNERS = 16

_COARSE, _FINE = 1e-4, 1e-13
"""Largest depth of a portal inside the shape: with circles, which are polished later, and without."""

_NUDGE = (0.43e-11, -0.27e-11, 0.61e-11)
"""Moves the line out of vertices and edges; their faces meet there, so that it does not matter which one is found."""

_SENSES = (-1.0, 1.0)
_CALL = {"never_inline": True}


def faces(shape: Shape, tip: Any, axis: Any) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Normal and a point of the face that a line enters and of the one it leaves; if it does; the foremost point.

    Lengths are in m, SX, and the line is `tip` + t `axis`, in the axes of the shape.
    """
    bounds = np.array(shape.bounding_box())
    unit = float(np.abs(bounds).max())
    body = Body(core(shape, unit), shape.margin / unit, float((bounds[1] - bounds[0]).min()) / (2 * unit))
    p = tip / unit
    found = search(body)(p, axis)
    hit, front = found[0] > 0.5, unit * found[1:4]
    ends = []
    for part, g in zip(ca.vertsplit(found[4:], (found.numel() - 4) // 2), (-axis, axis), strict=True):
        n, point = axis_polish.plane(body.margin, part, p, g) if body.round else (part[:3], part[3:])
        ends += [n, unit * point]
    return ends[0], ends[1], ends[2], ends[3], hit, front


def search(body: Body) -> Any:
    """The Function `(p, e) -> (hit, foremost point, entry, exit)`, without derivatives.

    Entry and exit are unit normal and a point of flat faces, contacts (see `axis_polish`) of round ones.
    """
    P, E = ca.MX.sym("p", 3), ca.MX.sym("e", 3)
    line = ca.vertcat(P + ca.DM(_NUDGE), E)
    thorough = _thorough(body)
    if body.round or len(body.core.rings) > _FEW_CORNERS:
        return frozen("crossing_search", ca.Function("line", [P, E], [thorough(line)], _CALL))
    found = _at_once(body)(line)
    given, values = ca.MX.sym("line", 6), ca.MX.sym("values", found.numel() - 1)
    more = ca.Function("more", [given, values], [thorough(given)], _CALL)
    enough = ca.Function("enough", [given, values], [values])
    switch = ca.Function.conditional("enough_switch", [more], enough)
    return frozen("crossing_search", ca.Function("line", [P, E], [switch(found[0], line, found[1:])], _CALL))


def _at_once(body: Body) -> Any:
    """`line -> (whether it has come to an end, result)` with a few steps, all written out."""
    line = ca.SX.sym("line", 6)
    p, e = line[:3], line[3:]
    d = axis_portal.outset(body, p, e)
    state = axis_portal.begin(body, p, d, body.support(d))
    for _ in range(_AT_ONCE[0]):
        d = axis_portal.beside(state, p, e)
        state = axis_portal.step(state, p, e, d, body.support(d))
    hit, ended = state[axis_portal.HIT], state[axis_portal.SEARCHING] <= 0
    ends = []
    for sense in _SENSES:
        portal = axis_portal.ordered(state, e)
        for _ in range(_AT_ONCE[1]):
            d = axis_portal.outward(portal, e, sense)
            portal = axis_portal.refined(portal, p, e, d, body.support(d), _FINE)
        ended = ca.logic_and(ended, ca.logic_or(portal[axis_portal.REFINING] <= 0, ca.logic_not(hit)))
        ends += [axis_portal.normal(portal), portal[:3]]
    front = body.support(-e)[:3]
    return ca.Function("crossing_at_once", [line], [ca.vertcat(ended, hit, front, *ends)], _CALL)


def _thorough(body: Body) -> Any:
    """`line -> result` in as many steps as necessary."""
    line, triangle = ca.SX.sym("line", 6), ca.SX.sym("triangle", axis_portal.TRIANGLE)
    p, e = line[:3], line[3:]
    begin = _after(body, "begin", [line], axis_portal.outset(body, p, e), partial(axis_portal.begin, body, p))
    front = _after(body, "front", [line], -e, lambda d, found: found[:3])
    beside = axis_portal.beside(triangle, p, e)
    step = _after(body, "triangle", [triangle, line], beside, partial(axis_portal.step, triangle, p, e))
    ordered = ca.Function("ordered", [triangle, line], [axis_portal.ordered(triangle, e)], _CALL)

    s, d = ca.MX.sym("s", axis_portal.TRIANGLE), ca.MX.sym("d", 6)
    ends = [_end(body, sense) for sense in _SENSES]
    both = ca.Function("both", [s, d], [ca.vertcat(*(end(ordered(s, d), d) for end in ends))], _CALL)
    missed = ca.Function("missed", [s, d], [ca.MX.zeros(both.size1_out(0))], _CALL)
    switch = ca.Function.conditional("crossed", [missed], both)
    met = repeat(step, axis_portal.SEARCHING, _MOST_TRIANGLE)(begin(d), d)
    hit = met[axis_portal.HIT]
    return ca.Function("thorough", [d], [ca.vertcat(hit, front(d), switch(hit, met, d))], _CALL)


def _end(body: Body, sense: float) -> Any:
    """`(state of the refinement, line) -> face` towards one end of the line."""
    s, d = ca.MX.sym("s", axis_portal.PORTAL), ca.MX.sym("d", 6)
    state, line = ca.SX.sym("state", axis_portal.PORTAL), ca.SX.sym("line", 6)
    p, g = line[:3], sense * line[3:]
    fine = _refinement(body, sense, _FINE)
    if not body.round:
        face = ca.Function("face", [state], [ca.vertcat(axis_portal.normal(state), state[:3])], _CALL)
        return ca.Function("end", [s, d], [face(fine(s, d))], _CALL)
    contact = axis_polish.solved(body, axis_polish.start(state, g), p, g)
    solve = ca.Function("solve", [state, line], [contact], _CALL)
    again = ca.Function("again", [state], [axis_portal.again(state)], _CALL)
    coarse = _refinement(body, sense, _COARSE)(s, d)
    solution = solve(coarse, d)
    found = ca.MX.sym("found", axis_polish.SIZE)
    finely = ca.Function("finely", [s, found, d], [solve(fine(again(s), d), d)], _CALL)
    same = ca.Function("same", [s, found, d], [found])
    switch = ca.Function.conditional("settled", [finely], same)
    return ca.Function("end", [s, d], [switch(solution[axis_polish.SOUND], coarse, solution, d)], _CALL)


def _refinement(body: Body, sense: float, tolerance: float) -> Any:
    state, line = ca.SX.sym("state", axis_portal.PORTAL), ca.SX.sym("line", 6)
    p, e = line[:3], line[3:]
    after = partial(axis_portal.refined, state, p, e, tolerance=tolerance)
    step = _after(body, "refine", [state, line], axis_portal.outward(state, e, sense), after)
    return repeat(step, axis_portal.REFINING, _MOST_REFINE)


def _after(body: Body, name: str, inputs: list[Any], d: Any, after: Callable[[Any, Any], Any]) -> Any:
    """The Function that applies `after` to a direction d and the vertex found there, both SX of the inputs."""
    if body.round or len(body.core.rings) <= _FEW_CORNERS:
        return ca.Function(name, inputs, [after(d, body.support(d))], _CALL)
    direction = ca.Function("direction", inputs, [d], _CALL)
    way, found = ca.SX.sym("d", 3), ca.SX.sym("found", axis_portal.VERTEX)
    taken = ca.Function("taken", [*inputs, way, found], [after(way, found)], _CALL)
    given = [ca.MX.sym(f"i{k}", x.numel()) for k, x in enumerate(inputs)]
    chosen = direction(*given)
    # All heights as one matrix product: written out they would take twenty instructions each.
    corners = ca.MX(ca.DM(body.core.rings[:, :3].T))
    heights = corners.T @ chosen
    corner = corners[:, ca.find(heights >= ca.mmax(heights))]
    return ca.Function(name, given, [taken(*given, chosen, ca.vertcat(corner, corner, 0))], _CALL)
