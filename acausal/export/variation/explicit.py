"""Explicit steps of order 8 (DOP853) with exact derivatives, until the equations turn out to be stiff."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from acausal.arrays import Vector
from acausal.export.variation.control import Control
from acausal.export.variation.element import LEAST, SMALL, Interval, Stiffness
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import EXPLICIT_3, EXPLICIT_5, EXPLICIT_A, EXPLICIT_C, EXPLICIT_STAGES

# Stiffness detection as in DOP853 of Hairer, Nørsett and Wanner: end of the stability region on the negative real axis,
# number of steps beyond it after which the equations count as stiff, and number of steps inside it that resets this
# count. At tight tolerances the step size stays just inside the region; therefore a step also counts if a component
# decays faster than the given rate (second number), although the error estimate allows it. Oscillations do not count.
_STABLE, _DAMPED, _SUSPECTS, _CLEARED = 6.1, 2.5, 15, 6
# The rate of decay if the variations limit the step: small ones that have decayed are sensitive to the error of the
# states.
_DAMPED_VARIATIONS = 0.5


@dataclass(frozen=True, eq=False)
class ExplicitElement:
    """See `Element`; `slopes` are matrices by variables and parameters, one for each stage."""

    t: float
    w: Vector
    x: Vector
    h: float
    slopes: list[Any]

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """See `Element`."""
        k, n = rows.shape
        total = np.zeros((k, self.slopes[0].shape[1] - n))
        by_stage = np.zeros((EXPLICIT_STAGES, k, n))
        for i in range(EXPLICIT_STAGES - 1, -1, -1):
            by_rate = self.h * (EXPLICIT_A[-1, i] * rows + _weighted(EXPLICIT_A[i + 1 : -1, i], by_stage[i + 1 :]))
            found = (self.slopes[i].T @ by_rate.T).T
            by_stage[i] = found[:, :n]
            total += found[:, n:]
        return rows + by_stage.sum(axis=0), total


def _weighted(weights: Vector, stages: Vector) -> Vector:
    """The sum of stages (s, n, k) by their weights, (n, k); `np.tensordot` takes five times as long for it."""
    s, n, k = stages.shape
    return (weights @ stages.reshape(s, n * k)).reshape(n, k)


def explicit(
    slopes: Slopes, interval: Interval, stiffness: Stiffness, x: Vector, parameters: bool
) -> Iterator[ExplicitElement]:
    """Yield steps over an interval until they turn out to be stiff, or a step fails at every length.

    `x`, shape (nx, k), are variations at the start; with `parameters` they are those by the chosen parameters.
    """
    c, m = interval.numbers
    t, w, end = interval.start, interval.w, interval.ends[-1]
    tolerance, ends, h = interval.tolerance, iter(interval.ends), 0.0
    until = next(ends)
    control, suspects, cleared = Control(interval.accuracy, tolerance, x, t), 0, 0
    while t < end:
        if t >= until:
            until = next(ends)
        if h == 0.0:
            rate = float(np.abs(slopes.buffered(t, w, c, m)[0] / (SMALL + np.abs(w))).max(initial=1e-12))
            h = tolerance ** (1 / 8) / rate
        whole, h = h, until - t if t + 1.01 * h >= until else h
        if t + h <= t or h < LEAST * (end - interval.start):
            return
        stages, rates = _stages(slopes, interval, t, h, w)
        error = _error(h, w, stages[-1], rates, tolerance) if np.isfinite(rates).all() else np.inf
        matrices, after, damped = [], x, _DAMPED
        if error <= 1 and x.shape[1]:
            _, entries = slopes.many(t + h * EXPLICIT_C, stages, c, m)
            matrices = _matrices(slopes, entries)
            after, variation_error = _variations(t, h, x, matrices, parameters, control)
            damped = _DAMPED_VARIATIONS if variation_error > error else _DAMPED
            error = max(error, variation_error)
        if np.isfinite(error) and _is_held_back(h, stages[-1] - stages[-2], rates[-1] - rates[-2], damped):
            suspects, cleared = suspects + 1, 0
            if suspects >= _SUSPECTS:
                stiffness.stiff = True
                return
        elif np.isfinite(error):
            cleared += 1
            suspects = 0 if cleared >= _CLEARED else suspects
        growth = 0.9 * error ** (-1 / 8) if error > 0 else 8.0
        if not error <= 1:
            h *= control.shorter(max(0.2, min(growth, 0.9))) if np.isfinite(error) else 0.25
            continue
        t, w, x = until if h == until - t else t + h, stages[-1].copy(), control.accepted(after)
        yield ExplicitElement(t, w, x, h, matrices[:-1])
        h = control.longer(h, whole, growth)


def _stages(slopes: Slopes, interval: Interval, t: float, h: float, w: Vector) -> tuple[Vector, Vector]:
    """Stages of a step and its end, and their rates, shapes (EXPLICIT_STAGES + 1, n)."""
    c, m = interval.numbers
    stages, rates = np.empty((2, EXPLICIT_STAGES + 1, len(w)))
    for i in range(EXPLICIT_STAGES + 1):
        stages[i] = w + h * (EXPLICIT_A[i, :i] @ rates[:i])
        rates[i] = slopes.buffered(t + h * EXPLICIT_C[i], stages[i], c, m)[0]
    return stages, rates


def _variations(
    t: float, h: float, x: Vector, slopes: list[Any], parameters: bool, control: Control
) -> tuple[Vector, float]:
    """(Variations at the end of a step, shape (nx, k); error of the worst column, in units of the allowed error)."""
    n = len(x)
    rates = np.zeros((EXPLICIT_STAGES + 1, *x.shape))
    at = x
    for i, slope in enumerate(slopes):
        at = x + h * _weighted(EXPLICIT_A[i, :i], rates[:i])
        rates[i] = slope[:, :n] @ at
        if parameters:
            by_p = _full(slope[:, n:])
            rates[i, :, : by_p.shape[1]] += by_p
    if not np.isfinite(rates).all():
        return at, np.inf
    if control.accuracy is None:
        return at, 0.0
    own_x, own_at = x[:, : control.count], at[:, : control.count]
    allowed = control.allowed(own_x, own_at)
    errors = [_weighted(own, rates[:, :, : control.count]) for own in (EXPLICIT_5, EXPLICIT_3)]
    five, three = (np.sum((error / allowed) ** 2, axis=0) for error in errors)
    return at, control.judged(t, h, float(_estimate(h, five, three, n).max()), own_at - own_x, h * errors[0])


def _is_held_back(h: float, points: Vector, rates: Vector, damped: float) -> bool:
    """Whether stability limits the step: its length times the slope between its last two points reaches a limit."""
    size = float(points @ points)
    slope, damping = np.sqrt(float(rates @ rates) * size), -float(points @ rates)
    return bool(size > 0 and (h * slope > _STABLE * size or h * damping > damped * size))


def _error(h: float, w: Vector, end: Vector, rates: Vector, tolerance: float) -> float:
    size = tolerance * (SMALL + np.maximum(np.abs(w), np.abs(end)))
    five, three = (np.sum((weights @ rates / size) ** 2) for weights in (EXPLICIT_5, EXPLICIT_3))
    return float(_estimate(h, five, three, len(w)))


def _estimate(h: float, five: Any, three: Any, n: int) -> Any:
    """The error of a step from the sums of squares of both embedded errors over its n variables."""
    both = (five + 0.01 * three) * n
    return h * five / np.sqrt(np.where(both > 0, both, 1.0))


def _matrices(slopes: Slopes, entries: Vector) -> list[Any]:
    if slopes.is_small:
        return list(slopes.dense(entries))
    shape = slopes.n, slopes.n + slopes.count
    return [scipy.sparse.csc_matrix((own, slopes.rows, slopes.starts), shape=shape) for own in entries]


def _full(matrix: Any) -> Vector:
    return np.asarray(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
