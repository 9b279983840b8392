"""Bounces that come ever sooner: their limit is a state of rest, and the run goes on from there.

An impact law v+ = -e v- has infinitely many impacts before a finite time (Zeno). When the impacts of one relation come
ever sooner and the flights between them are no higher than the error of the distance itself, the reset state is held so
that distance and approach stay zero, until it would have to pull.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from acausal.simulate.guards import Guards, Moment
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Hold, Regime

# So many impacts, each sooner than the one before, are a sequence that has a limit.
_SEQUENCE = 10
_ENDLESS = 40


@dataclass
class Bounces:
    """How the events of each relation follow one another."""

    problem: Problem
    guards: Guards
    span: float
    count: int = 0
    _time: float = -np.inf
    _standing: int = 0
    _last: dict[int, float] = field(default_factory=dict)
    _gap: dict[int, float] = field(default_factory=dict)
    _crowd: dict[int, int] = field(default_factory=dict)
    _impossible: set[int] = field(default_factory=set)

    def saw(self, t: float, relations: list[int]) -> None:
        """Count events of relations at an instant."""
        self.count += 1
        self._standing = self._standing + 1 if t - self._time <= 1e-14 * max(self.span, abs(t)) else 0
        self._time = t
        for k in relations:
            gap = t - self._last.get(k, -np.inf)
            self._crowd[k] = self._crowd.get(k, 0) + 1 if gap < self._gap.get(k, np.inf) else 0
            self._gap[k], self._last[k] = gap, t

    @property
    def crowded(self) -> list[int]:
        """Relations whose events come ever sooner."""
        return [k for k, n in self._crowd.items() if n >= _SEQUENCE]

    @property
    def is_endless(self) -> bool:
        """Whether events follow one another although no rest could be found."""
        return self._standing > _ENDLESS or any(
            n >= _ENDLESS and self._gap[k] <= 1e-9 * self.span for k, n in self._crowd.items()
        )

    def rest(self, t: float, left: Moment, relations: list[int]) -> tuple[Moment, list[int], list[str]]:
        """The moment with those of these relations held that have reached rest, which they are, and what to say."""
        moment, rested, notes = left, [], []
        for k in relations:
            if self._crowd.get(k, 0) >= _SEQUENCE and k not in self._impossible and self._is_low(t, left, k):
                found = self._held(t, moment, k)
                if found is None:
                    self._impossible.add(k)
                    continue
                moment = found[0]
                rested.append(k)
                notes.append(found[1])
        return moment, rested, notes

    def _is_low(self, t: float, left: Moment, relation: int) -> bool:
        """Whether the flight that ends here was no higher than the noise: it rises to a quarter of speed times time."""
        rate, noise = self.guards.rates(t, left)
        at = [k for k, (r, side) in enumerate(left.regime.owners) if r == relation and side < 0]
        gap = t - self._last[relation]
        return bool(at) and abs(float(rate[at[0]])) * gap / 4 <= noise[at[0]]

    def _held(self, t: float, left: Moment, relation: int) -> tuple[Moment, str] | None:
        events = self.problem.compiled.state_events
        node = events.relations[relation]
        for clause in events.clauses:
            if clause.condition != node:
                continue
            for target, _ in clause.actions:
                regime = Regime(left.regime.free, (*left.regime.holds, Hold(relation, target)))
                moment = Moment(left.x, left.z, left.m, regime)
                if not regime.is_possible or not regime.is_solvable(t, left.x, left.z, left.m):
                    continue
                x = self.guards.held(t, moment)
                moment = Moment(x, left.z, left.m, regime)
                ends = [k for k, (r, side) in enumerate(regime.owners) if side >= 0 and r == relation]
                if (self.guards.distances(t, moment)[ends] >= 0).all():
                    place = f" ({clause.component})" if clause.component else ""
                    state = self.problem.compiled.states[target]
                    return moment, f"at rest from t = {t:.9g} s on{place}: {clause.text} no longer changes {state}"
        return None
