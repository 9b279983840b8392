"""What happens at an event: rounds of the compiled event iteration, and relations that flip between them.

A round (`acausal.lower.events.round`) is the meaning of discrete equations, `when` and `pre`. Between its calls
algebraic variables are solved for and relations that do not hold are flipped: all at once at first; a loop of modes
that does not settle so is walked one relation at a time, the one of lowest number first, which ends for every P-matrix,
that is for passive circuits and for friction (K. G. Murty, Note on a Bard-type scheme for solving the complementarity
problem, Opsearch 11, 1974).
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
from acausal.simulate.events.errors import contradicting, overloaded, undetermined, unsettled, vain, violated
from acausal.simulate.events.guards import AT_REST, LOCATED, Cause, Guards, Moment, as_one
from acausal.simulate.events.regime import Hold, Regime
from acausal.simulate.events.resets.constrained import followed
from acausal.simulate.start.initialize import Start, consistent

_MOST_ROUNDS = 400
_AT_ONCE = 12
_MOST_SINGLE = 2000
# A relation that has flipped so often at one instant leads back to itself from both sides.
_CHATTER = 3
# One that stays where its sides are equal is taken by its word, unless it has flipped so often.
_TWICE = 2
# A relation is kept in its mode for a moment so many times, each within this share of the run from the one before.
_MOST_KEPT, _SOON = 20, 1e-6
Jumped = Callable[[float, Moment], tuple[Vector, tuple[Cause, ...]] | None]
"""Modes in which delayed signals are read where the delays are at a moment, and causes; None if they are already."""
_SCALARS = tuple(Round._fields.index(name) for name in ("level", "settled", "clash"))


@dataclass(frozen=True, eq=False)
class Jump:
    """Actions taken at a moment, one truth for each action of the model; and whether `pre` advanced behind them."""

    moment: Moment
    applied: Truth
    advances: bool


@dataclass(frozen=True, eq=False)
class Happened:
    """The moment after an event, what is said of it, what clauses did on the way, and which of them acted."""

    moment: Moment
    causes: tuple[Cause, ...] = ()
    changed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    terminated: str | None = None
    jumps: tuple[Jump, ...] = ()
    acted: tuple[int, ...] = ()


@dataclass
class _Walk:
    """What is remembered over one event: flips of each relation, how far each can be wrong, and turns so far."""

    flips: NDArray[np.int_]
    doubt: Vector
    turn: int = 0
    causes: list[Cause] = field(default_factory=list)
    """Delays that have jumped."""
    is_timed: bool = True
    """Whether relations of time alone change before anything acts; not while `initial()` holds others back."""


@dataclass
class _Story:
    """What is told of an event."""

    causes: list[Cause] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    jumps: list[Jump] = field(default_factory=list)
    acted: list[int] = field(default_factory=list)
    terminated: str | None = None


class Iteration:
    """The event iteration of one problem; `jumped` says where a past is that is read at other instants by an event."""

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
        """Iterate from modes that have changed already.

        `before`: The modes that held before the event; a `when` acts if its condition was false under them.
        `samples`, `flag`: Which samples are true now; "initial" or "terminal" at the ends of a run. What `initial()`
        sets is the start: no other `when` acts because of it (Modelica 3.6, section 8.6).
        """
        m = moment.m.copy()
        m[self.samples] = 0.0 if samples is None else samples
        m[self.flags] = [float(name == flag) for name in self.flag_names]
        known = self._known(t, moment, m, before)
        if known is not None:
            return Happened(known)
        x_before, was = moment.x, np.zeros(self.conditions)
        if self.conditions:
            was = self._round(t, Moment(x_before, moment.z, before, moment.regime), was, was, 0.0).conditions
        story, entered = _Story(), m
        try:
            held = 1.0 - self.opening if flag == "initial" and self.opening.any() else None
            moment, last = self._rounds(t, Moment(moment.x, moment.z, m, moment.regime), was, held, story)
            moment, over = self._over(t, moment, last, flag)
            if not (over.assigned == moment.x[self.assigned]).all():
                held = np.ones(self.conditions) if flag == "initial" else None
                moment, last = self._rounds(t, moment, last.conditions, held, story)
        except InitializationError as error:
            if flag == "initial" or error.code not in ("AC301", "AC304"):
                raise
            raise undetermined(t, error) from error
        self._shared(t, moment, story.notes)
        states = self.problem.compiled.states
        changed = tuple(states[k] for k in np.flatnonzero(moment.x != x_before).tolist())
        self._check(t, last.asserts, story.notes)
        jumps, acted = tuple(story.jumps), tuple(story.acted)
        happened = Happened(moment, tuple(story.causes), changed, tuple(story.notes), story.terminated, jumps, acted)
        same = np.array_equal(before, entered) and np.array_equal(entered, moment.m)
        self._settled = (t, moment) if same and not (changed or happened.causes or jumps or story.terminated) else None
        return happened

    def _known(self, t: float, moment: Moment, m: Vector, before: Vector) -> Moment | None:
        """What the last iteration ended with if it began like this one: a run starts where its first stretch does.

        Delays are asked for again, because what they read grows.
        """
        if self._settled is None or self.jumped is not None:
            return None
        then, known = self._settled
        is_there = t == then and moment.x is known.x and moment.z is known.z and moment.regime is known.regime
        return known if is_there and np.array_equal(m, known.m) and np.array_equal(before, known.m) else None

    def _rounds(
        self, t: float, moment: Moment, was: Vector, held: Vector | None, story: _Story
    ) -> tuple[Moment, Round]:
        """Rounds until one changes nothing; the moment then, and what that round gave.

        `was`: The truth of the conditions before. `held`: 1 for those that do not become true while `initial()` acts.
        """
        decided, level, acting = np.zeros_like(was), 0.0, np.zeros(0, dtype=int)
        count = len(moment.m) - self.first
        walk = _Walk(np.zeros(count, dtype=int), np.zeros(count))
        for _ in range(self.most_rounds):
            was = was if held is None else np.maximum(was, held)
            walk.is_timed = held is None
            moment, found = self.decide(t, moment, story.notes, walk, (was, decided, level))
            story.causes += walk.causes
            walk.causes.clear()
            advances, m = found.level == 0.0, found.m
            if found.clash:
                raise self._clash(t, moment, found)
            acting = np.flatnonzero(found.acting) if advances else np.zeros(0, dtype=int)
            story.acted += acting.tolist()
            for k in acting:
                clause = self.events.clauses[k]
                story.causes.append(Cause(clause.text, clause.where, clause.component))
                story.terminated = clause.terminate or story.terminated
            if found.settled:
                return moment, found
            applied, x = found.applied > 0.5, found.x
            moves = not np.array_equal(found.x[: self.dynamic], moment.x[: self.dynamic])
            if held is not None and advances:
                # conditions see what states begin with once, under the `pre` of the start; only then does that advance
                held = np.ones_like(held) if moves else None
                if moves:
                    m, advances = moment.m, False
            if applied.any() or not np.array_equal(m, moment.m):
                story.jumps.append(Jump(moment, applied, advances))
            if moves:
                if self.is_constrained:
                    x = self._followed(t, moment, found.x, applied, story.notes)
                walk = _Walk(np.zeros(count, dtype=int), np.zeros(count))  # other states: no relation leads back yet
            moment = Moment(x, moment.z, m, self._released(t, moment, x))
            was, decided, level = found.was, found.decided, float(found.level)
        texts = [self.events.clauses[k].text for k in acting]
        raise unsettled(self.problem.compiled, t, texts or [a.text for a in self.events.assignments])

    def _released(self, t: float, moment: Moment, x: Vector) -> Regime:
        """The regime without what rested until the states jumped: its velocity is another one."""
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

    def _followed(self, t: float, moment: Moment, x: Vector, applied: Truth, notes: list[str]) -> Vector:
        """States after the actions that were applied, on the stabilised constraints; a note where others jump, too."""
        actions = (place for clause in self.events.clauses for place, _ in clause.actions)
        places = [place for place, acts in zip(actions, applied, strict=True) if acts]
        numbers = moment.z, self.problem.u, self.problem.p, moment.m
        found = followed(self.problem.compiled, t, moment.x, x, places, numbers)
        states = self.problem.compiled.states
        moved = tuple(states[k] for k in np.flatnonzero(found != x).tolist())
        if moved and ("reset", *moved) not in self._noted:
            self._noted.add(("reset", *moved))
            notes.append(
                f"t = {t:.9g} s: a `reset` moves {listed(moved)} too, by the constraints that bind them; "
                "reset(velocity, value, by=force) says which force does it"
            )
        return found

    def _shared(self, t: float, moment: Moment, notes: list[str]) -> None:
        """Refuse modes that contradict each other, and say which loads nothing determines."""
        if self.shares is None or moment.regime.border is None:
            return
        at = t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m
        names = self.shares.open(*at)
        if self.shares.contradicts(*at):
            raise overloaded(self.problem.compiled.name, t, names)
        if names not in self._noted:
            self._noted.add(names)
            least = "the least of it is taken" if len(names) == 1 else "the shares of least squares are taken"
            notes.append(f"statically undetermined from t = {t:.9g} s on: {listed(names)}; {least}")

    def check_shares(self, times: Vector, x: Vector, z: Vector, moment: Moment) -> None:
        """Refuse rows at which equations that were taken to depend on each other contradict each other.

        A mechanism that has stood in a singular position and has left it: what held it there no longer does.
        """
        if self.shares is None or moment.regime.border is None:
            return
        for k, t in enumerate(times.tolist()):
            at = t, x[:, k], z[:, k], self.problem.u, self.problem.p, moment.m
            if self.shares.contradicts(*at):
                raise overloaded(self.problem.compiled.name, t, self.shares.open(*at))

    def _clash(self, t: float, moment: Moment, found: Round) -> Exception:
        """The error for clauses that act at one instant and disagree; found by what each would set."""
        compiled = self.problem.compiled
        values = functions_of(compiled).reactions(t, moment.x, moment.z, self.problem.u, self.problem.p, moment.m)[3]
        setters: dict[int, tuple[Clause, float]] = {}
        acting = (found.applied > 0.5).tolist()
        actions = [(clause, place) for clause in self.events.clauses for place, _ in clause.actions]
        for (clause, place), acts, value in zip(actions, acting, values.tolist(), strict=True):
            if acts:
                first, other = setters.setdefault(place, (clause, value))
                if other != value:
                    return contradicting(compiled.name, t, compiled.states[place], (first, clause))
        striking = [actions[a][0] for a, _ in impulses(compiled) if acting[a]]
        return vain(compiled.name, t, striking or [c for c, _ in setters.values()])

    def _over(self, t: float, moment: Moment, last: Round, flag: str | None) -> tuple[Moment, Round]:
        """The moment after the instant, when samples and flags are false again, also to what remembers them.

        Nothing follows what is terminal: that remains true.

        A discrete equation may read them, as that of a trigger, `y == sample(0, 1)`, does: it is evaluated again, in
        rounds of its own, since what it assigns has changed and a `when` may act because of that.
        """
        m = moment.m.copy()
        m[self.samples] = 0.0
        if flag != "terminal":
            m[self.flags] = 0.0
        moment, is_over = Moment(moment.x, moment.z, m, moment.regime), np.array_equal(m, moment.m)
        if is_over or not (len(self.events.memories) or len(self.assigned)):
            return moment, last
        none = np.zeros(self.conditions)
        found = self._round(t, moment, none, none, 0.0)
        m[self.memories] = found.remembered
        return moment, found

    def decide(
        self, t: float, moment: Moment, notes: list[str], walk: _Walk, progress: tuple[Vector, Vector, float]
    ) -> tuple[Moment, Round]:
        """Flip relations and apply discrete equations until all hold at this point, or leave their guard rightly.

        `progress` is how far the round has come: was, decided, level. The result is the moment and what the round makes
        of it. A relation at its guard that is about to leave it to the wrong side is flipped only when what is
        remembered is up to date: a thermostat that has just switched off must have noticed it before the falling
        temperature makes `T < limit` true again.
        """
        flips = walk.flips
        for _ in range(_MOST_SINGLE):
            moment = self.consistent(t, moment)
            other = None if self.jumped is None else self.jumped(t, moment)
            if other is not None:
                moment = replace(moment, m=other[0])
                walk.causes += other[1]
                continue
            found = self._round(t, moment, *progress)
            if not (found.assigned == moment.x[self.assigned]).all():
                # relations are judged by what follows from them: a step behind, they would run in circles
                x = moment.x.copy()
                x[self.assigned] = found.assigned
                moment = Moment(x, moment.z, moment.m, moment.regime)
                continue
            wrong = np.zeros(0, dtype=bool)
            if len(moment.regime.active_set.owners):
                wrong = self._wrong(t, moment, walk, np.array_equal(found.remembered, moment.m[self.memories]))
            if not wrong.any():
                return moment, found
            if walk.turn >= _AT_ONCE:
                wrong[int(np.argmax(wrong)) + 1 :] = False
            owners = moment.regime.active_set.owners
            moment = self.flipped(moment, wrong)
            ours = [owners[k][0] for k in np.flatnonzero(wrong)]
            flips[ours] += 1
            back = [k for k in ours if flips[k] >= _CHATTER and k not in self.events.watched]
            if walk.turn < _AT_ONCE and back:
                held = self._slide(t, moment, back, notes)
                if held is not None:
                    moment = held
                    flips[:] = 0
            walk.turn += 1
        names = [self.guards.texts[k] for k in np.argsort(-flips)[:4] if flips[k] > 1]
        raise unsettled(self.problem.compiled, t, names or [a.text for a in self.events.assignments])

    def flipped(self, moment: Moment, which: Truth) -> Moment:
        """The other mode for each guard that is reached: a relation flips, a held one is let go."""
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
        """Algebraic variables for these modes; far out where the equations contradict each other in them."""
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
        if border is not None and self.shares.contradicts(t, moment.x, z, *numbers):
            m = moment.m.copy()
            m[self.shares.place] = self.shares.creep(t, moment.x, z, *numbers)
            z = consistent(problem.compiled, t, start, problem.p, problem.u, m).z
        return replace(moment, z=z)

    def regime(self, of: Regime, border: Border | None) -> Regime:
        """The same holds with these equations."""
        if of.border is border:
            return of
        key = of.holds, border
        if key not in self._regimes:
            self._regimes[key] = Regime(of.free, of.holds, border)
        return self._regimes[key]

    def _wrong(self, t: float, moment: Moment, walk: _Walk, leaving: bool) -> Truth:
        """Guards of the regime that do not hold, or, if `leaving` is asked for, are at zero and about not to.

        `walk.doubt` gathers how far each relation can be wrong in all modes seen so far: one that has flipped and come
        back is judged by the largest of these. Judged finely in one mode and coarsely in the next, four diodes at the
        zero crossing of their source would go round for ever.
        """
        g = self.guards.distances(t, moment)
        if (g > 1.0).all():  # far from everything: no rates needed
            return np.zeros(len(g), dtype=bool)
        rate, noise = self.guards.rates(t, moment, distances=g)
        own, sides = moment.regime.active_set.owner, moment.regime.active_set.side
        free = sides < 0
        walk.doubt[own[free]] = np.maximum(walk.doubt[own[free]], noise[free])
        noise = np.where(free & (walk.flips[own] > 1), walk.doubt[own], noise)
        wrong = g < -2 * noise
        # not the whole noise: a thin plate has its other side within it; but as near as instants are found
        at = g <= np.maximum(LOCATED * noise, np.abs(rate) * as_one(self.guards.span, t))
        leaves = at & (rate < -noise)
        # an instant that was found early: one mode still holds for nanoseconds, the other one does not yet
        back = walk.flips[own] >= _CHATTER
        early = leaves & (g > 0.0) & back
        # or one holds no more, and the other one does some instants from now
        wrong &= ~(back & (rate > 0.0) & self.guards.behind(t, g, rate, noise))
        wrong |= free & (g == 0.0) & (rate == 0.0) & (walk.flips[own] < _TWICE) & self._untied(moment, own)
        # or it begins or ends to rest here, and rounding alone says on which side of that it is
        wrong &= ~((g == -AT_REST) & self.guards.rests[own] & (walk.flips[own] > _TWICE))
        # of time alone nothing that is remembered can be behind
        found = np.asarray(wrong | leaves & ~early & (leaving | (walk.is_timed & free & self.guards.timed[own])))
        if early.any() and not found.any():
            self._stay(t, [moment.regime.active_set.owners[k][0] for k in np.flatnonzero(early)])
        return found

    def _untied(self, moment: Moment, relations: NDArray[np.int64]) -> Truth:
        """Whether the modes of these relations are not what their words say of sides that are equal.

        One that stays on its guard does not tell by its rate which side it is on: a velocity that was reset to zero, a
        number of steps that has come to its limit.
        """
        ties = self.guards.ties[relations]
        return np.asarray((ties >= 0) & (moment.m[self.first + relations] != ties))

    def _stay(self, t: float, relations: list[int]) -> None:
        """Count modes that were kept for a moment more; what chatters would be kept so at each of its switchings."""
        for relation in relations:
            last, count = self._kept.get(relation, (-np.inf, 0))
            count = count + 1 if t - last <= _SOON * self.guards.span else 1
            self._kept[relation] = t, count
            if count > _MOST_KEPT:
                raise unsettled(self.problem.compiled, t, [self.guards.texts[relation]])

    def _slide(self, t: float, moment: Moment, relations: list[int], notes: list[str]) -> Moment | None:
        """Hold relations between their two modes; None when that is no solution."""
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
            notes.append(f"sliding mode from t = {t:.9g} s on: {self.guards.texts[relation]} is held at its switch")
        return trial

    def _round(self, t: float, moment: Moment, was: Vector, decided: Vector, level: float) -> Round:
        p = self.problem
        found = self.round(t, moment.x, moment.z, p.u, p.p, moment.m, was, decided, level)
        for k in _SCALARS:
            found[k] = float(found[k][0])  # type: ignore[call-overload]
        return Round(*found)

    def _check(self, t: float, holds: Vector, notes: list[str]) -> None:
        for k, (asserted, truth) in enumerate(zip(self.events.asserts, holds, strict=True)):
            if truth > 0.5:
                self._broken.discard(k)
                continue
            if asserted.level == "error":
                raise violated(self.problem.compiled.name, t, asserted)
            if k not in self._broken:  # once, not at every event until it holds again
                place = f"{asserted.component}: " if asserted.component else ""
                notes.append(f"t = {t:.9g} s: {place}{asserted.message}")
            self._broken.add(k)
