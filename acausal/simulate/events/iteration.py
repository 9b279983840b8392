"""The iteration at an event: rounds of a compiled function, and relations that flip between its calls.

A round (`acausal.lower.events.round`) gives discrete equations, `when` and `pre` their meaning. Between its calls,
algebraic variables are solved for, and relations that do not hold are flipped. At first all of them flip at once. If
the modes do not settle, one relation flips at a time, the one with the lowest number first, which terminates for every
P-matrix, that is for passive circuits and for friction (K. G. Murty, Note on a Bard-type scheme for solving the
complementarity problem, Opsearch 11, 1974).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.events.state_events import Clause
from acausal.arrays import Truth, Vector
from acausal.diagnose.words import listed
from acausal.errors import InitializationError
from acausal.lower.events.impulses import impulses
from acausal.lower.events.round import Round
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.shares import Border
from acausal.simulate.events.errors import (
    contradicting,
    not_a_number,
    overloaded,
    undetermined,
    unsettled,
    vain,
    violated,
    warned,
)
from acausal.simulate.events.guards import AT_REST, STILL, Cause, Guards, Moment, same_instant
from acausal.simulate.events.regime import Hold, Regime
from acausal.simulate.events.resets.constrained import followed
from acausal.simulate.start.initialize import Start, consistent

_MOST_ROUNDS = 400
# The number of iterations in which all wrong relations flip at once, and the largest number altogether.
_MOST_TOGETHER, _MOST_SINGLE = 12, 2000
# The number of flips at one instant from which on a relation chatters: both modes lead back to it.
_CHATTER = 3
# The number of flips up to which a relation that stays where its sides are equal takes its literal value.
_MOST_TIED = 2
# How often a relation may be kept in its mode for a moment, if each time is within this fraction of the run after the
# last.
_MOST_KEPT, _KEPT_WITHIN = 20, 1e-6
Jumped = Callable[[float, Moment], tuple[Vector, tuple[Cause, ...]] | None]
"""Modes with which delayed signals are read at the delays of a moment, and causes; None if they are set already."""
SLIDING = "sliding mode"
"""How notes of sliding modes begin."""

_SCALARS = tuple(Round._fields.index(name) for name in ("level", "settled", "clash"))


@dataclass(frozen=True, eq=False)
class Jump:
    """Actions at a moment: which actions of the model were applied, and whether `pre` advanced afterwards."""

    moment: Moment
    applied: Truth
    advances: bool


@dataclass(frozen=True, eq=False)
class Happened:
    """The moment after an event, its causes and notes, and the clauses that acted on the way, with their jumps."""

    moment: Moment
    causes: tuple[Cause, ...] = ()
    changed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    terminated: str | None = None
    jumps: tuple[Jump, ...] = ()
    acted: tuple[int, ...] = ()


@dataclass
class _Tally:
    """The state of the iteration over one event: flips of each relation, its largest noise, and iterations so far."""

    flips: NDArray[np.int_]
    noise: Vector
    turns: int = 0
    causes: list[Cause] = field(default_factory=list)
    """Delays that have jumped, as causes."""
    is_timed: bool = True
    """Whether relations of time alone change before any clause acts; not while `initial()` suspends the others."""


@dataclass
class _Log:
    """What is reported of an event."""

    causes: list[Cause] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    jumps: list[Jump] = field(default_factory=list)
    acted: list[int] = field(default_factory=list)
    terminated: str | None = None


class Iteration:
    """The event iteration of one problem; `jumped` handles delays that an event changes."""

    def __init__(self, problem: Problem, guards: Guards, jumped: Jumped | None = None) -> None:
        self.problem = problem
        self.jumped = jumped
        self.guards = guards
        compiled = problem.compiled
        self.events = compiled.state_events
        self.conditions = len(self.events.conditions)
        self.is_constrained = bool(compiled.solution.structure.invariants)
        self.round = functions_of(compiled).round
        self.shares = functions_of(compiled).shares
        self.waiting: set[int] = set()
        """Relations that keep their modes, although they are about to leave their guards: their turn comes later."""
        self._kept: dict[int, tuple[float, int]] = {}
        self._broken: set[int] = set()
        self._noted: set[tuple[str, ...]] = set()
        self._settled: tuple[float, Moment] | None = None
        self._regimes: dict[tuple[tuple[Hold, ...], Border | None], Regime] = {}
        self.first, self.dynamic = guards.first, compiled.n_dynamic
        self.most_rounds = _MOST_ROUNDS + 4 * len(self.events.clauses)
        first_sample = compiled.n_timely
        first_memory = first_sample + len(self.events.samples)
        first_flag = first_memory + len(self.events.memories)
        self.samples = slice(first_sample, first_memory)
        self.memories = slice(first_memory, first_flag)
        self.flags = slice(first_flag, first_flag + len(self.events.flags))
        nodes = compiled.solution.structure.reduced.pool.nodes
        self.flag_names = [nodes[n][0] for n in self.events.flags]
        self.opening = functions_of(compiled).opening
        self.assigned = np.array([a.position for a in self.events.assignments], dtype=int)

    def settle(
        self,
        t: float,
        moment: Moment,
        before: Vector,
        *,
        samples: Vector | None = None,
        flag: str | None = None,
    ) -> Happened:
        """Iterate to the moment after an event, from modes some of which have changed already.

        Raises EventError: AC501, AC503, AC504, AC506, AC507, AC508, AC509.

        `before`: The modes before the event; a `when` acts if its condition was false in them.
        `samples`: Which samples are true now.
        `flag`: "initial" or "terminal" at the ends of a run. Values that clauses with `initial()` set are those of the
        start: no other `when` acts because of them (Modelica 3.6, section 8.6).
        """
        m = moment.m.copy()
        m[self.samples] = 0.0 if samples is None else samples
        m[self.flags] = [float(name == flag) for name in self.flag_names]
        repeated = self._repeated(t, moment, m, before)
        if repeated is not None:
            return Happened(repeated)
        x_before, was_true = moment.x, np.zeros(self.conditions)
        if self.conditions:
            was_true = self._round(
                t, Moment(x_before, moment.z, before, moment.regime), was_true, was_true, 0.0
            ).conditions
        log, entered = _Log(), m
        try:
            held = 1.0 - self.opening if flag == "initial" and self.opening.any() else None
            moment, last = self._rounds(t, Moment(moment.x, moment.z, m, moment.regime), was_true, held, log)
            moment, after = self._end_instant(t, moment, last, flag)
            if not (after.assigned == moment.x[self.assigned]).all():
                held = np.ones(self.conditions) if flag == "initial" else None
                moment, last = self._rounds(t, moment, last.conditions, held, log)
        except InitializationError as error:
            if flag == "initial" or error.code not in ("AC301", "AC304"):
                raise
            raise undetermined(t, error) from error
        self._check_loads(t, moment, log.notes)
        states = self.problem.compiled.states
        changed = tuple(states[k] for k in np.flatnonzero(moment.x != x_before).tolist())
        self._check(t, last.asserts, log.notes)
        jumps, acted = tuple(log.jumps), tuple(log.acted)
        happened = Happened(moment, tuple(log.causes), changed, tuple(log.notes), log.terminated, jumps, acted)
        same = np.array_equal(before, entered) and np.array_equal(entered, moment.m)
        self._settled = (t, moment) if same and not (changed or happened.causes or jumps or log.terminated) else None
        return happened

    def _repeated(self, t: float, moment: Moment, m: Vector, before: Vector) -> Moment | None:
        """The end of the last iteration if it began like this one, as at the start of a run and of its first stretch.

        Not with delays, because the past that they read grows.
        """
        if self._settled is None or self.jumped is not None:
            return None
        then, repeated = self._settled
        is_there = t == then and moment.x is repeated.x and moment.z is repeated.z and moment.regime is repeated.regime
        return repeated if is_there and np.array_equal(m, repeated.m) and np.array_equal(before, repeated.m) else None

    def _rounds(
        self, t: float, moment: Moment, was_true: Vector, held: Vector | None, log: _Log
    ) -> tuple[Moment, Round]:
        """Rounds until one changes nothing; the moment then, and the result of that round.

        `was_true`: Which conditions were true before.
        `held`: 1 for conditions that do not become true while `initial()` acts, or None.
        """
        decided, level, acting = np.zeros_like(was_true), 0.0, np.zeros(0, dtype=int)
        count = len(moment.m) - self.first
        tally = _Tally(np.zeros(count, dtype=int), np.zeros(count))
        for _ in range(self.most_rounds):
            was_true = was_true if held is None else np.maximum(was_true, held)
            tally.is_timed = held is None
            moment, result = self.decide(t, moment, log.notes, tally, (was_true, decided, level))
            log.causes += tally.causes
            tally.causes.clear()
            advances, m = result.level == 0.0, result.m
            if result.clash:
                raise self._clash(t, moment, result)
            acting = np.flatnonzero(result.acting) if advances else np.zeros(0, dtype=int)
            log.acted += acting.tolist()
            for k in acting:
                clause = self.events.clauses[k]
                log.causes.append(Cause(clause.text, clause.where, clause.component))
                log.terminated = clause.terminate or log.terminated
            if result.settled:
                return moment, result
            applied, x = result.applied > 0.5, result.x
            moves = not np.array_equal(result.x[: self.dynamic], moment.x[: self.dynamic])
            if held is not None and advances:
                # conditions are evaluated once with the states that were set, before `pre` advances from the start
                held = np.ones_like(held) if moves else None
                if moves:
                    m, advances = moment.m, False
            if applied.any() or not np.array_equal(m, moment.m):
                log.jumps.append(Jump(moment, applied, advances))
            if moves:
                if self.is_constrained:
                    x = self._on_constraints(t, moment, result.x, applied, log.notes)
                tally = _Tally(
                    np.zeros(count, dtype=int), np.zeros(count)
                )  # with other states, no relation has led back yet
            moment = Moment(x, moment.z, m, self._without_moved(t, moment, x))
            was_true, decided, level = result.was, result.decided, float(result.level)
        texts = [self.events.clauses[k].text for k in acting]
        raise unsettled(self.problem.compiled, t, texts or [a.text for a in self.events.assignments])

    def _without_moved(self, t: float, moment: Moment, x: Vector) -> Regime:
        """The regime after states have jumped, without the holds at rest whose velocity has changed."""
        regime = moment.regime
        if all(hold.target is None for hold in regime.holds):
            return regime
        numbers = moment.z, self.problem.u, self.problem.p, moment.m
        before, after = (np.array(regime.active_set.kept_of(t, at, *numbers)).ravel() for at in (moment.x, x))
        left, row = [], 0
        for hold in regime.holds:
            row += 1 if hold.target is None else 2
            if hold.target is None or after[row - 1] == before[row - 1]:
                left.append(hold)
        return regime if len(left) == len(regime.holds) else Regime(regime.free, tuple(left), regime.border)

    def _on_constraints(self, t: float, moment: Moment, x: Vector, applied: Truth, notes: list[str]) -> Vector:
        """States after the applied actions, on the stabilised constraints; adds a note if others jump, too."""
        actions = (state for clause in self.events.clauses for state, _ in clause.actions)
        reset_states = [state for state, acts in zip(actions, applied, strict=True) if acts]
        numbers = moment.z, self.problem.u, self.problem.p, moment.m
        found = followed(self.problem.compiled, t, moment.x, x, reset_states, numbers)
        states = self.problem.compiled.states
        moved = tuple(states[k] for k in np.flatnonzero(found != x).tolist())
        if moved and ("reset", *moved) not in self._noted:
            self._noted.add(("reset", *moved))
            notes.append(
                f"t = {t:.9g} s: a `reset` moves {listed(moved)} too, by the constraints that bind them; "
                "reset(velocity, value, by=force) says which force does it"
            )
        return found

    def _check_loads(self, t: float, moment: Moment, notes: list[str]) -> None:
        """Refuse modes that contradict each other, and note loads that are statically indeterminate."""
        if self.shares is None or moment.regime.border is None:
            return
        at = t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m
        names = self.shares.open(*at)
        if self.shares.contradicts(moment.regime.border, self._errors(moment), *at):
            raise overloaded(self.problem.compiled.name, t, names)
        if names not in self._noted:
            self._noted.add(names)
            least = "the least of it is taken" if len(names) == 1 else "the shares of least squares are taken"
            notes.append(f"statically undetermined from t = {t:.9g} s on: {listed(names)}; {least}")

    def check_shares(self, times: Vector, x: Vector, z: Vector, moment: Moment) -> None:
        """Refuse rows at which equations that were assumed to be dependent contradict each other.

        That happens when a mechanism leaves a singular position, at which some of its equations were redundant.
        """
        if self.shares is None or moment.regime.border is None:
            return
        for k, t in enumerate(times.tolist()):
            at = t, x[:, k], z[:, k], self.problem.u, self.problem.p, moment.m
            if self.shares.contradicts(moment.regime.border, self._errors(moment), *at):
                raise overloaded(self.problem.compiled.name, t, self.shares.open(*at))

    def _clash(self, t: float, moment: Moment, found: Round) -> Exception:
        """The error for clauses that act at one instant and set different values."""
        compiled = self.problem.compiled
        values = functions_of(compiled).reactions(t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m)[3]
        setters: dict[int, tuple[Clause, float]] = {}
        acting = (found.applied > 0.5).tolist()
        actions = [(clause, state) for clause in self.events.clauses for state, _ in clause.actions]
        for (clause, state), acts, value in zip(actions, acting, values.tolist(), strict=True):
            if acts:
                first, other = setters.setdefault(state, (clause, value))
                if other != value:
                    return contradicting(compiled.name, t, compiled.states[state], (first, clause))
        striking = [actions[a][0] for a, _ in impulses(compiled) if acting[a]]
        return vain(compiled.name, t, striking or [c for c, _ in setters.values()])

    def _end_instant(self, t: float, moment: Moment, last: Round, flag: str | None) -> tuple[Moment, Round]:
        """The moment after the instant, when samples and flags are false again, also in `pre`; and the last round.

        `terminal()` remains true, because nothing follows.

        A discrete equation may read samples, such as that of a trigger, `y == sample(0, 1)`. The caller evaluates it
        again in further rounds, because its value has changed, and a `when` may act because of that.
        """
        m = moment.m.copy()
        m[self.samples] = 0.0
        if flag != "terminal":
            m[self.flags] = 0.0
        moment, is_over = Moment(moment.x, moment.z, m, moment.regime), np.array_equal(m, moment.m)
        if is_over or not (len(self.events.memories) or len(self.assigned)):
            return moment, last
        all_false = np.zeros(self.conditions)
        result = self._round(t, moment, all_false, all_false, 0.0)
        m[self.memories] = result.remembered
        return moment, result

    def decide(
        self, t: float, moment: Moment, notes: list[str], tally: _Tally, progress: tuple[Vector, Vector, float]
    ) -> tuple[Moment, Round]:
        """Flip relations and apply discrete equations until all hold at this point, or leave their guards correctly.

        Returns the moment and the result of the round. A relation at its guard that is about to leave it to the wrong
        side is flipped only if `pre` is up to date: a thermostat that has just switched off must have registered that
        before the falling temperature makes `T < limit` true again.

        `progress`: The state of the round: conditions that were true, those decided, and the level reached.
        """
        flips = tally.flips
        for _ in range(_MOST_SINGLE):
            moment = self.consistent(t, moment)
            jumped = None if self.jumped is None else self.jumped(t, moment)
            if jumped is not None:
                moment = replace(moment, m=jumped[0])
                tally.causes += jumped[1]
                continue
            result = self._round(t, moment, *progress)
            if not (result.assigned == moment.x[self.assigned]).all():
                # relations must be evaluated with the discrete values that follow from them, or they would cycle
                x = moment.x.copy()
                x[self.assigned] = result.assigned
                moment = Moment(x, moment.z, moment.m, moment.regime)
                continue
            wrong = np.zeros(0, dtype=bool)
            if len(moment.regime.active_set.owners):
                wrong = self._wrong(t, moment, tally, np.array_equal(result.remembered, moment.m[self.memories]))
            if not wrong.any():
                return moment, result
            if tally.turns >= _MOST_TOGETHER:
                wrong[int(np.argmax(wrong)) + 1 :] = False
            owners = moment.regime.active_set.owners
            moment = self.flipped(moment, wrong)
            relations = [owners[k][0] for k in np.flatnonzero(wrong)]
            flips[relations] += 1
            chattering = [k for k in relations if flips[k] >= _CHATTER and k not in self.events.watched]
            if tally.turns < _MOST_TOGETHER and chattering:
                held = self._slide(t, moment, chattering, notes)
                if held is not None:
                    moment = held
                    flips[:] = 0
            tally.turns += 1
        names = [self.guards.texts[k] for k in np.argsort(-flips)[:4] if flips[k] > 1]
        raise unsettled(self.problem.compiled, t, names or [a.text for a in self.events.assignments])

    def flipped(self, moment: Moment, which: Truth) -> Moment:
        """The other mode for each guard in `which`: a free relation flips, a held one is released."""
        m, regime = moment.m.copy(), moment.regime
        let_go: set[int] = set()
        for k in np.flatnonzero(which):
            relation, side = regime.active_set.owners[k]
            if side < 0:
                m[self.first + relation] = 1.0 - m[self.first + relation]
            else:
                let_go.add(relation)
                sliding = next(h for h in regime.holds if h.relation == relation).target is None
                m[self.first + relation] = float(side) if sliding else 0.0
                for twin in self.problem.compiled.events.twins[relation] if sliding else ():
                    m[self.first + twin] = float(side)
        if let_go:
            regime = Regime(regime.free, tuple(h for h in regime.holds if h.relation not in let_go))
        return Moment(moment.x, moment.z, m, regime)

    def consistent(self, t: float, moment: Moment) -> Moment:
        """Solve for the algebraic variables; if the equations contradict each other, with creep, and thus far out."""
        if not len(moment.z):
            return moment
        problem, start = moment.regime.free, Start(moment.x, moment.z, ())
        numbers = problem.u, problem.p, moment.m
        if self.shares is None:
            problem = moment.regime.problem
            return replace(moment, z=consistent(problem.compiled, t, start, problem.p, problem.u, moment.m).z)
        border = self.shares.border(problem.compiled, t, moment.x, moment.z, *numbers)
        regime = self.regime(moment.regime, border)
        moment = replace(moment, regime=regime)
        z = consistent(regime.compiled, t, start, problem.p, problem.u, moment.m).z
        if border is not None and self.shares.contradicts(border, self._errors(moment), t, moment.x, z, *numbers):
            m = moment.m.copy()
            m[self.shares.place] = self.shares.creep(t, moment.x, z, *numbers)
            z = consistent(problem.compiled, t, start, problem.p, problem.u, m).z
        return replace(moment, z=z)

    def _errors(self, moment: Moment) -> Vector:
        """Errors of the states: ten tolerances, as for guards."""
        return 10.0 * self.guards.tolerances.of(moment.x, self.problem.compiled.nominal_x)

    def regime(self, of: Regime, border: Border | None) -> Regime:
        """The regime with the same holds and another border."""
        if of.border is border:
            return of
        key = of.holds, border
        if key not in self._regimes:
            self._regimes[key] = Regime(of.free, of.holds, border)
        return self._regimes[key]

    def _wrong(self, t: float, moment: Moment, tally: _Tally, leaving: bool) -> Truth:
        """Guards of the regime that do not hold, or, with `leaving`, that are at zero and about to become negative.

        `tally.noise` is the largest noise of each relation in all modes so far, by which a relation is judged that has
        flipped and come back. With the noise of each mode, which may be small in one and large in the next, four diodes
        at the zero crossing of their source would cycle for ever.
        """
        g = self.guards.distances(t, moment)
        if (g > 1.0).all():  # far from everything: no rates needed
            return np.zeros(len(g), dtype=bool)
        rate, noise = self.guards.rates(t, moment, distances=g)
        relations, sides = moment.regime.active_set.owner, moment.regime.active_set.side
        free = sides < 0
        own_noise = noise
        tally.noise[relations[free]] = np.maximum(tally.noise[relations[free]], noise[free])
        noise = np.where(free & (tally.flips[relations] > 1), tally.noise[relations], noise)
        # not the whole noise, because a thin plate has its other side within it
        reached = self.guards.are_reached(t, moment, g, rate, noise)
        is_at_guard = np.where(tally.flips[relations] > 0, g <= STILL * noise, reached)
        is_at_guard |= g <= np.abs(rate) * same_instant(self.guards.span, t)
        if not (is_at_guard | (g <= 0.0)).any():
            return np.zeros(len(g), dtype=bool)
        wrong = g < -2 * noise
        leaves = is_at_guard & (rate < -noise)
        if leaves.any():
            leaves &= ~self.guards.are_steep(t, moment, g, own_noise)
        # the instant may have been located too early: the present mode holds for nanoseconds, the other not yet
        flips = tally.flips[relations]
        chatters = flips >= _CHATTER
        is_early = leaves & (g > 0.0) & chatters
        # or too late: the present mode does not hold any more, and the other will in a moment
        if chatters.any():
            wrong &= ~(chatters & (rate > 0.0) & self.guards.are_at_zero(t, g, rate, noise))
        is_tied = free & (g == 0.0) & (rate == 0.0) & (flips < _MOST_TIED)
        if is_tied.any():
            wrong |= is_tied & self._differ_from_ties(moment, relations)
        # or it begins or ceases to rest, and only rounding errors decide on which side of that it is
        at_rest = (g == -AT_REST) & (flips > _MOST_TIED)
        if at_rest.any():
            wrong &= ~(at_rest & self.guards.rests[relations])
        # for relations of time alone, `pre` is always up to date
        result = np.asarray(
            wrong | leaves & ~is_early & (leaving | (tally.is_timed & free & self.guards.timed[relations]))
        )
        if self.waiting:
            result &= ~np.isin(relations, list(self.waiting))
        if is_early.any() and not result.any():
            self._count_kept(t, [moment.regime.active_set.owners[k][0] for k in np.flatnonzero(is_early)])
        return result

    def _differ_from_ties(self, moment: Moment, relations: NDArray[np.int64]) -> Truth:
        """Whether the modes of relations differ from their literal values at equal sides.

        The rate does not show on which side of its guard a relation is that stays there, such as one of a velocity that
        was reset to zero, or of a number of steps that has reached its limit.
        """
        ties = self.guards.ties[relations]
        return np.asarray((ties >= 0) & (moment.m[self.first + relations] != ties))

    def _count_kept(self, t: float, relations: list[int]) -> None:
        """Count modes that are kept for a moment; refuse chattering, which would be kept at each switching."""
        for relation in relations:
            last, count = self._kept.get(relation, (-np.inf, 0))
            count = count + 1 if t - last <= _KEPT_WITHIN * self.guards.span else 1
            self._kept[relation] = t, count
            if count > _MOST_KEPT:
                raise unsettled(self.problem.compiled, t, [self.guards.texts[relation]])

    def _slide(self, t: float, moment: Moment, relations: list[int], notes: list[str]) -> Moment | None:
        """Hold relations between their two modes in a sliding mode; None if that is no solution."""
        regime = moment.regime
        border = regime.border
        for relation in relations:
            if relation in regime.active_set.taken:
                continue
            regime = Regime(regime.free, (*regime.holds, Hold(relation)), border)
        if len(regime.holds) == len(moment.regime.holds) or not regime.active_set.is_possible:
            return None
        trial = self.consistent(t, Moment(moment.x, moment.z, moment.m, regime))
        if not regime.is_solvable(t, trial.x, trial.z, trial.m):
            return None
        trial = self.consistent(t, replace(trial, x=self.guards.projected(t, trial)))
        ends = [k for k, (r, side) in enumerate(regime.active_set.owners) if side >= 0 and r in relations]
        if (self.guards.distances(t, trial)[ends] < 0).any():
            return None
        for relation in (h.relation for h in regime.holds[len(moment.regime.holds) :]):
            notes.append(f"{SLIDING} from t = {t:.9g} s on: {self.guards.texts[relation]} is held at its switch")
        return trial

    def _round(self, t: float, moment: Moment, was: Vector, decided: Vector, level: float) -> Round:
        p = self.problem
        found = self.round(t, moment.x, moment.z, p.u, p.p, moment.m, was, decided, level)
        for k in _SCALARS:
            found[k] = float(found[k][0])  # type: ignore[call-overload]
        result = Round(*found)
        # nan differs from itself, so rounds would not settle
        undefined = [*self.assigned[np.isnan(result.assigned)].tolist(), *np.flatnonzero(np.isnan(result.x)).tolist()]
        if undefined and not result.clash:
            raise not_a_number(p.compiled, t, undefined[0])
        return result

    def _check(self, t: float, holds: Vector, notes: list[str]) -> None:
        for k, (asserted, truth) in enumerate(zip(self.events.asserts, holds, strict=True)):
            if truth > 0.5:
                self._broken.discard(k)
                continue
            if asserted.level == "error":
                raise violated(self.problem.compiled.name, t, asserted)
            if k not in self._broken:  # noted once, until it holds again
                notes.append(warned(t, asserted))
            self._broken.add(k)
