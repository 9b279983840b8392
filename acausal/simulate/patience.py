"""How far a solver comes that has failed: in ever smaller pieces, with little patience for each.

A solution that ends (x' = x^2 at t = 1, an algebraic equation that loses its solution) lets a solver take steps that no
longer change the time, as many as it is allowed. Many steps *are* needed now and then, so that their number alone does
not decide: a piece that fails is divided, and the run is given up when pieces become a billionth of what they were, or
when it has failed too often (behind a pole small pieces arrive somewhere again).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from acausal.simulate.solvers.base import Piece, Segment

PATIENCE = 3000
"""Steps between two output times in a piece."""

_DIVISION = 8
_SMALLEST = 1e-9
_MOST_FAILURES = 25


def crawl(integrate: Callable[[Segment], Piece], segment: Segment) -> tuple[Segment, Piece | None]:
    """Go as far as possible over a segment of one output time.

    Returns where that is, as the segment that is left, and the piece that arrives at the end, if one does.
    """
    end = float(segment.times[-1])
    whole = end - segment.start
    size, done, failures = whole / _DIVISION, 0, 0
    here = replace(segment, patience=PATIENCE)
    while True:
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
