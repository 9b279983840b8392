"""Instants between rows at which a steep function has become another one, by a factor at a time.

Between two rows an argument may pass through all that its function does. Products and functions of such functions are
awake where none of them is in its middle: `exp(-v - exp(-v))`, a logistic function times the one that it leaves. But
each of them changes by a factor on the way there, so that instants between which no function changes by more than one
such factor do not pass over any of it. (What is sampled is what the equations are made of, not what they come to:
bounds of rates by intervals say nothing where large terms cancel, as in every stiff equation.)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.levels import Levels
from acausal.simulate.events.location.between import interpolated

# Levels between two instants at most: a factor of seven.
_APART = 2.0
# Between two instants an argument is taken for a line, and then looked at again; at most so often.
_PASSES = 12
# Instants put between two others at once, and all of them.
_MOST, _ALL = 500, 100_000
# Instants closer than this share of the time are one.
_ONE = 1e-13
# Where two instants between neighbours are looked at: no shares of each other, as those of an oscillation may be.
_SHARES = np.array([0.29, 0.618])
# How far beyond what it is off by a cubic may be off between the instants that are looked at, and in levels.
_FARTHER, _TOLD = 10.0, 1.0
_NODES = 4


def between(
    times: Vector, values: Vector, levels: Levels, is_steep: Truth, at: Callable[[Vector], Vector]
) -> tuple[Vector, NDArray[np.intp], bool]:
    """Instants, the function of each that becomes another around it, and whether these are all.

    `times`, `values`: Where arguments turn at the latest, and the arguments there; shapes (n,) and (n, columns).
    `is_steep`: Which of the k functions are looked at; shape (k,).
    `at`: Columns of values at other instants.
    """
    own = np.flatnonzero(is_steep)
    found, columns = np.zeros(0), np.zeros(0, dtype=np.intp)
    if not len(own) or len(times) < 2:
        return found, columns, True
    values = values[:, : levels.count]
    largest = np.maximum(np.abs(values).max(axis=0), 1e-300)
    nearest = _ONE * max(abs(float(times[0])), abs(float(times[-1])))
    for _ in range(_PASSES):
        known = levels.of(values, largest)
        apart = np.abs(np.diff(known[:, own], axis=0)) * (np.diff(times) > nearest)[:, None]
        behind, which = np.nonzero(apart > _APART)
        if not len(behind):
            return found, columns, True
        count = np.minimum(np.ceil(apart[behind, which] / _APART).astype(np.intp), _MOST)
        if len(found) + count.sum() > _ALL:
            return found, columns, False
        more, of = _on_a_line(times, values, known, levels, largest, behind, own[which], count)
        found, columns = np.append(found, more), np.append(columns, of)
        more = np.setdiff1d(more, times)
        times, values = merged(times, values, more, at(more)[:, : levels.count])
    return found, columns, True


def dense(
    times: Vector, values: Vector, levels: Levels, is_awake: Truth, at: Callable[[Vector], Vector]
) -> tuple[Vector, Vector, bool]:
    """Instants between which cubics tell arguments to a level, with `values` there; whether these are all.

    Rows tell how states go, not what an argument makes of them and of time: `sin(w*t)` turns often while every state
    rests. As `between`, but for `is_awake`: on which of the functions something depends; shape (k,).
    """
    own = np.flatnonzero(is_awake)
    largest = np.maximum(np.abs(values[:, : levels.count]).max(axis=0), 1e-300)
    nearest = _ONE * max(abs(float(times[0])), abs(float(times[-1])))
    is_open = np.ones(len(times) - 1, dtype=bool)
    for _ in range(_PASSES):
        behind = np.flatnonzero(is_open & (np.diff(times) > nearest / _SHARES[0]))
        if not len(behind):
            return times, values, True
        if len(times) + 2 * len(behind) > _ALL:
            return times, values, False
        gap = np.diff(times)[behind]
        more = (times[behind][:, None] + gap[:, None] * _SHARES).ravel()
        there, told = at(more), interpolated(times, values[:, : levels.count], more, min(_NODES, len(times)))[0]
        off = _FARTHER * np.abs(there[:, : levels.count] - told)
        low, high = (levels.of(there[:, : levels.count] + sign * off, largest)[:, own] for sign in (-1.0, 1.0))
        is_off = (np.abs(high - low) > _TOLD).any(axis=1).reshape(-1, len(_SHARES)).any(axis=1)
        if not is_off.any():
            return times, values, True
        # what is told beside what is not may be so by chance
        is_open[:] = False
        is_open[behind[is_off]] = True
        is_open = is_open | np.append(is_open[1:], False) | np.append(False, is_open[:-1])
        chosen = np.repeat(is_open[behind], len(_SHARES))
        parts = np.ones(len(is_open), dtype=np.intp)
        parts[behind[is_open[behind]]] += len(_SHARES)
        is_open = np.repeat(is_open, parts)
        times, values = merged(times, values, more[chosen], there[chosen])
    return times, values, True


def merged(times: Vector, values: Vector, more: Vector, there: Vector) -> tuple[Vector, Vector]:
    """Ascending instants and values there, with those at more instants; shapes (n,) and (n, columns)."""
    times, values = np.append(times, more), np.vstack([values, there])
    order = np.argsort(times)
    return times[order], values[order]


def _on_a_line(
    times: Vector,
    values: Vector,
    known: Vector,
    levels: Levels,
    largest: Vector,
    behind: NDArray[np.intp],
    columns: NDArray[np.intp],
    count: NDArray[np.intp],
) -> tuple[Vector, NDArray[np.intp]]:
    """`count[j]` instants at even levels behind row `behind[j]`, the last of which is in the middle of the rows."""
    place = np.repeat(np.arange(len(behind)), count)
    number = np.arange(len(place)) - np.repeat(np.cumsum(count) - count, count) + 1
    low, j = behind[place], columns[place]
    share = number / count[place]
    level = known[low, j] + share * (known[low + 1, j] - known[low, j])
    rise = values[low + 1, j] - values[low, j]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (levels.arguments(level, j, largest) - values[low, j]) / rise
    along = np.where((number == count[place]) | ~np.isfinite(along), 0.5, np.clip(along, 0.0, 1.0))
    return times[low] + along * (times[low + 1] - times[low]), j
