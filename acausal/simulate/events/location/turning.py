"""Where guards may fall and rise again between two mesh points, by their rates there, as in dips.c.

The lines of `between.py` through neighbouring mesh points show a turn only where these are close: with six of them in a
period, `abs(x - c) < w` along an oscillation was passed unnoticed at every second place near its peaks, whatever w was.
Rates are evaluated only where a guard changes by as much as its distance from zero.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.events.guards import Guards
from acausal.simulate.events.location.between import lowest, near_zero
from acausal.simulate.events.location.task import Mesh, Task
from acausal.simulate.solvers.segment import Piece

# The fraction of the depth of a cubic below its ends by which it may be wrong, as in dips.c.
_CUBIC_ERROR = 0.0625
# A guard that changes so many times as fast as it is far from zero is in a transient, of which its ends show nothing.
_MOST_CHANGE = 1e3


def excursions(
    guards: Guards, task: Task, mesh: Mesh, piece: Piece, rows: NDArray[np.int64], last: int, until: int
) -> tuple[Vector, Truth]:
    """Lower bounds of guards in the intervals up to mesh point `last`, and which may be passed there and back.

    Both have shape (last, guards), or no rows if no bound is negative. Mesh points before `until` show how guards bend.
    """
    intervals, lows = lowest(mesh.times[:until], mesh.judged[:until])
    turns, dips = turning(guards, task, mesh, piece, rows, last)
    known = intervals < last
    if not ((lows[known] < 0.0).any() or (dips < 0.0).any()):
        return np.zeros((0, lows.shape[1])), np.zeros((0, lows.shape[1]), dtype=bool)
    bounds = np.full((last, lows.shape[1]), np.inf)
    bounds[turns] = dips
    bounds[intervals[known]] = np.fmin(bounds[intervals[known]], lows[known])
    ahead = task.are_ahead(mesh)[: last + 1]
    may_pass = (bounds < 0.0) & ahead[:-1] & ahead[1:]
    may_pass[: mesh.start] = False
    return bounds, may_pass


def turning(
    guards: Guards, task: Task, mesh: Mesh, piece: Piece, rows: NDArray[np.int64], last: int
) -> tuple[NDArray[np.intp], Vector]:
    """Intervals up to mesh point `last` in which guards may turn, shape (m,), and lower bounds there, inf where not.

    The bounds have shape (m, guards).
    """
    times, values = mesh.times[: last + 1], mesh.values[: last + 1]
    near, h = np.union1d(0, near_zero(times, values)), np.diff(times)[:, None]
    near = near[near >= mesh.start]
    p, q, earlier = values[near], values[near + 1], np.maximum(near - 1, 0)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        change, before = np.abs(q - p), np.abs(p - values[earlier]) / h[earlier] * h[near]
        before[near == 0] = np.abs(task.start.rates) * h[0]
        may = (p > 0.0) & (q > 0.0) & ~((change + before < p) & (change + before < q))
        if times[0] == task.start.time:
            may[near == 0] &= ~task.start.leaving  # judged by their mean rates
        found = np.flatnonzero(may.any(axis=1))
        near, p, q, may = near[found], p[found], q[found], may[found]
        if not len(near):
            return near, p
        ends, at_end = np.unique(np.concatenate([near, near + 1]), return_inverse=True)
        rates, away = np.zeros((len(ends), p.shape[1])), np.zeros((len(ends), p.shape[1]), dtype=bool)
        for k, end in enumerate(ends.tolist()):
            row = None if end == mesh.start else rows[end - mesh.start - 1]
            x, z = (task.segment.x, task.segment.z) if row is None else (piece.x[:, row], piece.z[:, row])
            # errors between steps, in which a current through 1e-5 Ohm turns, although it does not at their ends
            at = replace(task.moment, x=x, z=z)
            rates[k], noise = guards.rates(float(times[end]), at, between=True)
            away[k] = values[end] > noise
        first, second = at_end.reshape(2, -1)
        bounds = _lowest(p, rates[first] * h[near], q, rates[second] * h[near])
        return near, np.where(may & away[first] & away[second], bounds, np.inf)


def _lowest(p: Vector, a: Vector, q: Vector, b: Vector) -> Vector:
    """Lower bounds of guards from p to q that change by a and b at the rates of both ends; inf where they do not turn.

    As `dip_of` in dips.c.
    """
    square, cube, least = 3.0 * (q - p) - 2.0 * a - b, a + b - 2.0 * (q - p), np.minimum(p, q)
    inside = square**2 - 3.0 * a * cube
    r = -(square + np.copysign(np.sqrt(np.maximum(inside, 0.0)), square))
    lowest = np.full(p.shape, np.inf)
    for s in (r / (3.0 * cube), a / r):
        turns: Truth = (inside > 0.0) & (s > 0.0) & (s < 1.0)
        value = p + s * (a + s * (square + s * cube))
        lowest = np.where(turns, np.minimum(lowest, value), lowest)
    bound = np.where(lowest < least, lowest - _CUBIC_ERROR * (least - lowest), np.inf)
    # a kink, of which a cubic shows little, if one of the tangents leads below zero
    greatest = _MOST_CHANGE * np.maximum(p, q)
    kinks = (a < 0.0) & (b > 0.0) & (a > -greatest) & (b < greatest)
    return np.where(kinks, np.fmin(bound, np.minimum(p + a, q - b)), bound)
