"""The state of a search for an event: what is left of a stretch, and the guards at the mesh points of one piece."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.events.guards import Moment
from acausal.simulate.events.location.between import LeftGuards
from acausal.simulate.events.location.withdrawn import Withdrawn
from acausal.simulate.solvers.segment import Piece, Segment

Record = Callable[[Vector, Piece], None]

# Rounding of a guard, in its largest value.
_ROUNDED = 1e-12

MOST_STEPS = 10
"""The most steps of a solver from one mesh point to the next."""
STRICTER = 1e-2
"""The factor of the tolerance where a crossing is located."""
FIRST_POINTS = 16
"""The most mesh points of the first call of a one-step method."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Guards at the mesh points of one piece, after those at its start, row `start`, and up to two before; (n, guards).

    `values` are the guards plus an allowance for those that have just left zero, `head` the first rows without it (for
    all others it is zero), `judged` those of `LeftGuards.judged`, `least` the lowest values after the start, (guards,).
    """

    times: Vector
    head: Vector
    values: Vector
    judged: Vector
    least: Vector
    start: int

    def are_away(self, row: int, noise: Vector) -> Truth:
        """Guards that exceed this noise at both ends of the interval behind a row, or at one and beyond the other."""
        outside = self.values[max(row - 1, 0) : row + 3] > noise
        left = outside[: row + 1 - max(row - 1, 0)]
        right = outside[len(left) :]
        return np.asarray(left.any(axis=0) & right.any(axis=0) & (left[-1] | right[0]))

    def plain(self, first: int, last: int) -> Vector:
        """Values of some rows without the allowance; shape (rows, guards)."""
        rows = self.values[first:last].copy(order="K")
        head = self.head[first:last]
        rows[: len(head)] = head
        return rows


@dataclass
class Task:
    """The rest of a stretch, and the state of its search.

    `finer` are nested intervals that are sampled more finely: where each ends, and the distance of its points [s].
    `looked_until` is where the last one of them has ended that is not nested [s]. Guards that are `away` exceed their
    error at both ends of that one, shape (guards,): an excursion that is smaller than their error is one all the same.
    """

    segment: Segment
    moment: Moment
    band: Vector
    start: LeftGuards
    record: Record
    times: Vector
    values: Vector
    largest: Vector
    quadratures_from: Segment
    withdrawn: Withdrawn
    away: Truth = field(default_factory=lambda: np.zeros(0, dtype=bool))
    finer: list[tuple[float, float]] = field(default_factory=list)
    shrink: float = 1.0
    steps_allowed: int = MOST_STEPS
    stops: int = 0
    tolerance_factor: float = STRICTER
    failures: int = 0
    failures_from: float = 0.0
    steps_from: float = 0.0
    steps: float = 0.0
    is_split: bool = False
    looked_until: float = -math.inf
    relations: bytes = b""
    most_points: int = FIRST_POINTS

    def are_ahead(self, mesh: Mesh) -> Truth:
        """Whether guards are not passed yet at mesh points, by their mean rates if they have left zero; (n, guards).

        The mean rate of one that was left above zero by rounding is negative where it is zero again to the last digit.
        """
        ahead = mesh.judged >= 0.0
        if self.start.is_left and not self.finer:
            since = np.maximum(mesh.times - self.start.time, 0.0)[:, None]
            ahead |= (mesh.values >= 0.0) & (mesh.judged * since >= -_ROUNDED * self.largest) & self.start.leaving
        return np.asarray(ahead)


def needs_more_steps(message: str) -> bool:
    """Whether a solver has stopped for want of steps; a one-step method reports only that it has not arrived."""
    return "TOO_MUCH_WORK" in message or message.startswith("segment returned")
