"""One step of a model with events as expressions: bounded work, whatever happens in it.

A step goes on with the modes it begins with. Where a relation is passed, the first such instant is located (six steps
of the false position of N. Anderson and A. Bjorck, BIT 13 (1973) 253-264, on the interpolated states), the event
iteration runs there, and a second, shorter step goes on to the end. There the event iteration runs once more, for time
events, samples, and relations that were passed after the first. So an event costs no order where it is the only one in
its step (order two with implicit methods, between whose steps states are interpolated by straight lines); a second one
is taken at the end of the step, an error of the length of the step. A relation that is passed twice within a step,
there and back, is not seen.

Impacts that follow one another within a step end at rest, as in `acausal.simulate.rest`: the state that the `when`
resets, and what it drives, are put on the guard. Both parts are computed in every call; that is the price of a time
that does not depend on what happens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import ExportError
from acausal.export.casadi_model import Port
from acausal.export.event_step import Settling
from acausal.export.functions import Begin, begin_of
from acausal.export.methods import IMPLICIT, Method
from acausal.lower.compiled import CompiledModel, Symbols
from acausal.lower.text import to_text
from acausal.simulate.guards import Guards, Moment, Tolerances
from acausal.simulate.iteration import Iteration
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Hold, Regime
from acausal.simulate.sampling import clocks, due, users

Vector = NDArray[np.float64]
_LOCATING = 6
# A clock counts as ticking at an instant to this share of its interval, and of the step.
TICK = 1e-9


def has_memory(compiled: CompiledModel) -> bool:
    """Whether a model keeps more from event to event than its equations at a point say."""
    events = compiled.state_events
    return bool(events.clauses or events.assignments or events.samples or events.memories or events.flags)


@dataclass(frozen=True)
class _Impact:
    """A relation whose `when` resets a velocity, and the symbols' functions that put states onto its guard."""

    relation: int
    onto: Any
    """`(t, x, z, u, p, m) -> (states at the guard, states at rest on it)`."""


@dataclass(frozen=True, eq=False)
class HybridStep:
    """The step of `compiled` by `method`; symbols `u` and `p` are those of the step function."""

    compiled: CompiledModel
    method: Method
    u: Any
    p: Any
    h: float

    def __post_init__(self) -> None:
        p = np.array(self.compiled.parameter_values, dtype=float)
        for k, (_, interval) in enumerate(clocks(self.compiled, p)):
            if interval < self.h * (1 - TICK):
                raise _too_fast(self.compiled, k, interval, self.h)

    @property
    def settling(self) -> Settling:
        """The event iteration."""
        return Settling(self.compiled, self.method, self.u, self.p)

    @property
    def kept(self) -> list[int]:
        """Places of the modes that are part of x: what `pre` remembers, and relations of variables."""
        s = self.settling
        return [*range(s.memories.start, s.memories.stop), *range(s.relations.start, s.relations.stop)]

    def ports(self, m: Vector) -> list[Port]:
        """Descriptions of the modes in x, with their values at the start."""
        compiled, reduced = self.compiled, self.compiled.solution.structure.reduced
        place = dict(zip(compiled.mode_places, compiled.mode_nodes, strict=True))

        def name_of(kind: str, k: int) -> str:
            return reduced.name(k) if kind == "var" else compiled.parameters[k]

        found = []
        for j in self.kept:
            text = to_text(reduced.pool, place[j], name_of, 80)
            doc = "What is remembered of the last event" if j < self.settling.memories.stop else "1 where this holds"
            found.append(Port(text, "", doc, float(m[j])))
        return found

    def begin(self) -> Begin:
        """The start after its events."""
        begin = begin_of(self.compiled)
        problem = Problem(self.compiled, begin.p, begin.u)
        span = max(self.compiled.flat.experiment.stop_time - begin.t, self.h)
        iteration = Iteration(problem, Guards(problem, Tolerances(1e-10, 1e-10), span))
        m = begin.m.copy()
        m[: self.compiled.n_timely] = np.array(self.timely(begin.t, begin.p)).ravel()
        moment = iteration.settle(begin.t, Moment(begin.x, begin.z, m, Regime(problem)), m, flag="initial").moment
        ticks = due(self.compiled, begin.p, np.array([begin.t]))[0]
        if ticks.any():
            moment = iteration.settle(begin.t, moment, moment.m, samples=ticks).moment
        return replace(begin, x=moment.x, z=moment.z, m=moment.m)

    def timely(self, t: Any, p: Any) -> Any:
        """Relations of time just after an instant."""
        return timely(self.compiled, t, self.h, p)

    def modes(self, t: Any, kept: Any) -> Any:
        """All modes from those in x, at the start of a step."""
        m = ca.SX(self.compiled.n_modes, 1)
        if self.compiled.n_timely:
            m[: self.compiled.n_timely] = self.timely(t, self.p)
        for k, j in enumerate(self.kept):
            m[j] = kept[k]
        return ca.densify(m)

    def step(self, t: Any, x: Any, z: Any, m: Any) -> tuple[Any, Any, Any]:
        """States, algebraic variables and modes at the end of a step."""
        settling = self.settling
        if self.compiled.state_events.relations:
            x, z, m = self._passed(t, x, z, m)
        else:
            x, z = self.method.step(t, self.h, x, z, [self.u, self.p, m])
        end = t + self.h
        after = ca.SX(m)
        if self.compiled.n_timely:
            after[: self.compiled.n_timely] = self.timely(end, self.p)
        return settling.settled(end, x, z, after, m, self._due(end))

    def _passed(self, t: Any, x: Any, z: Any, m: Any) -> tuple[Any, Any, Any]:
        """The end of a step before its own event, the first relation that was passed being done."""
        settling, watch = self.settling, self.compiled.events.watch
        held = [self.u, self.p, m]
        x1, z1 = self.method.step(t, self.h, x, z, held)
        g0, g1 = watch(t, x, z, *held), watch(t + self.h, x1, z1, *held)
        impacts = self._impacts()
        # what lies on its guard and is drawn into it does not bounce again
        rate, noise = settling.rates(t, x, z, *held)
        resting = {
            i.relation: ca.logic_and(
                ca.fabs(g0[i.relation]) <= noise[i.relation], rate[i.relation] <= noise[i.relation]
            )
            for i in impacts
        }
        passed = [ca.logic_and(g0[k] > 0, g1[k] < 0) for k in range(g0.numel())]
        for k, rests in resting.items():
            passed[k] = ca.logic_and(passed[k], ca.logic_not(rests))
        theta, chosen = self._located(t, x, z, x1, z1, m, g0, g1, passed)
        found = theta < 1
        at = t + theta * self.h
        xe, ze = self._between(t, x, z, x1, z1, m, theta)
        flipped = ca.SX(m)
        for k, j in enumerate(range(settling.relations.start, settling.relations.stop)):
            flipped[j] = ca.if_else(chosen[k], 1 - m[j], m[j])
        xe, ze, me = settling.settled(at, xe, ze, flipped, m, 0)
        rest = ca.fmax(1 - theta, TICK) * self.h  # never zero: implicit methods divide by it
        x2, z2 = self.method.step(at, rest, xe, ze, [self.u, self.p, me])
        away = watch(at, xe, ze, *held), settling.rates(at, xe, ze, *held)[0]
        x, z, new = (ca.if_else(found, a, b) for a, b in ((x2, x1), (z2, z1), (me, m)))
        for impact in impacts:
            k = impact.relation
            g = watch(t + self.h, x, z, *held)[k]
            fired = ca.logic_and(chosen[k], away[1][k] >= -1e-6 * ca.fabs(rate[k]))
            rests = ca.logic_and(ca.logic_or(resting[k], fired), g < 0)
            onto, still = impact.onto(t + self.h, x, z, *held)
            # one that comes second in its step is put back onto its guard before it bounces
            second = ca.logic_and(ca.logic_and(g0[k] > 0, g < 0), ca.logic_not(chosen[k]))
            x = ca.if_else(rests, still, ca.if_else(second, onto, x))
            j = settling.relations.start + k
            new[j] = ca.if_else(rests, m[j], new[j])
        return x, z, new

    def _located(
        self, t: Any, x: Any, z: Any, x1: Any, z1: Any, m: Any, g0: Any, g1: Any, passed: Sequence[Any]
    ) -> tuple[Any, list[Any]]:
        """The share of the step at which the first of the passed guards is reached, 1 if none; and which it is."""
        first: Any = ca.SX(1)
        secants = [ca.if_else(passed[k], g0[k] / (g0[k] - g1[k]), 2) for k in range(g0.numel())]
        for secant in secants:
            first = ca.fmin(first, secant)
        chosen = [ca.logic_and(passed[k], secants[k] <= first) for k in range(g0.numel())]
        share = ca.SX.sym("share")
        given = [t, x, z, x1, z1, m, ca.vertcat(*chosen)]
        at = [ca.SX.sym(f"a{k}", v.numel()) for k, v in enumerate(given)]
        between = self._between(at[0], at[1], at[2], at[3], at[4], at[5], share)
        g = self.compiled.events.watch(at[0] + share * self.h, *between, self.u, self.p, at[5])
        here = ca.Function("here", [share, *at, self.u, self.p], [ca.dot(g, at[6])])
        given += [self.u, self.p]
        a, b = ca.SX(0), ca.SX(1)
        fa, fb = (ca.dot(v, given[6]) for v in (g0, g1))
        for _ in range(_LOCATING):
            c = (a * fb - b * fa) / ca.if_else(fb == fa, 1, fb - fa)
            fc = here(c, *given)
            before = fc > 0
            less_b, less_a = (f * _weight(fc / ca.if_else(o == 0, 1, o)) for f, o in ((fb, fa), (fa, fb)))
            fa, fb = ca.if_else(before, fc, less_a), ca.if_else(before, less_b, fc)
            a, b = ca.if_else(before, c, a), ca.if_else(before, b, c)
        # the side on which the relation has changed: on the other it would change back at once
        return ca.if_else(first < 1, ca.fmin(b, 1 - TICK), 1), chosen

    def _between(self, t: Any, x: Any, z: Any, x1: Any, z1: Any, m: Any, share: Any) -> tuple[Any, Any]:
        """States within a step: cubic, or straight where rates at its ends may belong to what dies out at once."""
        w = z + share * (z1 - z)
        straight = x + share * (x1 - x)
        if self.method.name in IMPLICIT:
            return straight, w
        f0 = self.method.rates(t, x, z, self.u, self.p, m)[0]
        f1 = self.method.rates(t + self.h, x1, z1, self.u, self.p, m)[0]
        bend = (1 - 2 * share) * (x1 - x) + (share - 1) * self.h * f0 + share * self.h * f1
        return straight + share * (share - 1) * bend, w

    def _due(self, t: Any) -> Any:
        """Which samples are true: those whose clock has ticked within the step that ends here."""
        compiled = self.compiled
        events = compiled.state_events
        if not events.samples:
            return 0
        pool, s = compiled.solution.structure.reduced.pool, Symbols(compiled)
        builder = s.builder(compiled)
        found = []
        for number in events.samples:
            _, a, b = pool.nodes[number]
            first, interval = builder.lower([a, b])
            clock = ca.Function("clock", [s.p], [first, interval])(self.p)
            turns = [ca.floor((at - clock[0]) / clock[1] + TICK) for at in (t - self.h, t)]
            found.append(ca.logic_and(turns[1] > turns[0], turns[1] >= 0))
        return ca.vertcat(*found)

    def _impacts(self) -> list[_Impact]:
        """Relations that alone make a `when` act which resets a state, where rest on the guard is possible."""
        compiled = self.compiled
        begin = begin_of(compiled)
        problem = Problem(compiled, begin.p, begin.u)
        relations = compiled.state_events.relations
        m = np.zeros(compiled.n_modes)
        found: dict[int, _Impact] = {}
        for clause in compiled.state_events.clauses:
            if clause.condition not in relations:
                continue
            k = relations.index(clause.condition)
            for target, _ in clause.actions:
                if k in found or target >= compiled.n_dynamic:
                    continue
                regime = Regime(problem, (Hold(k, target),))
                if regime.is_possible and regime.is_solvable(begin.t, begin.x, begin.z, m):
                    found[k] = _Impact(k, _onto(compiled, k, target))
        return list(found.values())


def timely(compiled: CompiledModel, t: Any, h: float, p: Any) -> Any:
    """Relations of time just after an instant of a grid of steps `h`."""
    found = compiled.modes(t + TICK * h, p)
    return ca.vertsplit(found, [0, compiled.n_timely, found.numel()])[0]


def _weight(ratio: Any) -> Any:
    return ca.if_else(ratio < 1, 1 - ratio, 0.5)


def _onto(compiled: CompiledModel, relation: int, target: int) -> Any:
    """States moved onto a guard: along what the reset state drives, and with that state so that nothing approaches."""
    s = Symbols(compiled)
    ode = compiled.rhs(*s.inputs)[0]
    distance = compiled.events.distances(*s.inputs)[relation]
    approach = ca.jtimes(distance, ca.vertcat(s.t, s.x), ca.vertcat(1, ode))
    driven = ca.densify(ca.jacobian(ode, s.x[target]))
    own = ca.SX.zeros(s.x.numel(), 1)
    own[target] = 1
    slope = ca.jacobian(ca.vertcat(distance, approach), s.x)
    ways = ca.horzcat(driven, own)
    still = s.x - ways @ ca.solve(ca.densify(slope @ ways), ca.vertcat(distance, approach))
    onto = s.x - driven * (distance / ca.densify(slope[0, :] @ driven))
    return ca.Function("onto", s.inputs, [ca.densify(onto), ca.densify(still)])


def _too_fast(compiled: CompiledModel, sample: int, interval: float, step: float) -> ExportError:
    acting = users(compiled, compiled.state_events.samples[sample])
    return ExportError(
        "AC605",
        f"a clock of {compiled.name} ticks every {interval:g} s, more than once in a step of {step:g} s",
        where=tuple(c.where for c in acting[:1]),
        evidence=[c.text for c in acting[:3]],
        help=f"take a step of {interval:g} s or a fraction of it",
    )
