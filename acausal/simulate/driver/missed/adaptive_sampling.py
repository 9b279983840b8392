"""Adaptive sampling of the arguments of steep functions between the rows of a solution.

Between two rows an argument may pass through the whole range in which its function changes. Products and compositions
of such functions can be active where no factor is in its middle: `exp(-v - exp(-v))`, or a logistic function times its
own complement. On the way there, however, each factor changes by orders of magnitude, so that no activity is missed
between instants between which no function changes by more than one such factor. The arguments are sampled, and not the
rates bounded by intervals, because interval bounds are useless where large terms cancel, as in every stiff equation.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.equations.levels import Levels
from acausal.simulate.events.location.between import interpolated

# The largest change of a function between two samples, in levels; two levels are a factor of seven.
_LARGEST_CHANGE = 2.0
# The largest number of passes, in each of which the argument is assumed to be linear between two samples.
_PASSES = 12
# The most samples put between two others at once, and the most samples altogether.
_MOST_AT_ONCE, _MOST = 500, 100_000
# Instants closer than this fraction of the time coincide.
_SAME_INSTANT = 1e-13
# Where an interval between two samples is tested, as fractions of it. They are not multiples of each other, because
# the zeros of an oscillation may be.
_TESTED = np.array([0.29, 0.618])
# The error of a cubic in the interval is estimated as this multiple of its error at the tested instants. The second
# number is the largest change of a function by it, in levels.
_ERROR_GROWTH, _LARGEST_ERROR = 10.0, 1.0
_NODES = 4


def level_changes(
    times: Vector, values: Vector, levels: Levels, is_steep: Truth, at: Callable[[Vector], Vector]
) -> tuple[Vector, NDArray[np.intp], bool]:
    """Instants around which a function changes by several levels, the index of that function, and if these are all.

    `times`, `values`: Ascending instants that include all turning points of the arguments, and the arguments there;
    shapes (n,) and (n, columns).
    `is_steep`: Which of the k functions are examined; shape (k,).
    `at`: Returns the columns of `values` at other instants.
    """
    examined = np.flatnonzero(is_steep)
    found, columns = np.zeros(0), np.zeros(0, dtype=np.intp)
    if not len(examined) or len(times) < 2:
        return found, columns, True
    values = values[:, : levels.count]
    largest = np.maximum(np.abs(values).max(axis=0), 1e-300)
    shortest = _SAME_INSTANT * max(abs(float(times[0])), abs(float(times[-1])))
    for _ in range(_PASSES):
        level = levels.of(values, largest)
        change = np.abs(np.diff(level[:, examined], axis=0)) * (np.diff(times) > shortest)[:, None]
        row, which = np.nonzero(change > _LARGEST_CHANGE)
        if not len(row):
            return found, columns, True
        count = np.minimum(np.ceil(change[row, which] / _LARGEST_CHANGE).astype(np.intp), _MOST_AT_ONCE)
        if len(found) + count.sum() > _MOST:
            return found, columns, False
        added, of = _evenly_in_level(times, values, level, levels, largest, row, examined[which], count)
        found, columns = np.append(found, added), np.append(columns, of)
        added = np.setdiff1d(added, times)
        times, values = merged(times, values, added, at(added)[:, : levels.count])
    return found, columns, True


def resolving_samples(
    times: Vector, values: Vector, levels: Levels, is_effective: Truth, at: Callable[[Vector], Vector]
) -> tuple[Vector, Vector, bool]:
    """Instants between which cubics represent arguments to within a level, the `values` there, and if these are all.

    Rows represent the states, but not what an argument makes of states and time: `sin(w*t)` turns often while every
    state rests. The arguments are as in `level_changes`, except for `is_effective`: on which of the functions any rate
    depends; shape (k,).
    """
    examined = np.flatnonzero(is_effective)
    largest = np.maximum(np.abs(values[:, : levels.count]).max(axis=0), 1e-300)
    shortest = _SAME_INSTANT * max(abs(float(times[0])), abs(float(times[-1])))
    is_open = np.ones(len(times) - 1, dtype=bool)
    for _ in range(_PASSES):
        row = np.flatnonzero(is_open & (np.diff(times) > shortest / _TESTED[0]))
        if not len(row):
            return times, values, True
        if len(times) + 2 * len(row) > _MOST:
            return times, values, False
        gap = np.diff(times)[row]
        tested = (times[row][:, None] + gap[:, None] * _TESTED).ravel()
        exact, predicted = (
            at(tested),
            interpolated(times, values[:, : levels.count], tested, min(_NODES, len(times)))[0],
        )
        error = _ERROR_GROWTH * np.abs(exact[:, : levels.count] - predicted)
        low, high = (levels.of(exact[:, : levels.count] + sign * error, largest)[:, examined] for sign in (-1.0, 1.0))
        is_wrong = (np.abs(high - low) > _LARGEST_ERROR).any(axis=1).reshape(-1, len(_TESTED)).any(axis=1)
        if not is_wrong.any():
            return times, values, True
        # the neighbours of an unresolved interval are tested again, as they may have passed by chance
        is_open[:] = False
        is_open[row[is_wrong]] = True
        is_open = is_open | np.append(is_open[1:], False) | np.append(False, is_open[:-1])
        chosen = np.repeat(is_open[row], len(_TESTED))
        parts = np.ones(len(is_open), dtype=np.intp)
        parts[row[is_open[row]]] += len(_TESTED)
        is_open = np.repeat(is_open, parts)
        times, values = merged(times, values, tested[chosen], exact[chosen])
    return times, values, True


def merged(times: Vector, values: Vector, added: Vector, added_values: Vector) -> tuple[Vector, Vector]:
    """Instants in ascending order and the values there, with others merged in; shapes (n,) and (n, columns)."""
    times, values = np.append(times, added), np.vstack([values, added_values])
    order = np.argsort(times)
    return times[order], values[order]


def _evenly_in_level(
    times: Vector,
    values: Vector,
    level: Vector,
    levels: Levels,
    largest: Vector,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    count: NDArray[np.intp],
) -> tuple[Vector, NDArray[np.intp]]:
    """`count[j]` instants between row `rows[j]` and the next, evenly spaced in level; the last one is the midpoint.

    Arguments are taken as linear there.
    """
    index = np.repeat(np.arange(len(rows)), count)
    number = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count) + 1
    low, j = rows[index], columns[index]
    fraction = number / count[index]
    target = level[low, j] + fraction * (level[low + 1, j] - level[low, j])
    rise = values[low + 1, j] - values[low, j]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (levels.arguments(target, j, largest) - values[low, j]) / rise
    along = np.where((number == count[index]) | ~np.isfinite(along), 0.5, np.clip(along, 0.0, 1.0))
    return times[low] + along * (times[low + 1] - times[low]), j
