"""Instants of `sample(start, interval)`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.state_events import Clause
from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.events.errors import not_a_clock

# A tick as near as this to an instant, by the interval of the clock, is at it; times are known to their rounding.
_NEAR, _ROUNDING = 1e-9, 4.0 * float(np.finfo(float).eps)


def clocks(compiled: CompiledModel, p: Vector) -> list[tuple[float, float]]:
    """Start and interval of each sample [s]."""
    pool = compiled.solution.structure.reduced.pool
    leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
    found = []
    for number in compiled.state_events.samples:
        _, a, b = pool.nodes[number]
        known = values(pool, [a, b], leaves)
        first, interval = float(known[a]), float(known[b])
        if not (np.isfinite(first) and 0.0 < interval < np.inf):
            raise not_a_clock(compiled.name, first, interval, users(compiled, number))
        found.append((first, interval))
    return found


def users(compiled: CompiledModel, sample: int) -> list[Clause]:
    """Clauses whose condition holds a sample."""
    pool = compiled.solution.structure.reduced.pool
    return [c for c in compiled.state_events.clauses if sample in pool.reachable(c.conditions)]


def sample_times(compiled: CompiledModel, p: Vector, start: float, stop: float) -> Vector:
    """All instants of samples between two times [s], clock by clock."""
    return np.concatenate([np.zeros(0), *(_ticks(*clock, start, stop) for clock in clocks(compiled, p))])


def due(compiled: CompiledModel, p: Vector, times: Vector) -> Vector:
    """Which samples are true at n instants, ascending, shape (n, samples).

    A tick belongs to the instant next to it, however far that is by the interval: at 1e6 s a clock of 1 ms is known to
    1e-7 of its interval, and instants of a long run that cannot be told apart have become one.
    """
    found = np.zeros((len(times), len(compiled.state_events.samples)))
    for k, clock in enumerate(clocks(compiled, p)):
        found[_nearest(times, _ticks(*clock, times[0], times[-1])), k] = 1.0
    return found


def _ticks(first: float, interval: float, start: float, stop: float) -> Vector:
    """The ticks of a clock between two times; those count that are as near to them as can be told."""
    near = _NEAR + _ROUNDING * max(abs(first), abs(start), abs(stop)) / interval
    k = np.arange(max(0.0, np.ceil((start - first) / interval - near)), np.floor((stop - first) / interval + near) + 1)
    return first + interval * k


def _nearest(times: Vector, ticks: Vector) -> NDArray[np.int64]:
    """Places of the times, ascending, that are next to the ticks."""
    if len(times) == 1:
        return np.zeros(len(ticks), dtype=np.int64)
    right = np.clip(np.searchsorted(times, ticks), 1, len(times) - 1)
    return np.where(ticks - times[right - 1] <= times[right] - ticks, right - 1, right)
