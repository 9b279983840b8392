"""How far a solver comes that has failed: in ever smaller pieces, with few steps for each.

A solution that ends (x' = x^2 at t = 1, an algebraic equation that loses its solution) lets a solver take steps that no
longer change the time, as many as it is allowed. Many steps *are* needed now and then, so that their number alone does
not decide: a piece that fails is divided, and the run is given up when pieces become a billionth of what they were, or
when it has failed too often (behind a pole small pieces arrive somewhere again), or has taken too many steps in all (a
mechanism that turns ten thousand times as fast as it should would be followed for hours).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.solvers.segment import Piece, Segment

RECOVERY_STEPS = 3000
"""Steps between two output times in a piece."""

_DIVISION = 8
_SMALLEST = 1e-9
_MOST_FAILURES = 25
_MOST_STEPS = 200_000  # of all pieces together


def recover(
    integrate: Callable[[Segment], Piece], segment: Segment, record: Callable[[Vector, Piece], Piece]
) -> tuple[Segment, Piece | None]:
    """Record what can be computed of a segment that has failed, in ever smaller pieces.

    `record` takes output times and the values there, and returns these as they are recorded. Returns where it ends,
    and the last piece, unrecorded, when that is the end of the segment after all.
    """
    times = segment.times
    count = max(1, len(times) // 2)
    counted = Counted(integrate)
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
            reached, found = crawl(counted, part)
            if found is None:
                return reached, None
            piece = found
        if count >= len(times):
            return part, piece
        piece = record(part.times, piece)
        times = times[count:]
        segment = replace(segment, start=float(part.times[-1]), x=piece.x[:, -1], z=piece.z[:, -1])
    return segment, None


def crawl(integrate: Counted, segment: Segment) -> tuple[Segment, Piece | None]:
    """Go as far as possible over a segment of one output time.

    Returns where that is, as the segment that is left, and the piece that arrives at the end, if one does.
    """
    end = float(segment.times[-1])
    whole = end - segment.start
    size, done, failures = whole / _DIVISION, 0, 0
    here = replace(segment, step_budget=RECOVERY_STEPS)
    while not integrate.is_exhausted:
        target = here.start + size
        target = end if target > end - 0.01 * size else target
        try:
            piece = integrate(replace(here, times=np.array([target])))
        except RuntimeError:
            size, done, failures = size / _DIVISION, 0, failures + 1
            if failures > _MOST_FAILURES or size < _SMALLEST * whole or here.start + size <= here.start:
                return here, None
            continue
        if target == end:
            return here, piece
        here = replace(here, start=target, x=piece.x[:, -1], z=piece.z[:, -1])
        done += 1
        if done > _DIVISION:  # beyond what has failed as one piece
            size, done = size * _DIVISION, 0
    return here, None


class Counted:
    """An integration that counts its steps; one that fails has taken all that it may."""

    def __init__(self, integrate: Callable[[Segment], Piece]) -> None:
        self._integrate, self._steps = integrate, 0.0

    @property
    def is_exhausted(self) -> bool:
        """Whether no more steps should be spent."""
        return self._steps > _MOST_STEPS

    def __call__(self, segment: Segment) -> Piece:
        self._steps += RECOVERY_STEPS
        piece = self._integrate(segment)
        self._steps += piece.counters.get("steps", 0.0) - RECOVERY_STEPS
        return piece
