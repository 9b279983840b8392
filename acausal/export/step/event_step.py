"""Event iteration within a step of bounded work: the compiled event round, called at most a fixed number of times.

A pass solves for the algebraic variables and then does one thing: evaluate discrete equations, or flip relations that
do not hold, or continue the round (`acausal.lower.events.round`), as `acausal.simulate.events.iteration` does. Passes
are repeated as long as anything changes. The generated code tests this before each pass, so that unnecessary ones cost
nothing. The result includes whether the iteration has settled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from acausal.export.step.methods import Method
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.round import Round
from acausal.simulate.events.guards import LEAST

# Error of states assumed when relations are evaluated, relative to value plus nominal magnitude.
_STATE_ERROR = 1e-9
# How an event iteration ends: settled, or with two clauses that set one variable to different values (AC504 in a run).
_SETTLED, _CLASH = 1, 2


@dataclass(frozen=True, eq=False)
class Settling:
    """The event iteration of one model; `method` solves for the algebraic variables."""

    compiled: CompiledModel
    method: Method

    @property
    def samples(self) -> slice:
        """Slice of the samples in the modes."""
        first = self.compiled.n_timely
        return slice(first, first + len(self.compiled.state_events.samples))

    @property
    def memories(self) -> slice:
        """Slice of the values of `pre` in the modes."""
        first = self.samples.stop
        return slice(first, first + len(self.compiled.state_events.memories))

    @property
    def relations(self) -> slice:
        """Slice of the relations of variables in the modes."""
        last = self.compiled.n_modes
        return slice(last - len(self.compiled.state_events.relations), last)

    @property
    def passes(self) -> int:
        """Maximum number of passes: a few for everything that can change at one instant."""
        events = self.compiled.state_events
        return 8 + 4 * (len(events.conditions) + len(events.relations) + len(events.assignments) + len(events.memories))

    @cached_property
    def settled(self) -> Any:
        """MX function `(t, x, z, u, p, m, before, samples, skip) -> (x, z, m, settled)`: the event iteration.

        `m` are the modes already changed, `before` those before the event; `samples` is 1 for each sample that is true
        now; with `skip` nothing is done. The passes are a loop, of which only the necessary ones are executed.
        """
        s, size = Symbols(self.compiled), len(self.compiled.state_events.conditions)
        before = ca.SX.sym("before", self.compiled.n_modes)
        samples, skip = ca.SX.sym("samples", self.samples.stop - self.samples.start), ca.SX.sym("skip")
        none = ca.SX(size, 1)
        was = Round(*self.compiled.events.round(s.t, s.x, s.z, s.u, s.p, before, none, none, 0)).conditions
        m = ca.SX(s.m)
        m[self.samples] = samples
        flips = ca.SX(len(self.compiled.state_events.relations), 1)
        state = ca.densify(ca.vertcat(s.x, s.z, m, was, none, 0, flips, skip, s.t, s.u, s.p))
        first = ca.Function("first", [*s.inputs, before, samples, skip], [state])
        symbols = [ca.MX.sym(first.name_in(k), first.sparsity_in(k)) for k in range(first.n_in())]
        passes = self._pass.fold(self.passes)
        end_state = passes(first(*symbols))
        if samples.numel() and self.compiled.state_events.assignments:
            end_state = passes(self._without_samples(end_state))
        return ca.Function("settled", symbols, self._last(end_state))

    @property
    def _sizes(self) -> list[int]:
        """Sizes of the parts of the loop state: x, z, m, was, decided, level, flips of relations, settled, t, u, p."""
        c = self.compiled
        size = len(c.state_events.conditions)
        fixed = 1, len(c.inputs), len(c.parameters)
        return [len(c.states), len(c.algebraic), c.n_modes, size, size, 1, len(c.state_events.relations), 1, *fixed]

    def _parts(self, state: Any) -> list[Any]:
        ends = [0]
        for size in self._sizes:
            ends.append(ends[-1] + size)
        return list(ca.vertsplit(state, ends))

    @cached_property
    def _pass(self) -> Any:
        """Function `state -> state` of one pass; the identity if the state is settled."""
        state = ca.SX.sym("state", sum(self._sizes))
        x, z, m, was, decided, level, flips, _, t, u, p = self._parts(state)
        z = self.method.algebraic(t, x, z, [u, p, m])
        here = [t, x, z, u, p, m]
        found = Round(*self.compiled.events.round(*here, was, decided, level))
        places = [a.position for a in self.compiled.state_events.assignments]
        stale = any_of(found.assigned[k] != x[place] for k, place in enumerate(places))
        fresh = ca.logic_not(any_of(found.remembered[k] != m[j] for k, j in enumerate(_places(self.memories))))
        wrong = self._wrong(here, fresh, flips)
        moves = ca.logic_or(stale, any_of(wrong))
        assigned, flipped = ca.SX(x), ca.SX(m)
        for k, place in enumerate(places):
            assigned[place] = ca.if_else(stale, found.assigned[k], x[place])
        for k, j in enumerate(_places(self.relations)):
            flipped[j] = ca.if_else(ca.logic_and(ca.logic_not(stale), wrong[k]), 1 - m[j], m[j])
        after = [
            ca.if_else(moves, a, b)
            for a, b in (
                (assigned, found.x),
                (z, z),
                (flipped, found.m),
                (was, found.was),
                (decided, found.decided),
                (level, found.level),
                (flips + ca.if_else(stale, 0, ca.vertcat(ca.SX(0, 1), *wrong)), flips),
                (0, ca.if_else(found.clash, _CLASH, found.settled)),
            )
        ]
        go = ca.Function("go", [state], [ca.cse(ca.densify(ca.vertcat(*after, t, u, p)))])
        stay = ca.Function("stay", [state], [state])
        choice = ca.Function.if_else("choice", stay, go)
        argument = ca.MX.sym("state", state.numel())
        return ca.Function("pass", [argument], [choice(self._parts(argument)[7], argument)])

    @cached_property
    def _without_samples(self) -> Any:
        """Function `state -> state`: samples become false; if discrete equations read them, the iteration continues."""
        state = ca.SX.sym("state", sum(self._sizes))
        x, z, m, was, decided, level, flips, settled, *held = self._parts(state)
        m = ca.SX(m)
        last = Round(*self.compiled.events.round(held[0], x, z, *held[1:], m, was, decided, level))
        m[self.samples] = 0
        found = Round(*self.compiled.events.round(held[0], x, z, *held[1:], m, was, decided, level))
        places = [a.position for a in self.compiled.state_events.assignments]
        stale = any_of(found.assigned[k] != x[place] for k, place in enumerate(places))
        # a state that has not settled is left as it is, so that it is still reported as unsettled
        more = ca.logic_and(stale, settled == _SETTLED)
        if self.memories.stop > self.memories.start:  # CasADi makes empty vectors of incompatible shapes
            m[self.memories] = ca.if_else(more, found.remembered, m[self.memories])
        reset = [ca.if_else(more, a, b) for a, b in ((last.conditions, was), (0, decided), (0, level), (0, flips))]
        modes = ca.if_else(more, m, self._parts(state)[2])
        parts = [x, z, modes, *reset, ca.if_else(more, 0, settled), *held]
        return ca.Function("without_samples", [state], [ca.cse(ca.densify(ca.vertcat(*parts)))])

    @cached_property
    def _last(self) -> Any:
        """Function `state -> (x, z, m, settled)` that ends the instant: samples become false, also in `pre`."""
        state = ca.SX.sym("state", sum(self._sizes))
        x, z, m, was, decided, level, _, settled, t, u, p = self._parts(state)
        m = ca.SX(m)
        m[self.samples] = 0
        if self.samples.stop > self.samples.start and self.memories.stop > self.memories.start:
            found = Round(*self.compiled.events.round(t, x, z, u, p, m, was, decided, level))
            m[self.memories] = found.remembered
        return ca.Function("last", [state], [ca.densify(v) for v in (x, z, m, settled == _SETTLED)])

    def _wrong(self, here: list[Any], fresh: Any, flips: Any) -> list[Any]:
        """1 for each relation that does not hold, or is at its guard and about to change (once `pre` is up to date).

        A relation that stays at its guard takes its value for equal sides, unless it has flipped twice.
        """
        g = self.compiled.events.watch(*here)
        rate, noise = self.rates(*here)
        noise = self._steady(here, noise)
        ties, modes, timed = self.compiled.events.ties, here[5][self.relations], self.compiled.events.timed
        found = []
        for k in range(g.numel()):
            leaves = ca.logic_and(g[k] <= noise[k], rate[k] < -noise[k])
            leaves = leaves if timed[k] else ca.logic_and(fresh, leaves)
            found.append(ca.logic_or(g[k] < -2 * noise[k], leaves))
            if ties[k] >= 0:
                stays = ca.logic_and(ca.logic_and(g[k] == 0, rate[k] == 0), flips[k] < 2)
                found[-1] = ca.logic_or(found[-1], ca.logic_and(stays, modes[k] != ties[k]))
        return found

    def _steady(self, here: list[Any], noise: Any) -> Any:
        """The noise of guards, where it is as large beside this point, within the errors of states.

        The slope of a logarithm or a quotient has no bound at the end of its domain: by it, a guard that is far from
        zero would be at zero within its error. See `acausal.simulate.events.guards.Guards.steady`.
        """
        events = self.compiled.state_events
        steep = [k for k, node in enumerate(events.relations) if node in events.written]
        if not steep:
            return noise
        t, x, *rest = here
        error = _STATE_ERROR * (ca.fabs(x) + ca.DM(self.compiled.nominal_x))
        beside = [self.rates(t, x + side * error, *rest)[1] for side in (-1, 1)]
        found = ca.SX(noise)
        for k in steep:
            found[k] = ca.fmin(noise[k], ca.fmax(beside[0][k], beside[1][k]))
        return found

    def rates(self, t: Any, x: Any, z: Any, u: Any, p: Any, m: Any) -> tuple[Any, Any]:
        """(Time derivatives of the guards along the solution, their errors due to rounding)."""
        nominal_x, nominal_z = ca.DM(self.compiled.nominal_x), ca.DM(self.compiled.nominal_z)
        errors = [_STATE_ERROR * (ca.fabs(v) + n) for v, n in ((x, nominal_x), (z, nominal_z))]
        rate, noise, by_z, alg, alg_z = self.compiled.events.rates(t, x, z, u, p, m, *errors)
        if z.numel():
            rate = rate - by_z @ ca.solve(ca.sparsify(alg_z), alg)
        return rate, ca.if_else(noise == 0, LEAST, noise)


def _places(part: slice) -> range:
    return range(part.start, part.stop)


def any_of(conditions: Iterable[Any]) -> Any:
    """Whether any of the conditions holds."""
    found: Any = ca.SX(0)
    for condition in conditions:
        found = ca.logic_or(found, condition)
    return found
