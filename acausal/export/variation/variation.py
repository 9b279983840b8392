"""Variations over stretches of one regime, in compiled code if available."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from acausal.arrays import Vector
from acausal.export.variation.compiled import Program, program
from acausal.export.variation.element import LEAST, SMALL, Element, Interval, Stiffness
from acausal.export.variation.radau import radau
from acausal.export.variation.slopes import Slopes
from acausal.export.variation.tables import EXPLICIT_3, EXPLICIT_5, EXPLICIT_A, EXPLICIT_C, EXPLICIT_STAGES
from acausal.lower.compiled import CompiledModel
from acausal.simulate.native.policy import pays

# Cost of a step in Python, in evaluations of the equations.
_STEP = 300.0


class Variation:
    """Linear maps of stretches of one regime, cached with the model."""

    def __init__(self, compiled: CompiledModel, chosen: list[int]) -> None:
        self.slopes = Slopes(compiled, chosen)
        self._program: Program | None = None
        self._tried: set[bool] = set()
        self._spent = 0.0

    def carry(
        self, interval: Interval, x: Vector, stiffness: Stiffness, native: bool | None, *, parameters: bool = True
    ) -> Iterator[tuple[float, Vector, Vector]]:
        """Yield (time [s], variables (n,), variations (nx, k)) at each end of the interval.

        `x`: variations at its start, shape (nx, k). All are scaled by nominal magnitudes. With `parameters` the columns
        are directions of the chosen parameters.
        """
        compiled = self._compiled(native)
        if compiled is not None:
            for t, w, there in compiled.carry(interval, x, parameters, stiffness):
                interval, x = _rest(interval, t, w), there
                yield t, w, there
        ends = set(interval.ends)
        for element in self._elements(interval, stiffness):
            x = element.forward(x, parameters)
            if element.t in ends:
                yield element.t, element.w, x

    def back(
        self, interval: Interval, rows: Vector, stiffness: Stiffness, native: bool | None
    ) -> tuple[Vector, Vector]:
        """Pull back `rows`, shape (k, nx), to states at the start, same shape, and to parameters, shape (k, count)."""
        compiled = self._compiled(native)
        found = None if compiled is None else compiled.back(interval, rows, stiffness)
        if found is not None:
            return found
        total = np.zeros((len(rows), self.slopes.count))
        for element in reversed(list(self._elements(interval, stiffness))):
            rows, by_p = element.adjoint(rows)
            total = total + by_p
        return rows, total

    def is_compiled(self, native: bool | None) -> bool:
        """Whether steps are compiled."""
        return self._compiled(native) is not None

    def _elements(self, interval: Interval, stiffness: Stiffness) -> Iterator[Element]:
        """Steps in Python."""
        slopes = self.slopes
        if interval.ends and not stiffness.stiff and slopes.n == slopes.nx:
            for element in explicit(slopes, interval, stiffness):
                self._spent += _STEP
                interval = _rest(interval, element.t, element.w)
                yield element
        if interval.ends:
            for step in radau(slopes, interval):
                self._spent += _STEP
                yield step

    def _compiled(self, native: bool | None) -> Program | None:
        if native is False or self._program is not None:
            return None if native is False else self._program
        allowed = native is True or pays(self._spent, self.slopes.instructions)
        if allowed not in self._tried:
            self._tried.add(allowed)
            self._program = program(self.slopes, allowed)
        return self._program


def _rest(interval: Interval, t: float, w: Vector) -> Interval:
    """The rest of an interval from one of its points on."""
    return Interval(t, [end for end in interval.ends if end > t], w, interval.numbers, interval.tolerance)


# The end of the method's region of stability on the negative axis; so many steps beyond it are stiff ones, so many on
# this side of it are not (Hairer, Nørsett, Wanner, DOP853). At tight tolerances steps hover on this side of it: what
# decays so fast and yet is not seen by their error counts as well, oscillations do not.
_STABLE, _DAMPED, _SUSPECTS, _CLEARED = 6.1, 2.5, 15, 6


@dataclass(frozen=True, eq=False)
class ExplicitElement:
    """See `Element`; `slopes` are matrices by variables and parameters, one for each stage."""

    t: float
    w: Vector
    h: float
    slopes: list[Any]

    def forward(self, x: Vector, parameters: bool = True) -> Vector:
        """See `Element`."""
        n = len(x)
        rates = np.zeros((EXPLICIT_STAGES, *x.shape))
        for i, slope in enumerate(self.slopes):
            at = x + self.h * _weighted(EXPLICIT_A[i, :i], rates[:i])
            rates[i] = slope[:, :n] @ at
            if parameters:
                rates[i] += _full(slope[:, n:])
        return np.asarray(x + self.h * _weighted(EXPLICIT_A[-1], rates))

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """See `Element`."""
        k, n = rows.shape
        total = np.zeros((k, self.slopes[0].shape[1] - n))
        on = np.zeros((EXPLICIT_STAGES, k, n))  # what each stage is worth
        for i in range(EXPLICIT_STAGES - 1, -1, -1):
            rate = self.h * (EXPLICIT_A[-1, i] * rows + _weighted(EXPLICIT_A[i + 1 : -1, i], on[i + 1 :]))
            found = (self.slopes[i].T @ rate.T).T
            on[i] = found[:, :n]
            total += found[:, n:]
        return rows + on.sum(axis=0), total


def _weighted(weights: Vector, stages: Vector) -> Vector:
    """The sum of stages (s, n, k) by their weights, (n, k); `np.tensordot` takes five times as long for it."""
    s, n, k = stages.shape
    return (weights @ stages.reshape(s, n * k)).reshape(n, k)


def explicit(slopes: Slopes, interval: Interval, stiffness: Stiffness) -> Iterator[ExplicitElement]:
    """The steps, as far as they are not stiff; no more come where one fails at every length."""
    c, m = interval.numbers
    t, w, end = interval.start, interval.w, interval.ends[-1]
    tolerance, ends, h = interval.tolerance, iter(interval.ends), 0.0
    until = next(ends)
    suspects = cleared = 0
    while t < end:
        if t >= until:
            until = next(ends)
        if h == 0.0:
            rate = float(np.abs(slopes.buffered(t, w, c, m)[0] / (SMALL + np.abs(w))).max(initial=1e-12))
            h = tolerance ** (1 / 8) / rate
        whole, h = h, until - t if t + 1.01 * h >= until else h
        if t + h <= t or h < LEAST * (end - interval.start):
            return
        stages, rates = np.empty((2, EXPLICIT_STAGES + 1, len(w)))
        for i in range(EXPLICIT_STAGES + 1):
            stages[i] = w + h * (EXPLICIT_A[i, :i] @ rates[:i])
            rates[i] = slopes.buffered(t + h * EXPLICIT_C[i], stages[i], c, m)[0]
        error = _error(h, w, stages[-1], rates, tolerance) if np.isfinite(rates).all() else np.inf
        if np.isfinite(error) and _is_held_back(h, stages[-1] - stages[-2], rates[-1] - rates[-2]):
            suspects, cleared = suspects + 1, 0
            if suspects >= _SUSPECTS:
                stiffness.stiff = True
                return
        elif np.isfinite(error):
            cleared += 1
            suspects = 0 if cleared >= _CLEARED else suspects
        growth = 0.9 * error ** (-1 / 8) if error > 0 else 8.0
        if not error <= 1:
            h *= max(0.2, min(growth, 0.9)) if np.isfinite(error) else 0.25
            continue
        _, entries = slopes.many(t + h * EXPLICIT_C[:-1], stages[:-1], c, m)
        t, w = until if h == until - t else t + h, stages[-1].copy()
        yield ExplicitElement(t, w, h, _matrices(slopes, entries))
        h = max(h * min(max(growth, 0.3), 8.0), whole if h < whole else 0.0)


def _is_held_back(h: float, points: Vector, rates: Vector) -> bool:
    """Whether the slope that the last two points of a step tell is as large as the step allows."""
    size = float(points @ points)
    slope, damping = np.sqrt(float(rates @ rates) * size), -float(points @ rates)
    return bool(size > 0 and (h * slope > _STABLE * size or h * damping > _DAMPED * size))


def _error(h: float, w: Vector, end: Vector, rates: Vector, tolerance: float) -> float:
    size = tolerance * (SMALL + np.maximum(np.abs(w), np.abs(end)))
    five, three = (float(np.sum((weights @ rates / size) ** 2)) for weights in (EXPLICIT_5, EXPLICIT_3))
    return h * five / np.sqrt((five + 0.01 * three) * len(w)) if five > 0 else 0.0


def _matrices(slopes: Slopes, entries: Vector) -> list[Any]:
    if slopes.is_small:
        return list(slopes.dense(entries))
    shape = slopes.n, slopes.n + slopes.count
    return [scipy.sparse.csc_matrix((own, slopes.rows, slopes.starts), shape=shape) for own in entries]


def _full(matrix: Any) -> Vector:
    return np.asarray(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
