"""What happens at an event: modes and discrete equations iterate to a fixed point, `when` clauses act, and again.

Source of the meaning: Modelica language specification 3.6, section 8.6 (event iteration). Relations are flipped all at
once at first; a loop of modes that does not settle so is walked one relation at a time, the one of lowest number
first, which ends for every P-matrix, that is for passive circuits and for friction (K. G. Murty, Note on a Bard-type
scheme for solving the complementarity problem, Opsearch 11, 1974).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acausal.lower.state_events import Clause
from acausal.simulate.event_errors import contradicting, unsettled, violated
from acausal.simulate.guards import LOCATED, Cause, Guards, Moment, Truth
from acausal.simulate.initialize import Start, consistent
from acausal.simulate.kept import kept
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Hold, Regime

Vector = NDArray[np.float64]
_MOST_ROUNDS = 400
_AT_ONCE = 12
_MOST_SINGLE = 2000
# A relation that has flipped so often at one instant leads back to itself from both sides.
_CHATTER = 3


@dataclass(frozen=True, eq=False)
class Happened:
    """The moment after an event, what is said of it, and the moments at which `when` clauses acted, with which."""

    moment: Moment
    causes: tuple[Cause, ...] = ()
    changed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    terminated: str | None = None
    jumps: tuple[tuple[Moment, Truth], ...] = ()


@dataclass
class _Walk:
    """What is remembered over one event: flips of each relation, how far each can be wrong, and turns so far."""

    flips: NDArray[np.int_]
    doubt: Vector
    turn: int = 0


class Iteration:
    """The event iteration of one problem."""

    def __init__(self, problem: Problem, guards: Guards) -> None:
        self.problem = problem
        self.guards = guards
        compiled = problem.compiled
        self.events = compiled.state_events
        self.reactions = kept(compiled).reactions
        self.first = guards.first
        first_sample = compiled.n_timely
        first_memory = first_sample + len(self.events.samples)
        first_flag = first_memory + len(self.events.memories)
        self.samples = slice(first_sample, first_memory)
        self.memories = slice(first_memory, first_flag)
        self.flags = slice(first_flag, first_flag + len(self.events.flags))
        nodes = compiled.solution.structure.reduced.pool.nodes
        self.flag_names = [nodes[n][0] for n in self.events.flags]
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

        Parameters
        ----------
        before
            The modes that held before the event; a `when` acts if its condition was false under them.
        samples, flag
            Which samples are true now; "initial" or "terminal" at the ends of a run.
        """
        causes: list[Cause] = []
        changed: dict[str, None] = {}
        notes: list[str] = []
        jumps: list[tuple[Moment, Truth]] = []
        terminated: str | None = None
        was = self._conditions(t, moment, before)
        rising = np.zeros(0, dtype=bool)
        x_before = moment.x
        m = moment.m.copy()
        m[self.samples] = 0.0 if samples is None else samples
        m[self.flags] = [float(name == flag) for name in self.flag_names]
        moment = replace(moment, m=m)
        walk = _Walk(np.zeros(len(m) - self.first, dtype=int), np.zeros(len(m) - self.first))
        for _ in range(_MOST_ROUNDS):
            moment = self.decide(t, moment, notes, walk)
            reacted = self._react(t, moment)
            conditions = reacted[2] > 0.5
            rising = conditions & ~was
            remembered = reacted[4]
            if not rising.any() and np.array_equal(remembered, moment.m[self.memories]):
                break
            jumps.append((moment, rising))
            x, k = moment.x.copy(), 0
            setters: dict[int, Clause] = {}
            for clause, acts in zip(self.events.clauses, rising, strict=True):
                if acts:
                    causes.append(Cause(clause.text, clause.where, clause.component))
                    terminated = clause.terminate or terminated
                for position, _ in clause.actions:
                    if acts:
                        first = setters.setdefault(position, clause)
                        if first is not clause and x[position] != reacted[3][k]:
                            name = self.problem.compiled.states[position]
                            raise contradicting(self.problem.compiled.name, t, name, (first, clause))
                        x[position] = reacted[3][k]
                    k += 1
            m = moment.m.copy()
            m[self.memories] = remembered
            moment, was = replace(moment, x=x, m=m), conditions
        else:
            acting = [c.text for c, r in zip(self.events.clauses, rising, strict=True) if r]
            raise unsettled(self.problem.compiled.name, t, acting or [a.text for a in self.events.assignments])
        moment = self._over(t, moment)
        for position in np.flatnonzero(moment.x != x_before).tolist():
            changed[self.problem.compiled.states[position]] = None
        self._check(t, reacted[5], notes)
        return Happened(moment, tuple(causes), tuple(changed), tuple(notes), terminated, tuple(jumps))

    def _over(self, t: float, moment: Moment) -> Moment:
        """The moment after the instant: samples and flags are false again, also to what remembers them."""
        m = moment.m.copy()
        m[self.samples] = 0.0
        m[self.flags] = 0.0
        if len(self.events.memories) and not np.array_equal(m, moment.m):
            m[self.memories] = self._react(t, replace(moment, m=m))[4]
        return replace(moment, m=m)

    def decide(self, t: float, moment: Moment, notes: list[str], walk: _Walk) -> Moment:
        """Flip relations and apply discrete equations until all hold at this point, or leave their guard rightly.

        A relation at its guard that is about to leave it to the wrong side is flipped only when what is remembered is
        up to date: a thermostat that has just switched off must have noticed it before the falling temperature makes
        `T < limit` true again.
        """
        flips = walk.flips
        for _ in range(_MOST_SINGLE):
            moment = self.consistent(t, moment)
            reacted = self._react(t, moment)
            if not (reacted[1] == moment.x[self.assigned]).all():
                # relations are judged by what follows from them: a step behind, they would run in circles
                x = moment.x.copy()
                x[self.assigned] = reacted[1]
                moment = replace(moment, x=x)
                continue
            wrong = np.zeros(0, dtype=bool)
            if len(moment.regime.owners):
                wrong = self._wrong(t, moment, walk, np.array_equal(reacted[4], moment.m[self.memories]))
            if not wrong.any():
                return moment
            if walk.turn >= _AT_ONCE:
                wrong[int(np.argmax(wrong)) + 1 :] = False
            owners = moment.regime.owners
            moment = self.flipped(moment, wrong)
            ours = [owners[k][0] for k in np.flatnonzero(wrong)]
            flips[ours] += 1
            if walk.turn < _AT_ONCE and (flips[ours] >= _CHATTER).any():
                held = self._slide(t, moment, [k for k in ours if flips[k] >= _CHATTER], notes)
                if held is not None:
                    moment = held
                    flips[:] = 0
            walk.turn += 1
        names = [self.guards.texts[k] for k in np.argsort(-flips)[:4] if flips[k] > 1]
        raise unsettled(self.problem.compiled.name, t, names or [a.text for a in self.events.assignments])

    def flipped(self, moment: Moment, which: Truth) -> Moment:
        """The other mode for each guard that is reached: a relation flips, a held one is let go."""
        m, regime = moment.m.copy(), moment.regime
        let_go: set[int] = set()
        for k in np.flatnonzero(which):
            relation, side = regime.owners[k]
            if side < 0:
                m[self.first + relation] = 1.0 - m[self.first + relation]
            else:
                let_go.add(relation)
                sliding = next(h for h in regime.holds if h.relation == relation).target is None
                m[self.first + relation] = float(side) if sliding else 0.0
        if let_go:
            regime = Regime(regime.free, tuple(h for h in regime.holds if h.relation not in let_go))
        return Moment(moment.x, moment.z, m, regime)

    def consistent(self, t: float, moment: Moment) -> Moment:
        """Algebraic variables for these modes."""
        if not len(moment.z):
            return moment
        problem = moment.regime.problem
        start = Start(moment.x, moment.z, ())
        return replace(moment, z=consistent(problem.compiled, t, start, problem.p, problem.u, moment.m).z)

    def _wrong(self, t: float, moment: Moment, walk: _Walk, leaving: bool) -> Truth:
        """Guards of the regime that do not hold, or, if `leaving` is asked for, are at zero and about not to.

        `walk.doubt` gathers how far each relation can be wrong in all modes seen so far: one that has flipped and come
        back is judged by the largest of these. Judged finely in one mode and coarsely in the next, four diodes at the
        zero crossing of their source would go round for ever.
        """
        g = self.guards.distances(t, moment)
        if (g > 1.0).all():  # far from everything: no rates needed
            return np.zeros(len(g), dtype=bool)
        rate, noise = self.guards.rates(t, moment)
        for k, (relation, side) in enumerate(moment.regime.owners):
            if side < 0:
                walk.doubt[relation] = max(walk.doubt[relation], noise[k])
                noise[k] = walk.doubt[relation] if walk.flips[relation] > 1 else noise[k]
        wrong = g < -2 * noise
        at = g <= LOCATED * noise  # not the whole noise: a thin plate has its other side within it
        return np.asarray(wrong | (at & (rate < -noise)) if leaving else wrong)

    def _slide(self, t: float, moment: Moment, relations: list[int], notes: list[str]) -> Moment | None:
        """Hold relations between their two modes; None when that is no solution."""
        regime = moment.regime
        for relation in relations:
            if any(h.relation == relation for h in regime.holds):
                continue
            regime = Regime(regime.free, (*regime.holds, Hold(relation)))
        if len(regime.holds) == len(moment.regime.holds) or not regime.is_possible:
            return None
        trial = self.consistent(t, Moment(moment.x, moment.z, moment.m, regime))
        if not regime.is_solvable(t, trial.x, trial.z, trial.m):
            return None
        trial = self.consistent(t, replace(trial, x=self.guards.held(t, trial)))
        ends = [k for k, (r, side) in enumerate(regime.owners) if side >= 0 and r in relations]
        if (self.guards.distances(t, trial)[ends] < 0).any():
            return None
        for relation in relations:
            notes.append(f"sliding mode from t = {t:.9g} s on: {self.guards.texts[relation]} is held at its switch")
        return trial

    def _react(self, t: float, moment: Moment) -> list[Vector]:
        p = self.problem
        return self.reactions(t, moment.x, moment.z, p.u, p.p, moment.m)

    def _conditions(self, t: float, moment: Moment, m: Vector) -> Truth:
        return np.asarray(self._react(t, replace(moment, m=m))[2] > 0.5)

    def _check(self, t: float, holds: Vector, notes: list[str]) -> None:
        for broken, truth in zip(self.events.asserts, holds, strict=True):
            if truth <= 0.5:
                error = violated(self.problem.compiled.name, t, broken)
                if broken.level == "error":
                    raise error
                notes.append(f"t = {t:.9g} s: {broken.message}")
