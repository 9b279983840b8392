"""Bounces in ever quicker succession: the run continues from their limit, a state of rest.

With an impact law v+ = -e v-, infinitely many impacts happen before a finite time if 0 < e < 1 (Zeno), and a single one
if e is zero. Once the next flight is no higher than the error of the distance itself, it is indistinguishable from
rest: the reset state is held so that distance and approach stay zero, until it would have to pull.

With a constant acceleration `a` towards the guard, the first flight takes 2 v / a, and each takes `e` times as long as
the one before. They end at the accumulation time, 2 v / (a (1 - e)) later, which is computed in advance. Every impact
predicts it: early ones under the assumption that the acceleration stays the same, late ones with the error of the
distance. The best prediction is the one that agrees most closely with its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from acausal.analyse.events.state_events import Clause
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.errors import accumulated
from acausal.simulate.events.guards import INSTANT, Cause, Guards, Moment, same_instant
from acausal.simulate.events.iteration import Happened
from acausal.simulate.events.regime import Hold, Regime

# More events of one relation at coinciding instants are an accumulation without a state of rest.
_MOST_CROWDED = 40
# The height of a flight is first estimated from the flight before it; if it exceeds this multiple of the noise, the
# flight is not examined further.
_LOW_FLIGHT = 1e6


@dataclass(frozen=True)
class Rest:
    """A relation that is held at its guard by a state that a `when` resets, and when its flights would end [s]."""

    time: float
    cause: Cause
    note: str


@dataclass(frozen=True)
class _Flight:
    """A flight after an impact: speeds towards the guard before and away from it afterwards, noise and height."""

    approach: float
    away: float
    noise: float
    high: float


@dataclass(frozen=True)
class _Hold:
    """A moment with a relation held by the state at `target`, not projected yet, and its acceleration towards there."""

    moment: Moment
    clause: Clause
    target: int
    pull: float


@dataclass
class Bounces:
    """The succession of events of each relation.

    Attributes
    ----------
    count
        Number of events so far.
    last, crowd
        The time of the last event of each relation, and how many before it happened at that instant.
    impossible
        1 for relations that have no state of rest.
    resting
        Relations at rest whose flights would not have ended yet.
    """

    problem: Problem
    guards: Guards
    span: float
    count: int = 0
    resting: dict[int, Rest] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._clauses, self._impulsive = self.problem.compiled.events.resetting, self.problem.compiled.events.struck_by
        self.last, self.crowd = np.zeros(len(self._clauses)), np.zeros(len(self._clauses), dtype=np.int64)
        # only a state that a `when` resets can come to rest; determined here, so that compiled code need not ask
        self.impossible = np.array([not clauses for clauses in self._clauses], dtype=np.int64)
        self._ends: dict[int, list[float]] = {}
        self._regimes: dict[tuple[Hold, ...], Regime] = {}

    def begin(self, t: float) -> None:
        """Start counting at time `t`."""
        self.last[:] = t

    def count_events(self, t: float, relations: list[int]) -> None:
        """Count events of relations at an instant."""
        self.count += 1
        for k in relations:
            again = t - self.last[k] <= same_instant(self.span, t)
            self.crowd[k] = self.crowd[k] + 1 if again else 0
            self.last[k] = t

    @property
    def endless(self) -> list[int]:
        """Relations whose events follow one another without progress in time, and without a state of rest."""
        return np.flatnonzero(self.crowd > _MOST_CROWDED).tolist()

    def come_to_rest(
        self, t: float, left: Moment, happened: Happened, relations: list[int]
    ) -> tuple[Moment, list[Rest]]:
        """The moment after an event with those relations held whose next flight would be lower than the noise."""
        moment, at_rest = happened.moment, []
        for k in relations:
            acts = not self._clauses[k].isdisjoint(happened.acted)
            if self.impossible[k] or not acts:  # no impact
                continue
            flight = self._flight(t, left, moment, k)
            hold = None if flight is None else self._hold(t, left, moment, k)
            if flight is not None and hold is None and k in self._impulsive:
                self._refuse_sinking(t, moment, k, flight)
            if flight is None or hold is None:
                self._ends.pop(k, None)
                continue
            ends = self._predicted(k, t + 2 * flight.away / (hold.pull * (1 - flight.away / flight.approach)))
            if flight.away**2 > 2 * hold.pull * flight.noise:
                continue
            held = replace(hold.moment, x=self.guards.projected(t, hold.moment))
            if self._pull(t, held, k) >= 0.0:
                moment, self.resting[k] = held, self._rest(max(ends, t), hold.clause, hold.target)
                at_rest.append(self.resting[k])
        return moment, at_rest

    def due(self, regime: Regime) -> tuple[float, int] | None:
        """When the next flights would end, and of which relation; forgets relations that are no longer held."""
        held = {h.relation for h in regime.holds}
        self.resting = {k: rest for k, rest in self.resting.items() if k in held}
        return min(((rest.time, k) for k, rest in self.resting.items()), default=None)

    def _refuse_sinking(self, t: float, moment: Moment, relation: int, flight: _Flight) -> None:
        """Raise AC502 if flights between impulses are lower than the noise under an acceleration towards the guard."""
        guard = self._guard_of(moment, relation)
        if guard is None or flight.high > flight.noise:
            return
        compiled, h = moment.regime.compiled, 1e-6 * max(t - self.last[relation], INSTANT * self.span)
        ode = np.array(compiled.rhs(t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m)[0]).ravel()
        later = replace(moment, x=moment.x + h * ode)
        rates = [float(self.guards.rates(t, at)[0][guard]) for at in (moment, later)]
        inside = moment.m[self.guards.first + relation] > 0.5
        pulled = (rates[1] - rates[0]) * (1.0 if inside else -1.0)
        if pulled > 0.0:
            names = [self.problem.compiled.events.texts[relation]]
            raise accumulated(self.problem.compiled, t, self.count, names)

    def _flight(self, t: float, left: Moment, after: Moment, relation: int) -> _Flight | None:
        """The flight that begins at this guard after an impact that has reduced the speed; None if there is none."""
        before, here = self._guard_of(left, relation), self._guard_of(after, relation)
        if before is None or here is None:
            return None
        (rates, noises), distance = self.guards.rates(t, after), self.guards.distances(t, after)[here]
        noise, approach = float(noises[here]), -float(self.guards.rates(t, left)[0][before])
        turned = after.m[self.guards.first + relation] != left.m[self.guards.first + relation]
        away = -float(rates[here]) if turned else float(rates[here])
        if abs(distance) > 2 * noise or not -1e-6 * approach <= away < approach:
            return None
        away = max(away, 0.0)
        high = away**2 * (t - self.last[relation]) / (4 * approach)  # with the acceleration of the flight before
        return _Flight(approach, away, noise, high) if high <= _LOW_FLIGHT * noise else None

    def _guard_of(self, at: Moment, relation: int) -> int | None:
        """The index of the guard that is the distance of a free relation; None if the relation is held."""
        return next((k for k, (r, side) in enumerate(at.regime.active_set.owners) if r == relation and side < 0), None)

    def _hold(self, t: float, left: Moment, after: Moment, relation: int) -> _Hold | None:
        """Hold a relation by a state that it resets, if that accelerates towards the guard; otherwise None."""
        m = after.m.copy()
        m[self.guards.first + relation] = left.m[self.guards.first + relation]
        possible = False
        for clause in (self.problem.compiled.state_events.clauses[k] for k in sorted(self._clauses[relation])):
            for target, _ in clause.actions:
                regime = self._regime(after.regime.free, (*after.regime.holds, Hold(relation, target)))
                if not regime.active_set.is_possible:
                    continue
                possible = True
                moment = Moment(after.x, after.z, m, regime)
                if regime.is_solvable(t, moment.x, moment.z, m) and (pull := self._pull(t, moment, relation)) > 0.0:
                    return _Hold(moment, clause, target, pull)
        self.impossible[relation] = not possible and relation not in self._impulsive
        return None

    def _pull(self, t: float, held: Moment, relation: int) -> float:
        """The acceleration with which a flight from the guard that holds this relation would return."""
        return float(self.guards.distances(t, held)[held.regime.active_set.owners.index((relation, 0))])

    def _predicted(self, relation: int, ends: float) -> float:
        """When the flights of a relation end, from the predictions of this impact and those before it."""
        predictions = self._ends.setdefault(relation, [])
        predictions.append(ends)
        steps = np.abs(np.diff(predictions))
        if len(steps) < 2:
            return ends
        return predictions[1 + int(np.argmin(np.maximum(steps[:-1], steps[1:])))]

    def _regime(self, free: Problem, holds: tuple[Hold, ...]) -> Regime:
        if holds not in self._regimes:  # so that its functions are built once
            self._regimes[holds] = Regime(free, holds)
        return self._regimes[holds]

    def _rest(self, t: float, clause: Clause, target: int) -> Rest:
        place = f" ({clause.component})" if clause.component else ""
        state = self.problem.compiled.states[target]
        note = f"at rest from t = {t:.9g} s on{place}: {clause.text} no longer changes {state}"
        return Rest(t, Cause(f"at rest: {clause.text}", clause.where, clause.component), note)
