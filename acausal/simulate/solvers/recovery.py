"""Integration as far as possible after a solver has failed: in ever smaller pieces, with few steps in each.

Where a solution ends (x' = x^2 at t = 1, or an algebraic equation that loses its solution), a solver uses up its budget
with steps that no longer advance the time. Since some runs do need many steps, their number alone proves nothing. A
piece that fails is divided instead, and the run is abandoned in three cases: pieces have shrunk to a billionth; there
were too many failures (beyond a pole small pieces succeed again); or there were too many steps in all (a mechanism that
turns ten thousand times too fast would be followed for hours).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.solvers.segment import Piece, Segment

RECOVERY_STEPS = 3000
"""Largest number of steps between two output times in a piece."""

_DIVISION = 8
_SMALLEST_FRACTION = 1e-9
_MOST_FAILURES = 25
_MOST_STEPS = 200_000  # of all pieces together


def recover(
    integrate: Callable[[Segment], Piece], segment: Segment, record: Callable[[Vector, Piece], Piece]
) -> tuple[Segment, Piece | None]:
    """Record as much as can be computed of a segment that has failed.

    `record` takes output times and the values there, and returns these as they are recorded. Returns the part of the
    segment at which the integration ended, and the last piece, not yet recorded, if the segment was completed after
    all; otherwise None.
    """
    times = segment.times
    count = max(1, len(times) // 2)
    counted = CountedSteps(integrate)
    while len(times):
        part = replace(segment, times=times[:count], step_budget=RECOVERY_STEPS)
        if counted.is_exhausted:
            return part, None
        try:
            piece = counted(part)
        except RuntimeError:
            if count > 1:
                count = max(1, count // 4)
                continue
            reached, last_piece = crawl(counted, part)
            if last_piece is None:
                return reached, None
            piece = last_piece
        if count >= len(times):
            return part, piece
        piece = record(part.times, piece)
        times = times[count:]
        segment = replace(segment, start=float(part.times[-1]), x=piece.x[:, -1], z=piece.z[:, -1])
    return segment, None


def crawl(integrate: CountedSteps, segment: Segment) -> tuple[Segment, Piece | None]:
    """Integrate as far as possible over a segment with a single output time.

    Returns the remaining segment, and the piece that reaches the end, or None if none does.
    """
    end = float(segment.times[-1])
    length = end - segment.start
    size, successes, failures = length / _DIVISION, 0, 0
    here = replace(segment, step_budget=RECOVERY_STEPS)
    while not integrate.is_exhausted:
        target = here.start + size
        target = end if target > end - 0.01 * size else target
        try:
            piece = integrate(replace(here, times=np.array([target])))
        except RuntimeError:
            size, successes, failures = size / _DIVISION, 0, failures + 1
            if failures > _MOST_FAILURES or size < _SMALLEST_FRACTION * length or here.start + size <= here.start:
                return here, None
            continue
        if target == end:
            return here, piece
        here = replace(here, start=target, x=piece.x[:, -1], z=piece.z[:, -1])
        successes += 1
        if successes > _DIVISION:  # past the piece that failed as a whole
            size, successes = size * _DIVISION, 0
    return here, None


class CountedSteps:
    """An integration that counts its steps; a failure counts as a full budget of steps."""

    def __init__(self, integrate: Callable[[Segment], Piece]) -> None:
        self._integrate, self._steps = integrate, 0.0

    @property
    def is_exhausted(self) -> bool:
        """Whether the budget of all pieces together is used up."""
        return self._steps > _MOST_STEPS

    def __call__(self, segment: Segment) -> Piece:
        self._steps += RECOVERY_STEPS
        piece = self._integrate(segment)
        self._steps += piece.counters.get("steps", 0.0) - RECOVERY_STEPS
        return piece
