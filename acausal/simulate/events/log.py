"""The events of a run as its result lists them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acausal.arrays import Vector
from acausal.errors import Span
from acausal.result.result import Event
from acausal.simulate.events.guards import Cause
from acausal.simulate.inputs.given import Inputs


def event_log(
    boundaries: Sequence[tuple[float, tuple[Cause, ...], tuple[str, ...]]],
    instants: Vector,
    inputs: Inputs,
    cuts: Vector,
) -> tuple[Event, ...]:
    """Time, words, place, component and changed variables of each boundary between two segments.

    A boundary without causes is one of the `instants` at which relations of time change, or one at which an input over
    time jumps; where the input goes on with another polynomial nothing happens, nor where a table of time only bends,
    at one of the `cuts`.
    """
    silent = {*inputs.breaks.tolist(), *cuts.tolist()} - set(instants.tolist())
    jumps = set(inputs.jumps.tolist())
    known: dict[int, tuple[str, Span | None, str]] = {}  # by identity: thousands of events share a few tuples
    found = []
    for t, causes, changed in boundaries:
        if causes and not changed and not any(c.text for c in causes):
            continue  # a rate wakes there
        if not causes and not changed and t in silent:
            if t in jumps:
                found.append(Event(t, "an input jumps"))
            continue
        if not causes:
            found.append(Event(t, _of_time(t, instants), changed=changed))
            continue
        if id(causes) not in known:
            where = next((c.where for c in causes if c.where is not None), None)
            component = next((c.component for c in causes if c.component), "")
            known[id(causes)] = "; ".join(dict.fromkeys(c.text for c in causes if c.text)), where, component
        found.append(Event(t, *known[id(causes)], changed))
    return tuple(found)


def _of_time(t: float, instants: Vector) -> str:
    """What happens at `t`, given the instants of all relations of time."""
    count = int(np.sum(np.abs(instants - t) <= 1e-12 * max(1.0, abs(t))))
    return f"time >= {t:g}" + (f" ({count} relations)" if count > 1 else "")
