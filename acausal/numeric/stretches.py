"""Stretches of a table: successive rows that form one smooth curve within an error that depends on the tolerance.

Neighbours are joined as long as a cubic through four of their points stays within the error everywhere. Two stretches
meet where no cubic joins them: at a kink, a jump, or where a curve is too long for one cubic. Independent pairs are
joined in rounds, in n log n operations of numpy: 100 000 rows of noise or of a sine take less than a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Indices, Vector

# Relative positions in a stretch at which the cubic interpolates the table.
_NODES = np.array([0.0, 0.25, 0.75, 1.0])
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_NODES, increasing=True)).T
# Relative positions in each row at which the cubic is compared with the table.
_COMPARED = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
# Largest number of rounds; an early stop leaves more stretches than necessary, which does no harm.
_MOST_ROUNDS = 80
# Least variation as a fraction of the range of the values, for tables in which most values are equal.
_LEAST_VARIATION = 1e-3


def variation(values: Vector) -> float:
    """Mean absolute deviation of values, shape (n,), from their median, to which a single peak contributes little."""
    return max(float(np.abs(values - np.median(values)).mean()), _LEAST_VARIATION * float(np.ptp(values)))


def stretches(ends: Vector, rows: Vector, error: float) -> Indices:
    """First row of each stretch, followed by the number of rows; ascending, shape (n_stretches + 1,).

    Parameters
    ----------
    ends
        Shape (n + 1,): abscissas at the beginnings of n rows, and at the end of the last one.
    rows
        Shape (n, degree + 1): coefficients of each row by powers of the distance from its beginning, the constant
        first.
    error
        Largest deviation of a cubic, in the unit of the values.
    """
    n = len(rows)
    lengths = np.diff(ends)
    values = _horner(rows[:, None, :], lengths[:, None] * _COMPARED)
    abscissas = ends[:-1, None] + lengths[:, None] * _COMPARED

    def are_one_cubic(first: Indices, last: Indices) -> NDArray[np.bool_]:
        """Whether the rows from each `first` up to its `last` form one cubic; shapes (k,)."""
        left, length = ends[first], ends[last] - ends[first]
        at = left[:, None] + length[:, None] * _NODES
        row_at = np.clip(np.searchsorted(ends, at, side="right") - 1, first[:, None], last[:, None] - 1)
        cubic = _horner(rows[row_at], at - ends[row_at]) @ _TO_COEFFICIENTS
        counts = last - first
        begins = np.concatenate([[0], np.cumsum(counts)[:-1]])
        stretch = np.repeat(np.arange(len(first)), counts)
        row = np.arange(len(stretch)) - begins[stretch] + first[stretch]
        relative = (abscissas[row] - left[stretch, None]) / length[stretch, None]
        deviation = np.abs(_horner(cubic[stretch][:, None, :], relative) - values[row]).max(axis=1)
        return np.asarray(np.maximum.reduceat(deviation, begins) <= error)

    bounds, tried = np.arange(n + 1), np.zeros(n + 1, dtype=bool)
    tried[[0, -1]] = True
    for _ in range(_MOST_ROUNDS):
        untried = np.flatnonzero(~tried)
        if not len(untried):
            break
        runs = np.concatenate([[0], np.cumsum(np.diff(untried) > 1)])
        first = np.concatenate([[0], np.flatnonzero(np.diff(runs)) + 1])
        chosen = untried[(np.arange(len(untried)) - first[runs]) % 2 == 0]  # no two of these bound the same stretch
        is_joined = are_one_cubic(bounds[chosen - 1], bounds[chosen + 1])
        tried[chosen] = True
        removed = chosen[is_joined]
        tried[removed - 1] = tried[removed + 1] = False  # neighbours have changed
        tried[[0, -1]] = True
        bounds, tried = np.delete(bounds, removed), np.delete(tried, removed)
    return bounds


def _horner(coefficients: Vector, at: Vector) -> Vector:
    """Polynomials at `at`, by Horner's scheme; coefficients along the last axis, the constant first."""
    value = np.broadcast_to(coefficients[..., -1], at.shape)
    for k in range(coefficients.shape[-1] - 2, -1, -1):
        value = coefficients[..., k] + at * value
    return np.asarray(value)
