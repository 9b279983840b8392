"""Where a search for events ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.events.guards import STILL, Guards, Moment
from acausal.simulate.events.location.between import root
from acausal.simulate.events.location.mesh import even
from acausal.simulate.solvers.segment import Segment

# The number of mesh points of the polynomial whose root is the instant of an event.
_NEAREST = 8


@dataclass(frozen=True, eq=False)
class Arrival:
    """Where a stretch ends: at an event at `time`, or at its end (None).

    `vague`: The guard of the event if it was never larger than its error; otherwise None.
    `small`: The same with the error that it has before errors of the states have relaxed.
    """

    time: float | None
    x: Vector
    z: Vector
    vague: int | None = None
    small: int | None = None


def root_after(times: Vector, values: Vector, start: int, row: int) -> float:
    """The zero of a guard between a row of a mesh and the next, by the polynomial through the nearest mesh points [s].

    `start`: The first row that belongs to the stretch.
    """
    low = max(start, min(row + 1 - _NEAREST // 2, len(times) - _NEAREST))
    return root(times[low : low + _NEAREST], values[low : low + _NEAREST], row - low)


def up_to(part: Segment, t: float) -> Segment:
    """The same segment with `t` as its only row."""
    fractions = None if part.fractions is None else even(1)
    free = replace(part, times=np.array([t]), fractions=fractions, partial=False, step_budget=None)
    return replace(free, step_budget=free.most_steps)


def first_passed(passed: NDArray[np.intp], which: int, values: Vector, rates: Vector, noise: Vector) -> int:
    """The guard that is passed first, if another one than `which` was passed clearly before the present point.

    `passed`: Guards that are passed in this interval; shape (n,).
    `values`, `rates`, `noise`: All guards at the present point; shape (guards,).
    """
    behind = [k for k in passed.tolist() if values[k] < -STILL * noise[k] and rates[k] < 0.0]
    since = {k: float(values[k] / rates[k]) for k in behind if k != which}
    own = float(values[which] / rates[which]) if rates[which] < 0.0 else 0.0
    return max(since, key=since.__getitem__) if since and max(since.values()) > own else which


def polished(
    guards: Guards, segment: Segment, at: Moment, t: float, guard: int, value: float, end: float
) -> tuple[float, Moment]:
    """The instant and moment where a guard is zero, from those at which it is almost so.

    The states follow their rates for the rest, which is so short that its square does not count. What acts only during
    an excursion that is much smaller than the error of its guard would otherwise last as much longer, or shorter, as
    the instants of both its ends are off.

    `value`: The guard at `t` with its allowance.
    `end`: The last instant that is possible [s].
    """
    problem, n = at.regime.problem, at.regime.problem.n_dynamic
    if not n:
        return t, at
    before = at
    try:
        at = guards.solved(t, at)
        value += float(guards.distances(t, at)[guard] - guards.distances(t, before)[guard])
        _, rates, noise = guards.state(t, at)
        slope, located = float(rates[guard]), float(guards.located(t, at, noise)[guard])
        if located >= STILL * noise[guard] or abs(value) <= located or slope >= 0.0:
            return t, at
        later = t - value / slope
        if later == t or not segment.start < later <= end:
            return t, at
        x, numbers = at.x.copy(), problem.vector(at.m, at.x, t)
        state_rates = problem.scaled.buffered(0.0, at.x[:n] / problem.scale_x, at.z / problem.scale_z, numbers, [])[0]
        x[:n] += (later - t) * np.asarray(state_rates).ravel() * problem.scale_x
        after = guards.solved(later, replace(at, x=x))
    except RuntimeError:  # no solution of the algebraic equations
        return t, before
    distances, new_rates, _ = guards.state(later, after)
    missed = value + float(distances[guard] - guards.distances(t, at)[guard])
    closer = abs(missed) < abs(value) and abs(new_rates[guard] - slope) < 0.5 * abs(slope)
    return (later, after) if closer else (t, at)
