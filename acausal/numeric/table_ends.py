"""Where the stretches of a table end that a run of some tolerance can tell, and where it has to stop among them."""

from __future__ import annotations

from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.language.expressions.lookup import Lookup
from acausal.numeric.stretches import stretches, variation

# Share of the tolerance by which a stretch may be off, by the size of the variation of its table.
_SHARE = 0.1
# Stretches that follow one another are alike where the longest is so many times as long.
_ALIKE = 4.0
# How many kinks before one are looked at, and how much larger it is where they do not announce it.
_RECENT, _SUDDEN = 8, 8.0
# Stops of one table up to which it has all, and stretches that are alike which make a row of them.
MOST_STOPS, _ROW = 500, 16
# By table and tolerance: every run asks for the same few.
_KNOWN: WeakKeyDictionary[Lookup, dict[float, Vector]] = WeakKeyDictionary()
_MOST_KNOWN = 16


def table_ends(table: Lookup, relative: float) -> Vector:
    """The arguments at which stretches of a table end, ascending."""
    known = _KNOWN.setdefault(table, {})
    if relative not in known:
        if len(known) >= _MOST_KNOWN:
            known.clear()
        known[relative] = _ends(table, relative)
    return known[relative]


def _ends(table: Lookup, relative: float) -> Vector:
    ends, rows = np.array(table.breaks), np.array(table.coefficients)
    size = variation(np.append(rows[:, 0], np.polyval(rows[-1, ::-1], ends[-1] - ends[-2])))
    if size == 0.0:
        return np.zeros(0)
    return np.asarray(ends[stretches(ends, rows, _SHARE * relative * size)[1:-1]])


def alike(ends: Vector) -> tuple[list[float], list[float]]:
    """Stretches that follow one another and are about as long, from the first of `ends` to the last.

    Returns the ends of each group, and half of its shortest stretch, infinite where it is one stretch.
    """
    marks, halves = [float(ends[0])], list[float]()
    least = most = 0.0
    count = 0
    for a, b in pairwise(ends.tolist()):
        length = b - a
        if count and max(most, length) <= _ALIKE * min(least, length):
            least, most, count = min(least, length), max(most, length), count + 1
            continue
        if count:
            marks.append(a)
            halves.append(0.5 * least if count > 1 else np.inf)
        least = most = length
        count = 1
    marks.append(float(ends[-1]))
    halves.append(0.5 * least if count > 1 else np.inf)
    return marks, halves


def stops(table: Lookup, relative: float) -> Vector:
    """Where a run stops whose argument moves along a table in any way, ascending.

    At all ends where there are up to `MOST_STOPS`. Of more, the steps that have followed a row of stretches that are
    about as long, with kinks that are about as large, are taken to follow the next; noise would be a stop at each row.
    """
    own = table_ends(table, relative)
    if len(own) <= MOST_STOPS:
        return own
    whole = np.concatenate([[table.breaks[0]], own, [table.breaks[-1]]])
    lengths = np.diff(whole)
    turns = np.abs(np.diff(np.diff(_at(table, whole)) / lengths))
    sizes = turns * np.minimum(lengths[:-1], lengths[1:])
    marks = np.searchsorted(whole, alike(whole)[0])
    many = np.repeat(np.diff(marks) > _ROW, np.diff(marks))  # of each stretch, whether it is one of many
    inside = many[:-1] & many[1:] & ~np.isin(np.arange(1, len(lengths)), marks)
    return np.asarray(own[~inside | _sudden(sizes) | _sudden(sizes[::-1])[::-1]])


def _sudden(sizes: Vector) -> NDArray[np.bool_]:
    """Which are much larger than the few before them."""
    padded = np.append(np.zeros(_RECENT), sizes)
    before = np.lib.stride_tricks.sliding_window_view(padded, _RECENT)[: len(sizes)].max(axis=1)
    return np.asarray(sizes > _SUDDEN * before)


def _at(table: Lookup, places: Vector) -> Vector:
    """The values of a table."""
    ends, rows = np.array(table.breaks), np.array(table.coefficients)
    row = np.clip(np.searchsorted(ends, places, side="right") - 1, 0, len(rows) - 1)
    s = places - ends[row]
    found = rows[row, -1].copy()
    for k in range(rows.shape[1] - 2, -1, -1):
        found = rows[row, k] + s * found
    return np.asarray(found)
