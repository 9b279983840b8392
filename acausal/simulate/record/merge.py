"""Rows of several systems as rows of one: common outputs, and both sides of every event of any of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from acausal.arrays import Indices, Vector
from acausal.simulate.events.guards import Cause

Boundary = tuple[float, tuple[Cause, ...], tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Rows:
    """What one system recorded in a stretch."""

    # `times`, `x`, `m`: the rows: instants (n,), states (nx, n), modes (nm, n). The first is that of the start of the
    # stretch.
    times: Vector
    x: Vector
    m: Vector
    # The events in it: time, causes, what clauses did. The last rows of their instants are those behind them.
    boundaries: tuple[Boundary, ...]

    @cached_property
    def shown(self) -> dict[float, list[Boundary]]:
        """Events by their instants, but where nothing is to be told."""
        found: dict[float, list[Boundary]] = {}
        for b in self.boundaries:
            found.setdefault(b[0], []).append(b)
        return {t: all_ for t, all_ in found.items() if any(b[2] or any(c.text for c in b[1]) for b in all_)}

    @cached_property
    def starts(self) -> Indices:
        """Rows from which it was integrated: the first, and the last of each instant of an event."""
        ends = np.searchsorted(self.times, [b[0] for b in self.boundaries], side="right") - 1
        return np.unique(np.concatenate([[np.searchsorted(self.times, self.times[0], side="right") - 1], ends]))


@dataclass(frozen=True, eq=False)
class Merged:
    """Rows of the whole: `events` are the rows behind one, with causes and what clauses did.

    `sources` are for each system the columns of its own values, those it recorded and then those filled in.
    """

    times: Vector
    events: tuple[tuple[int, tuple[Cause, ...], tuple[str, ...]], ...]
    sources: tuple[tuple[Vector, Vector, Indices], ...]

    def values(self, k: int) -> tuple[Vector, Vector]:
        """States and modes of one system at all rows."""
        x, m, columns = self.sources[k]
        return x[:, columns], m[:, columns]


def merged(all_: Sequence[Rows], outputs: Vector, fill: Callable[[int, Rows, Vector], tuple[Vector, Vector]]) -> Merged:
    """The rows at `outputs` and at the events of all systems, without the first of each.

    `fill(k, rows, times)` gives states and modes of a system at events of others.
    """
    events = sorted({t for rows in all_ for t in rows.shown})
    if not events:
        alone = [_alone(rows, outputs) for rows in all_]
        if all(columns is not None for columns in alone):
            sources = [(o.x, o.m, columns) for o, columns in zip(all_, alone, strict=True) if columns is not None]
            return Merged(outputs, (), tuple(sources))
    instants = np.union1d(outputs, events) if events else outputs
    own = [_Own(rows, instants) for rows in all_]
    left = np.max([o.left for o in own], axis=0)
    right = np.max([o.right for o in own], axis=0)
    which = np.repeat(np.arange(len(instants)), left + right)
    number = np.arange(len(which)) - np.repeat(np.cumsum(left + right) - left - right, left + right)
    sources = []
    for k, o in enumerate(own):
        x, m = o.rows.x, o.rows.m
        if o.missing.any():
            filled = fill(k, o.rows, instants[o.missing])
            x, m = np.hstack([x, filled[0]]), np.hstack([m, filled[1]])
        sources.append((x, m, o.columns(which, number, left)))
    told = []
    for row in np.flatnonzero(number >= left[which]).tolist():
        t, j = float(instants[which[row]]), int(number[row] - left[which[row]])
        here = [b[j] for rows in all_ if len(b := rows.shown.get(t, [])) > j]
        told.append((row, tuple(c for b in here for c in b[1] if c.text), tuple(w for b in here for w in b[2])))
    return Merged(instants[which], tuple(told), tuple(sources))


def _alone(rows: Rows, outputs: Vector) -> Indices | None:
    """Columns of a system at outputs between which nothing is shown: their last; None where it has not all of them."""
    last = np.searchsorted(rows.times, outputs, side="right") - 1
    return last if last[0] > 0 and np.array_equal(rows.times[last], outputs) else None


class _Own:
    """Where a system has rows at some instants."""

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
        # where nothing is shown, the last row: what is silent has happened
        self.first = np.where(alone, np.where(self.missing, filled, self.last), self.first)

    def columns(self, which: Indices, number: Indices, left: Indices) -> Indices:
        """The column of its values for each row: the number-th of an instant, `left` of them before the event."""
        behind = number - left[which]
        before = self.first[which] + np.minimum(number, self.left[which] - 1)
        after = self.first[which] + self.left[which] + np.minimum(behind, self.right[which] - 1)
        last = self.first[which] + self.left[which] - 1
        return np.where(behind < 0, before, np.where(self.right[which] > 0, after, last))
