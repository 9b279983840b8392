"""Passes of guards that a stricter tolerance takes back.

Where the equations are singular on both sides of a guard, as those of `sqrt(h)` are, it stays within its error for
good: the solver passes it again and again, and not once at a hundredth of its tolerance. Each look takes two more
integrations.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.events.errors import unsettled
from acausal.simulate.events.guards import Guards, Moment

# The number of passes in a row over which the run must have advanced by this fraction of its length.
_MOST, _LEAST_ADVANCE = 400, 0.1


@dataclass
class Withdrawn:
    """Passes in one stretch of guards that have stayed within their errors: the instants before them [s].

    `highest`: The largest values of the guards since the last pass; shape (guards,).
    """

    highest: Vector
    times: list[float] = field(default_factory=list)

    def reach(self, values: Vector) -> None:
        """Take note of the largest values of the guards in a piece; shape (guards,)."""
        self.highest = np.maximum(self.highest, values)

    def add(self, guards: Guards, t: float, at: Moment, passed: Truth) -> None:
        """Count a pass after an instant; EventError (AC501) if there are too many in a row, with hardly any advance."""
        if self.times and (self.highest > guards.rates(t, at, between=True)[1])[passed].any():
            self.times.clear()
        self.times.append(t)
        self.highest = np.zeros_like(self.highest)
        if len(self.times) <= _MOST:
            return
        owners, compiled = at.regime.active_set.owners, guards.problem.compiled
        relations = {owners[k][0] for k in np.flatnonzero(passed).tolist()} - compiled.state_events.watched
        if relations and t - self.times[0] < _LEAST_ADVANCE * guards.span:
            raise unsettled(compiled, t, [guards.texts[k] for k in sorted(relations)])
        self.times.clear()
