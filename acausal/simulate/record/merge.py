"""Merges the rows of independent systems: rows at the common outputs, and at both sides of each event of any system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acausal.arrays import Indices, Vector
from acausal.simulate.events.guards import Cause
from acausal.simulate.record.boundaries import Boundaries, Boundary


@dataclass(frozen=True, eq=False)
class Rows:
    """The recorded rows of one system in a stretch."""

    # `times`, `x`, `m`: instants (n,), states (nx, n) and modes (nm, n). The first row is the start of the stretch.
    times: Vector
    x: Vector
    m: Vector
    # The events in it: time, causes, changes by `when` clauses. The last rows of their instants are those after them.
    boundaries: Boundaries

    @cached_property
    def shown(self) -> dict[float, list[Boundary]]:
        """Events by their instants, without those that the result does not list."""
        by_time: dict[float, list[Boundary]] = {}
        for b in self.boundaries:
            by_time.setdefault(b[0], []).append(b)
        return {t: events for t, events in by_time.items() if any(b[2] or any(c.text for c in b[1]) for b in events)}

    @cached_property
    def starts(self) -> Indices:
        """Indices of the rows from which it was integrated: the first, and the last at each event."""
        ends = np.searchsorted(self.times, self.boundaries.times, side="right") - 1
        return np.unique(np.concatenate([[np.searchsorted(self.times, self.times[0], side="right") - 1], ends]))


@dataclass(frozen=True, eq=False)
class Merged:
    """Rows of all systems together.

    `events` are the index of the row after each event, its causes, and changes by `when` clauses. `sources` are, for
    each system, its recorded and filled-in states and modes, and the index among them for each row.
    """

    times: Vector
    events: tuple[tuple[int, tuple[Cause, ...], tuple[str, ...]], ...]
    sources: tuple[tuple[Vector, Vector, Indices], ...]

    def values(self, k: int) -> tuple[Vector, Vector]:
        """States and modes of one system at all rows."""
        x, m, columns = self.sources[k]
        return x[:, columns], m[:, columns]


def merged(
    systems: Sequence[Rows], outputs: Vector, fill: Callable[[int, Rows, Vector], tuple[Vector, Vector]]
) -> Merged:
    """Merge the rows at `outputs` and at the events of all systems, without the first row of each.

    `fill(k, rows, times)` returns states and modes of a system at events of other systems.
    """
    events = sorted({t for rows in systems for t in rows.shown})
    if not events:
        alone = [_outputs_only(rows, outputs) for rows in systems]
        if all(columns is not None for columns in alone):
            sources = [(o.x, o.m, columns) for o, columns in zip(systems, alone, strict=True) if columns is not None]
            return Merged(outputs, (), tuple(sources))
    instants = np.union1d(outputs, events) if events else outputs
    positions = [_Positions(rows, instants) for rows in systems]
    left = np.max([o.left for o in positions], axis=0)
    right = np.max([o.right for o in positions], axis=0)
    which = np.repeat(np.arange(len(instants)), left + right)
    number = np.arange(len(which)) - np.repeat(np.cumsum(left + right) - left - right, left + right)
    sources = []
    for k, o in enumerate(positions):
        x, m = o.rows.x, o.rows.m
        if o.missing.any():
            filled = fill(k, o.rows, instants[o.missing])
            x, m = np.hstack([x, filled[0]]), np.hstack([m, filled[1]])
        sources.append((x, m, o.columns(which, number, left)))
    after = []
    for row in np.flatnonzero(number >= left[which]).tolist():
        t, j = float(instants[which[row]]), int(number[row] - left[which[row]])
        same = [b[j] for rows in systems if len(b := rows.shown.get(t, [])) > j]
        after.append((row, tuple(c for b in same for c in b[1] if c.text), tuple(w for b in same for w in b[2])))
    return Merged(instants[which], tuple(after), tuple(sources))


def _outputs_only(rows: Rows, outputs: Vector) -> Indices | None:
    """Columns of a system at outputs without events in between: the last of each; None if some are missing."""
    last = np.searchsorted(rows.times, outputs, side="right") - 1
    return last if last[0] > 0 and np.array_equal(rows.times[last], outputs) else None


class _Positions:
    """Positions of the rows of a system at some instants."""

    def __init__(self, rows: Rows, instants: Vector) -> None:
        self.rows = rows
        inside = rows.times[1:]
        self.first = np.searchsorted(inside, instants, side="left") + 1
        self.last = np.searchsorted(inside, instants, side="right")  # the last row of each instant
        self.missing = self.last < self.first
        self.right = np.array([len(rows.shown.get(t, ())) for t in instants.tolist()], dtype=np.int64)
        alone = self.missing | (self.right == 0)
        self.left = np.where(alone, 1, self.last + 1 - self.first - self.right)
        filled = len(rows.times) + np.cumsum(self.missing) - 1
        # without a listed event, the last row: events that are not listed have happened by then
        self.first = np.where(alone, np.where(self.missing, filled, self.last), self.first)

    def columns(self, which: Indices, number: Indices, left: Indices) -> Indices:
        """The column of the system's values for each merged row.

        A merged row is the `number`-th of the instant `which`, and `left` rows of each instant are before its event.
        """
        following = number - left[which]
        before = self.first[which] + np.minimum(number, self.left[which] - 1)
        after = self.first[which] + self.left[which] + np.minimum(following, self.right[which] - 1)
        last = self.first[which] + self.left[which] - 1
        return np.where(following < 0, before, np.where(self.right[which] > 0, after, last))
