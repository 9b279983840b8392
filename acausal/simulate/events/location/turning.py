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
from acausal.simulate.events.location.task import Mesh, Task
from acausal.simulate.solvers.segment import Piece

# The fraction of the depth of a cubic below its ends by which it may be wrong, as in dips.c.
_CUBIC_ERROR = 0.0625
# A guard that changes so many times as fast as it is far from zero is in a transient, of which its ends show nothing.
_MOST_CHANGE = 1e3


def turning(guards: Guards, task: Task, mesh: Mesh, piece: Piece, rows: NDArray[np.int64], last: int) -> Vector:
    """Lower bounds of guards in the intervals up to mesh point `last`, inf where they do not turn; (last, guards)."""
    values, h = mesh.values[: last + 1], np.diff(mesh.times[: last + 1])[:, None]
    p, q = values[:-1], values[1:]
    bounds = np.full(p.shape, np.inf)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        change = np.abs(q - p)
        before = np.vstack([np.abs(task.start.rates)[None] * h[:1], change[:-1] / h[:-1] * h[1:]])
        may = (p > 0.0) & (q > 0.0) & ~((change + before < p) & (change + before < q))
        may[: mesh.start] = False
        if mesh.times[0] == task.start.time:
            may[0] &= ~task.start.leaving  # judged by their mean rates
        near = np.flatnonzero(may.any(axis=1))
        if not len(near):
            return bounds
        ends = np.unique(np.concatenate([near, near + 1]))
        rates, away = np.full(values.shape, np.nan), np.zeros(values.shape, dtype=bool)
        x = np.column_stack([task.segment.x, piece.x[:, rows]])
        z = np.column_stack([task.segment.z, piece.z[:, rows]])
        for k in ends.tolist():
            at = replace(task.moment, x=x[:, k - mesh.start], z=z[:, k - mesh.start])
            # errors between steps, in which a current through 1e-5 Ohm turns, although it does not at their ends
            rates[k], noise = guards.rates(float(mesh.times[k]), at, between=True)
            away[k] = values[k] > noise
        a, b = rates[near] * h[near], rates[near + 1] * h[near]
        known = may[near] & away[near] & away[near + 1]
        bounds[near] = np.where(known, _lowest(p[near], a, q[near], b), np.inf)
    return bounds


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
