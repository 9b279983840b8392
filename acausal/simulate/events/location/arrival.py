"""Where a search for events ends."""

from __future__ import annotations

from dataclasses import dataclass

from acausal.arrays import Vector


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
