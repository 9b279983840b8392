"""Guards that stay within their error although they fall.

A tank that drains by the root of its level reaches zero with the rate zero. The solution of an explicit method stays
above zero for ever, by less than the tolerance: each step falls as far as the last one rose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.events.guards import Guards, Moment
from acausal.simulate.solvers.segment import Piece

# A guard within its error is overdue if its rate would have taken it this multiple of its distance from zero. It is
# looked at where it is less than this fraction of its largest value, at so many mesh points.
_OVERDUE, _SMALL, _LAST_POINTS = 10.0, 1e-2, 4


@dataclass(frozen=True)
class Overdue:
    """A `guard`, the first of the last rows in which it is within its error, and that error, its `noise`."""

    guard: int
    entry: int
    noise: float


def overdue(
    guards: Guards,
    moment: Moment,
    times: Vector,
    values: Vector,
    largest: Vector,
    piece: Piece,
    rows: NDArray[np.int64],
) -> Overdue | None:
    """A guard that should have been passed at the end of a piece.

    `times`, `values`: The start of the piece and its n mesh points, and the guards there; shapes (n + 1,) and (n + 1,
    guards).
    `largest`: The largest values of the guards in this stretch; shape (guards,).
    `rows`: Which rows of the piece are mesh points; shape (n,).
    """
    last = len(rows)
    small = (values[last] <= _SMALL * largest) & (moment.regime.active_set.side < 0)
    if not small.any():
        return None
    rate = noise = largest
    for row in range(last, max(last - _LAST_POINTS, 0), -1):
        at = replace(moment, x=piece.x[:, rows[row - 1]], z=piece.z[:, rows[row - 1]])
        rate, noise = guards.rates(float(times[row]), at)
        small &= (values[row] > 0.0) & (values[row] <= noise) & (rate < 0.0)
    for guard in np.flatnonzero(small).tolist():
        outside = np.flatnonzero(values[:, guard] > noise[guard])
        entry = int(outside[-1]) + 1 if len(outside) else 0
        highest = float(values[entry:, guard].max(initial=0.0))
        if -float(rate[guard]) * float(times[last] - times[min(entry, last)]) > _OVERDUE * highest:
            return Overdue(guard, entry, float(noise[guard]))
    return None
