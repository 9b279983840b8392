"""A source of stops from outside: a watch that looks at a run each time something has moved by so much.

What moves how fast is not known before the run, so that no list of instants could say when that is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.record.record import Recorder


@dataclass
class Watch:
    """Stops so that what is watched moves by `most` from one stop to the next, as fast as it moves at the first.

    Parameters
    ----------
    value, rate
        What is watched, and its rate [1/s], as functions of the states.
    longest
        The longest stretch [s].
    """

    value: Callable[[np.ndarray], float]
    rate: Callable[[np.ndarray], float]
    most: float
    longest: float
    seen: list[tuple[float, float]] = field(default_factory=list)
    stops: list[float] = field(default_factory=list)

    def next_stop(self, here: float, until: float, moment: Moment) -> tuple[float, tuple[Cause, ...]]:
        """The next stop; nothing happens at it."""
        self.seen.append((here, self.value(moment.x)))
        return min(until, here + min(self.longest, self.most / max(abs(self.rate(moment.x)), 1e-9))), ()

    def set_modes(self, modes: np.ndarray) -> None:
        """It has no modes."""

    def accepts(self, record: Recorder, events: Sequence[float], complete: bool) -> bool:
        """Note where the run stopped, and let it go on."""
        self.stops.append(record.time)
        return True
