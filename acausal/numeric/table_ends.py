"""Ends of the stretches of a table, and those of them at which a run has to stop."""

from __future__ import annotations

from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.language.expressions.lookup import Lookup
from acausal.numeric.stretches import stretches, variation

# Largest deviation of a stretch, as a fraction of the tolerance times the variation of its table.
_ERROR_FRACTION = 0.1
# Largest ratio of the lengths of stretches in one group.
_LENGTH_RATIO = 4.0
# A kink is sudden if it exceeds each of this many kinks before it by this factor.
_COMPARED_BEFORE, _SUDDEN_FACTOR = 8, 8.0
# Up to `MOST_STOPS` ends are all stops; beyond that, groups of more than `_LEAST_REGULAR` stretches are regular.
MOST_STOPS, _LEAST_REGULAR = 500, 16
# By table and tolerance, because every run requests the same few.
_CACHE: WeakKeyDictionary[Lookup, dict[float, Vector]] = WeakKeyDictionary()
_MOST_CACHED = 16


def table_ends(table: Lookup, relative: float) -> Vector:
    """Arguments at which stretches of a table end, ascending, without the ends of the table; shape (k,).

    `relative` is the tolerance of the run, relative to the variation of the table.
    """
    cached = _CACHE.setdefault(table, {})
    if relative not in cached:
        if len(cached) >= _MOST_CACHED:
            cached.clear()
        cached[relative] = _ends(table, relative)
    return cached[relative]


def _ends(table: Lookup, relative: float) -> Vector:
    ends, rows = np.array(table.breaks), np.array(table.coefficients)
    variation_of_table = variation(np.append(rows[:, 0], np.polyval(rows[-1, ::-1], ends[-1] - ends[-2])))
    if variation_of_table == 0.0:
        return np.zeros(0)
    return np.asarray(ends[stretches(ends, rows, _ERROR_FRACTION * relative * variation_of_table)[1:-1]])


def regular_groups(ends: Vector) -> tuple[list[float], list[float]]:
    """Group successive stretches of similar length.

    `ends`, shape (k,), are the ends of the stretches, ascending. Returns the ends of the groups, n_groups + 1 of them,
    and half the length of the shortest stretch of each group, infinite for a group of one stretch.
    """
    marks, halves = [float(ends[0])], list[float]()
    shortest = longest = 0.0
    count = 0
    for a, b in pairwise(ends.tolist()):
        length = b - a
        if count and max(longest, length) <= _LENGTH_RATIO * min(shortest, length):
            shortest, longest, count = min(shortest, length), max(longest, length), count + 1
            continue
        if count:
            marks.append(a)
            halves.append(0.5 * shortest if count > 1 else np.inf)
        shortest = longest = length
        count = 1
    marks.append(float(ends[-1]))
    halves.append(0.5 * shortest if count > 1 else np.inf)
    return marks, halves


def stops(table: Lookup, relative: float) -> Vector:
    """Arguments at which a run stops, whichever way the argument moves along the table; ascending, shape (k,).

    These are all ends of stretches if there are at most `MOST_STOPS`. In a longer table, regular groups of stretches of
    similar length and with similar kinks are left to the error control of the integrator, whose steps adapt to them;
    otherwise a table of noise would stop the run at every row.
    """
    ends = table_ends(table, relative)
    if len(ends) <= MOST_STOPS:
        return ends
    bounds = np.concatenate([[table.breaks[0]], ends, [table.breaks[-1]]])
    lengths = np.diff(bounds)
    kinks = np.abs(np.diff(np.diff(_interpolate(table, bounds)) / lengths))
    sizes = kinks * np.minimum(lengths[:-1], lengths[1:])
    marks = np.searchsorted(bounds, regular_groups(bounds)[0])
    is_regular = np.repeat(np.diff(marks) > _LEAST_REGULAR, np.diff(marks))  # whether a stretch is in a regular group
    is_within = is_regular[:-1] & is_regular[1:] & ~np.isin(np.arange(1, len(lengths)), marks)
    return np.asarray(ends[~is_within | _sudden(sizes) | _sudden(sizes[::-1])[::-1]])


def _sudden(sizes: Vector) -> NDArray[np.bool_]:
    """Which sizes, shape (n,), are much larger than each of the `_COMPARED_BEFORE` sizes before them."""
    padded = np.append(np.zeros(_COMPARED_BEFORE), sizes)
    before = np.lib.stride_tricks.sliding_window_view(padded, _COMPARED_BEFORE)[: len(sizes)].max(axis=1)
    return np.asarray(sizes > _SUDDEN_FACTOR * before)


def _interpolate(table: Lookup, arguments: Vector) -> Vector:
    """Values of a table at `arguments`, shape (k,)."""
    ends, rows = np.array(table.breaks), np.array(table.coefficients)
    row = np.clip(np.searchsorted(ends, arguments, side="right") - 1, 0, len(rows) - 1)
    s = arguments - ends[row]
    value = rows[row, -1].copy()
    for k in range(rows.shape[1] - 2, -1, -1):
        value = rows[row, k] + s * value
    return np.asarray(value)
