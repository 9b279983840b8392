"""Bounces that come ever sooner: their limit is a state of rest, and the run goes on from there.

An impact law v+ = -e v- has infinitely many impacts before a finite time (Zeno), or a single one where e is zero. When
the flights between impacts are no higher than the error of the distance itself, those that were or the one that would
be next, the reset state is held so that distance and approach stay zero, until it would have to pull.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.simulate.guards import Guards, Moment
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Hold, Regime

# So many impacts, each sooner than the one before, are a sequence that has a limit.
_SEQUENCE = 10
_ENDLESS = 40


@dataclass
class Bounces:
    """How the events of each relation follow one another.

    Attributes
    ----------
    count, time, standing
        Number of events so far, the time of the last one, and how many came at that very time.
    last, gap, crowd
        Of each relation the time of its last event, the time since the one before, and how many came ever sooner.
    impossible
        1 for relations that have no state of rest.
    """

    problem: Problem
    guards: Guards
    span: float
    count: int = 0
    time: float = -np.inf
    standing: int = 0

    def __post_init__(self) -> None:
        size = len(self.problem.compiled.state_events.relations)
        self.last, self.gap = np.full(size, -np.inf), np.full(size, np.inf)
        self.crowd, self.impossible = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.int64)

    def saw(self, t: float, relations: list[int]) -> None:
        """Count events of relations at an instant."""
        self.count += 1
        self.standing = self.standing + 1 if t - self.time <= 1e-14 * max(self.span, abs(t)) else 0
        self.time = t
        for k in relations:
            gap = t - self.last[k]
            self.crowd[k] = self.crowd[k] + 1 if gap < self.gap[k] else 0
            self.gap[k], self.last[k] = gap, t

    @property
    def crowded(self) -> list[int]:
        """Relations whose events come ever sooner."""
        return [int(k) for k in np.flatnonzero(self.crowd >= _SEQUENCE)]

    @property
    def is_endless(self) -> bool:
        """Whether events follow one another although no rest could be found."""
        endless = (self.crowd >= _ENDLESS) & (self.gap <= 1e-9 * self.span)
        return self.standing > _ENDLESS or bool(endless.any())

    def rest(self, t: float, left: Moment, relations: list[int]) -> tuple[Moment, list[int], list[str]]:
        """The moment with those of these relations held that have reached rest, which they are, and what to say."""
        moment, rested, notes = left, [], []
        for k in relations:
            if self.crowd[k] >= _SEQUENCE and not self.impossible[k] and self._is_low(t, left, k):
                found = self._held(t, moment, k)
                if found is None:
                    self.impossible[k] = 1
                    continue
                moment = found[0]
                rested.append(k)
                notes.append(found[1])
        return moment, rested, notes

    def landed(
        self, t: float, left: Moment, after: Moment, relations: list[int]
    ) -> tuple[Moment, list[int], list[str]]:
        """The same after impacts whose next flight would be lower than the noise: without a sequence before."""
        moment, rested, notes = after, [], []
        for k in relations:
            if self.impossible[k] or not self._stays_low(t, left, after, k):
                continue
            m = moment.m.copy()
            m[self.guards.first + k] = left.m[self.guards.first + k]
            found = self._held(t, Moment(moment.x, moment.z, m, moment.regime), k)
            if found is None:
                self.impossible[k] = 1
                continue
            moment = found[0]
            rested.append(k)
            notes.append(found[1])
        return moment, rested, notes

    def _stays_low(self, t: float, left: Moment, after: Moment, relation: int) -> bool:
        """Whether the flight that begins is pulled back before it is higher than the noise: v**2 / (2*a)."""
        before, here = self._place(left, relation), self._place(after, relation)
        if before is None or here is None or not self._is_reset_by(relation):
            return False
        (rates, noises), distance = self.guards.rates(t, after), self.guards.distances(t, after)[here]
        approach, noise = abs(float(self.guards.rates(t, left)[0][before])), float(noises[here])
        turned = after.m[self.guards.first + relation] != left.m[self.guards.first + relation]
        away = float(-rates[here] if turned else rates[here])
        if abs(distance) > 2 * noise or away < -1e-6 * approach or away > 1e6 * approach:
            return False
        p, dt = after.regime.problem, 1e-7 * self.span
        ode = np.array(p.compiled.rhs(t, after.x, after.z, p.u, p.p, after.m)[0]).ravel()
        soon = Moment(after.x + dt * ode, after.z, after.m, after.regime)
        later = float(self.guards.rates(t + dt, soon)[0][here])
        pull = (later - float(rates[here])) / dt * (1.0 if turned else -1.0)
        return pull > 0 and max(away, 0.0) ** 2 <= 2 * pull * noise

    def _is_reset_by(self, relation: int) -> bool:
        events = self.problem.compiled.state_events
        return any(c.condition == events.relations[relation] and c.actions for c in events.clauses)

    def _place(self, at: Moment, relation: int) -> int | None:
        """Which guard of the regime is the distance of a free relation."""
        return next((k for k, (r, side) in enumerate(at.regime.owners) if r == relation and side < 0), None)

    def _is_low(self, t: float, left: Moment, relation: int) -> bool:
        """Whether the flight that ends here was no higher than the noise: it rises to a quarter of speed times time."""
        rate, noise = self.guards.rates(t, left)
        at = [k for k, (r, side) in enumerate(left.regime.owners) if r == relation and side < 0]
        gap = t - self.last[relation]
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
