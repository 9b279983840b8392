"""Boundaries between the segments of a run, and the events at them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from acausal.arrays import Vector
from acausal.errors import Span
from acausal.result.result import Event
from acausal.simulate.events.guards import Cause
from acausal.simulate.inputs.given import Inputs

Happening = tuple[tuple[Cause, ...], tuple[str, ...]]
"""The causes of an event, and the variables that `when` clauses have changed."""
Boundary = tuple[float, tuple[Cause, ...], tuple[str, ...]]
"""The time of an event [s], with its `Happening`."""

_INPUT_JUMPS: Happening = ((Cause("an input jumps"),), ())


@dataclass(frozen=True, eq=False)
class Boundaries:
    """Boundaries in the order of time, in two lists of equal length.

    The thousands of a short run have a few happenings in common: a tuple for each boundary would keep the garbage
    collector busy for as long as the compiled code takes for ten of them.
    """

    times: list[float] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Boundary]:
        return ((t, *happening) for t, happening in zip(self.times, self.happenings, strict=True))

    def since(self, k: int) -> Boundaries:
        """Those from number `k` on."""
        return Boundaries(self.times[k:], self.happenings[k:])

    def add(self, times: Iterable[float], happenings: Iterable[Happening]) -> None:
        """Add some at the end."""
        self.times.extend(times)
        self.happenings.extend(happenings)

    def remove(self, k: int) -> None:
        """Remove one."""
        del self.times[k], self.happenings[k]

    def cut(self, t: float) -> None:
        """Remove all that are not before `t` [s]."""
        kept = [k for k, time in enumerate(self.times) if time < t]
        self.times[:] = [self.times[k] for k in kept]
        self.happenings[:] = [self.happenings[k] for k in kept]


@dataclass(frozen=True, eq=False)
class EventLog:
    """Boundaries that are events; described only when they are read, as there may be thousands in a short run."""

    boundaries: Boundaries
    instants: Vector

    def __call__(self) -> tuple[Event, ...]:
        """The events: time, text, location, component and changed variables."""
        entries: dict[int, tuple[str, Span | None, str]] = {}  # by identity: thousands of events share a few tuples
        events = []
        for t, causes, changed in self.boundaries:
            if not causes:
                events.append(Event(t, _time_event(t, self.instants), changed=changed))
                continue
            if id(causes) not in entries:
                entries[id(causes)] = _description(causes)
            events.append(Event(t, *entries[id(causes)], changed))
        return tuple(events)


def event_log(boundaries: Boundaries, instants: Vector, inputs: Inputs, cuts: Vector) -> EventLog:
    """The events at the boundaries between segments.

    A boundary without causes is one of the `instants` at which relations of time change, or an instant at which an
    input jumps. It is no event where an input continues with another polynomial, or where a table of time has a kink,
    at one of the `cuts`.
    """
    silent = {*inputs.breaks.tolist(), *cuts.tolist()} - set(instants.tolist())
    jumps = set(inputs.jumps.tolist())
    shown = Boundaries()
    for t, happening in zip(boundaries.times, boundaries.happenings, strict=True):
        causes, changed = happening
        if not (causes or changed) and t in silent:
            if t not in jumps:
                continue
            happening = _INPUT_JUMPS
        elif causes and not (changed or any([c.text for c in causes])):
            continue  # a rate becomes nonzero there, which is no event for the user
        shown.times.append(t)
        shown.happenings.append(happening)
    return EventLog(shown, instants)


@lru_cache(1024)
def _description(causes: tuple[Cause, ...]) -> tuple[str, Span | None, str]:
    """Text, location and component of an event."""
    where = next((c.where for c in causes if c.where is not None), None)
    component = next((c.component for c in causes if c.component), "")
    return "; ".join(dict.fromkeys(c.text for c in causes if c.text)), where, component


def _time_event(t: float, instants: Vector) -> str:
    """Text of an event at `t`, given the instants of all relations of time."""
    count = int(np.sum(np.abs(instants - t) <= 1e-12 * max(1.0, abs(t))))
    return f"time >= {t:g}" + (f" ({count} relations)" if count > 1 else "")
