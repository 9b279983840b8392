"""Stretches of a table on each of which its rows are one curve, as far as a run of some tolerance can tell.

Neighbours are joined while a cubic through four of their points comes within the error of all of them. What is
between two stretches no cubic joins: a kink, a jump, or the place at which a curve has gone on for long enough. Rounds
of independent pairs take n log n operations, all in numpy: 100 000 rows of noise or of a sine take below a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Indices, Vector

# Where in a stretch the cubic passes through the table, and where in each row it is compared.
_NODES = np.array([0.0, 0.25, 0.75, 1.0])
_THROUGH = np.linalg.inv(np.vander(_NODES, increasing=True)).T
_SEEN = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
# Rounds after which rows are left as they are: more stretches than need be are no error.
_MOST_ROUNDS = 80
# The least size of a variation, by the largest one: most of the values may be equal.
_LEAST = 1e-3


def variation(values: Vector) -> float:
    """How much values vary: the mean distance from their middle, which a single peak does not make large."""
    return max(float(np.abs(values - np.median(values)).mean()), _LEAST * float(np.ptp(values)))


def stretches(ends: Vector, rows: Vector, error: float) -> Indices:
    """The first rows of all stretches, and the number of rows behind them; ascending.

    `ends`: Abscissas of n rows and the end of the last one, shape (n + 1,).
    `rows`: Coefficients of each row in the distance from its beginning, the constant first, shape (n, degree + 1).
    `error`: How far a cubic may be off, in the units of the values.
    """
    n = len(rows)
    lengths = np.diff(ends)
    values = _horner(rows[:, None, :], lengths[:, None] * _SEEN)
    places = ends[:-1, None] + lengths[:, None] * _SEEN

    def joined(first: Indices, last: Indices) -> NDArray[np.bool_]:
        """Whether the rows from each `first` up to each `last` are one cubic."""
        left, length = ends[first], ends[last] - ends[first]
        at = left[:, None] + length[:, None] * _NODES
        inside = np.clip(np.searchsorted(ends, at, side="right") - 1, first[:, None], last[:, None] - 1)
        cubic = _horner(rows[inside], at - ends[inside]) @ _THROUGH
        counts = last - first
        begins = np.concatenate([[0], np.cumsum(counts)[:-1]])
        own = np.repeat(np.arange(len(first)), counts)
        row = np.arange(len(own)) - begins[own] + first[own]
        share = (places[row] - left[own, None]) / length[own, None]
        off = np.abs(_horner(cubic[own][:, None, :], share) - values[row]).max(axis=1)
        return np.asarray(np.maximum.reduceat(off, begins) <= error)

    bounds, tried = np.arange(n + 1), np.zeros(n + 1, dtype=bool)
    tried[[0, -1]] = True
    for _ in range(_MOST_ROUNDS):
        open_ = np.flatnonzero(~tried)
        if not len(open_):
            break
        runs = np.concatenate([[0], np.cumsum(np.diff(open_) > 1)])
        first = np.concatenate([[0], np.flatnonzero(np.diff(runs)) + 1])
        chosen = open_[(np.arange(len(open_)) - first[runs]) % 2 == 0]  # no two of them share a stretch
        good = joined(bounds[chosen - 1], bounds[chosen + 1])
        tried[chosen] = True
        gone = chosen[good]
        tried[gone - 1] = tried[gone + 1] = False  # neighbours have changed
        tried[[0, -1]] = True
        bounds, tried = np.delete(bounds, gone), np.delete(tried, gone)
    return bounds


def _horner(coefficients: Vector, at: Vector) -> Vector:
    """Polynomials with their coefficients along the last axis, the constant first."""
    found = np.broadcast_to(coefficients[..., -1], at.shape)
    for k in range(coefficients.shape[-1] - 2, -1, -1):
        found = coefficients[..., k] + at * found
    return np.asarray(found)
