"""Bounces that come ever sooner: their limit is a state of rest, and the run goes on from there.

An impact law v+ = -e v- with e < 1 has infinitely many impacts before a finite time (Zeno), or a single one where e is
zero. Once the flight that begins is no higher than the error of the distance itself, what follows cannot be told from
lying there: the reset state is held so that distance and approach stay zero, until it would have to pull. Under a
steady pull `a` the flights are a geometric series, the first 2 v / a long, each `e` times the one before. They end at
the accumulation time, 2 v / (a (1 - e)) later, which is computed and not waited for. Every impact predicts it: the
early ones as far as the pull stays what it is, the late ones as far as the error of the distance allows. The best is
the one that agrees most closely with its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from acausal.analyse.events.state_events import Clause
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.errors import accumulated
from acausal.simulate.events.guards import INSTANT, Cause, Guards, Moment, as_one
from acausal.simulate.events.iteration import Happened
from acausal.simulate.events.regime import Hold, Regime

# So many events of one relation, none to be told from the next in time, are an accumulation without a state of rest.
_ENDLESS = 40
# The height of a flight is first estimated from the flight before it; what is higher than so many times the noise is
# not looked at closer.
_NEARLY = 1e6


@dataclass(frozen=True)
class Rest:
    """A relation that is held at its guard by the state a `when` resets, and the time at which its flights end."""

    time: float
    cause: Cause
    note: str


@dataclass(frozen=True)
class _Flight:
    """A flight that begins at an impact: speeds towards the guard before it and away from it after it; their noise."""

    approach: float
    away: float
    noise: float
    high: float


@dataclass(frozen=True)
class _Hold:
    """A moment in which a relation is held by the state at `target`, not yet moved there, and what pulls it there."""

    moment: Moment
    clause: Clause
    target: int
    pull: float


@dataclass
class Bounces:
    """How the events of each relation follow one another.

    Attributes
    ----------
    count
        Number of events so far.
    last, crowd
        Of each relation the time of its last event, and how many before it came at that very time.
    impossible
        1 for relations that have no state of rest.
    resting
        The relations at rest whose flights would not have ended yet.
    """

    problem: Problem
    guards: Guards
    span: float
    count: int = 0
    resting: dict[int, Rest] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._clauses, self._struck = self.problem.compiled.events.resetting, self.problem.compiled.events.struck_by
        self.last, self.crowd = np.zeros(len(self._clauses)), np.zeros(len(self._clauses), dtype=np.int64)
        # only what a `when` resets can come to rest: known here, compiled code need not ask
        self.impossible = np.array([not clauses for clauses in self._clauses], dtype=np.int64)
        self._ends: dict[int, list[float]] = {}
        self._regimes: dict[tuple[Hold, ...], Regime] = {}

    def begin(self, t: float) -> None:
        """Start to count."""
        self.last[:] = t

    def saw(self, t: float, relations: list[int]) -> None:
        """Count events of relations at an instant."""
        self.count += 1
        for k in relations:
            again = t - self.last[k] <= as_one(self.span, t)
            self.crowd[k] = self.crowd[k] + 1 if again else 0
            self.last[k] = t

    @property
    def endless(self) -> list[int]:
        """Relations whose events follow one another without time passing, although no rest could be found."""
        return np.flatnonzero(self.crowd > _ENDLESS).tolist()

    def landed(self, t: float, left: Moment, happened: Happened, relations: list[int]) -> tuple[Moment, list[Rest]]:
        """The moment with those of these relations held whose next flight would be lower than the noise."""
        moment, found = happened.moment, []
        for k in relations:
            acts = not self._clauses[k].isdisjoint(happened.acted)
            if self.impossible[k] or not acts:  # leaving the guard is no impact
                continue
            flight = self._flight(t, left, moment, k)
            hold = None if flight is None else self._hold(t, left, moment, k)
            if flight is not None and hold is None and k in self._struck:
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
                found.append(self.resting[k])
        return moment, found

    def due(self, regime: Regime) -> tuple[float, int] | None:
        """When the flights of the next relation end, and which; those that were let go before are forgotten."""
        held = {h.relation for h in regime.holds}
        self.resting = {k: rest for k, rest in self.resting.items() if k in held}
        return min(((rest.time, k) for k, rest in self.resting.items()), default=None)

    def _refuse_sinking(self, t: float, moment: Moment, relation: int, flight: _Flight) -> None:
        """AC502 where flights between impulses are lower than the noise, and something pulls what would sink in."""
        place = self._place(moment, relation)
        if place is None or flight.high > flight.noise:
            return
        compiled, h = moment.regime.compiled, 1e-6 * max(t - self.last[relation], INSTANT * self.span)
        ode = np.array(compiled.rhs(t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m)[0]).ravel()
        later = replace(moment, x=moment.x + h * ode)
        rates = [float(self.guards.rates(t, at)[0][place]) for at in (moment, later)]
        inside = moment.m[self.guards.first + relation] > 0.5
        pulled = (rates[1] - rates[0]) * (1.0 if inside else -1.0)
        if pulled > 0.0:
            names = [self.problem.compiled.events.texts[relation]]
            raise accumulated(self.problem.compiled, t, self.count, names)

    def _flight(self, t: float, left: Moment, after: Moment, relation: int) -> _Flight | None:
        """The flight that begins at this guard after an impact that has taken speed; None where that is not so."""
        before, here = self._place(left, relation), self._place(after, relation)
        if before is None or here is None:
            return None
        (rates, noises), distance = self.guards.rates(t, after), self.guards.distances(t, after)[here]
        noise, approach = float(noises[here]), -float(self.guards.rates(t, left)[0][before])
        turned = after.m[self.guards.first + relation] != left.m[self.guards.first + relation]
        away = -float(rates[here]) if turned else float(rates[here])
        if abs(distance) > 2 * noise or not -1e-6 * approach <= away < approach:
            return None
        away = max(away, 0.0)
        high = away**2 * (t - self.last[relation]) / (4 * approach)  # by the pull of the flight before
        return _Flight(approach, away, noise, high) if high <= _NEARLY * noise else None

    def _place(self, at: Moment, relation: int) -> int | None:
        """Which guard of the regime is the distance of a free relation."""
        return next((k for k, (r, side) in enumerate(at.regime.active_set.owners) if r == relation and side < 0), None)

    def _hold(self, t: float, left: Moment, after: Moment, relation: int) -> _Hold | None:
        """How the relation can be held by a state that it resets, if something pulls it there."""
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
        self.impossible[relation] = not possible and relation not in self._struck
        return None

    def _pull(self, t: float, held: Moment, relation: int) -> float:
        """How fast a flight from the guard that holds this relation would be turned back."""
        return float(self.guards.distances(t, held)[held.regime.active_set.owners.index((relation, 0))])

    def _predicted(self, relation: int, ends: float) -> float:
        """When the flights of a relation end, by this impact and those before it."""
        known = self._ends.setdefault(relation, [])
        known.append(ends)
        steps = np.abs(np.diff(known))
        if len(steps) < 2:
            return ends
        return known[1 + int(np.argmin(np.maximum(steps[:-1], steps[1:])))]

    def _regime(self, free: Problem, holds: tuple[Hold, ...]) -> Regime:
        if holds not in self._regimes:  # its functions are built once, not at every impact
            self._regimes[holds] = Regime(free, holds)
        return self._regimes[holds]

    def _rest(self, t: float, clause: Clause, target: int) -> Rest:
        place = f" ({clause.component})" if clause.component else ""
        state = self.problem.compiled.states[target]
        note = f"at rest from t = {t:.9g} s on{place}: {clause.text} no longer changes {state}"
        return Rest(t, Cause(f"at rest: {clause.text}", clause.where, clause.component), note)
