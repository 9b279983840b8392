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

# Levels between two instants at most: a factor of seven.
_APART = 2.0
# Between two instants an argument is taken for a line, and then looked at again; at most so often.
_PASSES = 12
# Instants put between two others at once, and all of them.
_MOST, _ALL = 500, 100_000
# Instants closer than this share of the time are one.
_ONE = 1e-13


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
        times, values = np.append(times, more), np.vstack([values, at(more)[:, : levels.count]])
        order = np.argsort(times)
        times, values = times[order], values[order]
    return found, columns, True


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
