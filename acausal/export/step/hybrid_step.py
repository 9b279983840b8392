"""One step of a model with events as expressions, with bounded work whatever happens in it.

A step starts with its current modes. Relations that an input has changed flip at once. If relations are crossed, the
first crossing is located (nine steps of the regula falsi of N. Anderson and A. Bjorck, BIT 13 (1973) 253-264, for the
minimum of all guards on interpolated states), the event iteration runs there, and a second, shorter step leads to the
end. There the event iteration runs again, for time events, samples, and relations crossed after the first one. A single
event in a step therefore does not reduce the order (order two for implicit methods, which interpolate linearly). A
second one acts at the end of the step, an error of the order of the step, and a relation crossed twice within a step,
there and back, is missed. Both are detected and reported by a flag. It reports guards below zero at the end of the
second part, guards that fall at one end of a part and rise at the other with a negative minimum in between, guards that
are far from smooth between the ends of a part, and a crossing that the search has not confined to 1e-4 of the step.

Repeated impacts within a step end at rest, as in `acausal.simulate.events.rest`, even elastic ones: the state that the
`when` resets, and the states it drives, are projected onto the guard. A note says so. Both parts are computed in every
call, so that the computing time does not depend on events.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.start_point import StartPoint, start_point
from acausal.export.step.defect import largest
from acausal.export.step.event_step import Settling, any_of
from acausal.export.step.methods import IMPLICIT, Method
from acausal.export.step.timely import TICK, ticks, timely
from acausal.lower.build import Symbols
from acausal.lower.casadi_model import Port
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.functions import AT_REST
from acausal.simulate.driver.agenda import clocks, due, users
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Guards, Moment
from acausal.simulate.events.iteration import Iteration
from acausal.simulate.events.regime import Hold, Regime
from acausal.simulate.record.checks import WHOLE, integers
from acausal.simulate.solvers.segment import Tolerances

# The search for an event: number of evaluations; offset of the last but one from its secant towards the farther end, as
# a fraction of the bracket; offset of the last one beyond its secant; width of the bracket, as a fraction of the step,
# below which the event counts as located.
_EVALUATIONS, _OFFSET, _BEYOND, _LOCATED = 9, 1e-4, 1e-6, 1e-4
# Relative positions inside a part of a step at which guards are evaluated, and the relative deviation from the cubic
# between its ends beyond which a guard counts as oscillating within the part; and the largest distance of a guard from
# that cubic, in distances at these positions.
_INSIDE = (0.1813, 0.4377, 0.6481, 0.8342)
_JAGGED, _FARTHEST = 0.1, 1.2


@dataclass(frozen=True)
class _Impact:
    """A relation whose `when` resets a velocity, and a function that projects states onto its guard."""

    relation: int
    onto: Any
    """`(t, x, z, u, p, m) -> (states at the guard, states at rest on it)`."""


@dataclass(frozen=True, eq=False)
class HybridStep:
    """The step of `compiled` by `method`; `u` and `p` are the MX symbols of the step function."""

    compiled: CompiledModel
    method: Method
    u: Any
    p: Any
    h: float
    estimates: bool = False
    """Whether the error of a step is estimated; otherwise it is 0."""

    def __post_init__(self) -> None:
        p = np.array(self.compiled.parameter_values, dtype=float)
        for k, (_, interval) in enumerate(clocks(self.compiled, p)):
            if interval < self.h * (1 - TICK):
                raise _too_fast(self.compiled, k, interval, self.h)

    @cached_property
    def settling(self) -> Settling:
        """The event iteration."""
        return Settling(self.compiled, self.method)

    @property
    def kept(self) -> list[int]:
        """Indices of the modes that are part of x: values of `pre`, and relations of variables."""
        s = self.settling
        return [*range(s.memories.start, s.memories.stop), *range(s.relations.start, s.relations.stop)]

    def ports(self, m: Vector) -> list[Port]:
        """Ports of the modes in x, with their start values from `m`, shape (nm,)."""
        compiled, reduced = self.compiled, self.compiled.solution.structure.reduced
        node_of = dict(zip(compiled.mode_places, compiled.mode_nodes, strict=True))
        ports = []
        for j in self.kept:
            text = reduced.text(node_of[j])
            doc = "What is remembered of the last event" if j < self.settling.memories.stop else "1 where this holds"
            ports.append(Port(text, "", doc, float(m[j])))
        return ports

    def begin(self) -> StartPoint:
        """The start after its events."""
        begin = start_point(self.compiled)
        problem = Problem(self.compiled, begin.p, begin.u)
        _refuse_indeterminate_friction(self.compiled, begin)
        span = max(self.compiled.flat.experiment.stop_time - begin.t, self.h)
        iteration = Iteration(problem, Guards(problem, Tolerances(1e-10, factor=1.0), span))
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
        """All modes at the start of a step, from those in x (`kept`)."""
        return self._modes(t, kept, self.p)

    @cached_property
    def _modes(self) -> Any:
        t, kept, p = ca.SX.sym("t"), ca.SX.sym("kept", len(self.kept)), ca.SX.sym("p", self.p.numel())
        m = ca.SX(self.compiled.n_modes, 1)
        if self.compiled.n_timely:
            m[: self.compiled.n_timely] = self.timely(t, p)
        for k, j in enumerate(self.kept):
            m[j] = kept[k]
        return ca.Function("modes", [t, kept, p], [ca.densify(m)])

    @property
    def is_timed(self) -> bool:
        """Whether a step depends on its start time."""
        events = self.compiled.events
        outputs = [(self.compiled.rhs, 0), (self.compiled.rhs, 1), (events.watch, 0)]
        outputs += [(events.round, k) for k in range(events.round.n_out())]
        has_time_events = self.compiled.n_timely or self.compiled.state_events.samples
        return bool(has_time_events) or any(f.jac_sparsity(k, 0).nnz() for f, k in outputs)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the limits of steps of this length."""
        texts = self.compiled.events.texts
        return (
            f"the event iteration of a step makes at most {self.settling.passes} passes; step.unsettled in y is 1 if "
            "they did not suffice, or if two clauses set one variable to different values",
            *[
                f"a step of {self.h:g} s locates one event; step.unlocated in y is 1 if another relation changes after "
                "it, if one changes twice, or if its sides stay equal: choose a smaller step. Relations are evaluated "
                "at four points of a step, so a pulse such as exp(-(x/w)**2) > 0.5 shorter than a tenth of a step is "
                "missed"
            ][: len(self.compiled.state_events.relations)],
            *(
                f"repeated impacts of {texts[i.relation]} within a step of {self.h:g} s end at rest, elastic ones, too"
                for i in self._impacts
            ),
        )

    def step(self, t: Any, x: Any, z: Any, m: Any) -> tuple[Any, ...]:
        """(x, z, m, settled, located, rough, large, error) at the end of a step.

        `settled`: whether the event iterations have settled; `located`: whether all events are located; `rough`:
        whether a Newton iteration has not converged; `large`: whether the part of the step after its event is too large
        for an explicit method; `error`: the estimated error of both parts.

        An integer variable that gets a fractional value becomes nan.
        """
        held = [self.u, self.p]
        settled: Any = 1
        located: Any = 1
        large: Any = 0
        if self.compiled.state_events.relations:
            x1, z1, theta, at, xe, ze, flipped, marks, seen, rough, error = self._locate_first(t, x, z, *held, m)
            nothing = ca.MX(self.settling.samples.stop - self.settling.samples.start, 1)
            xe, ze, me, settled = self.settling.settled(at, xe, ze, *held, flipped, m, nothing, theta >= 1)
            rest = self._rest_of_step(t, x, z, *held, m, x1, z1, theta, at, xe, ze, me, marks)
            x, z, m_end, rest_seen, rest_rough, large, rest_error = rest
            located, rough = ca.logic_and(seen, rest_seen), ca.logic_or(rough, ca.logic_and(theta < 1, rest_rough))
            error = error + rest_error
        else:
            x, z, rough, error = self._whole(t, x, z, *held, m)
            m_end = m
        end = t + self.h
        due, late = self._ticks(end, self.p)
        for k in range(late.numel()):
            located = ca.logic_and(located, ca.logic_not(late[k]))
        x, z, m, end_settled = self.settling.settled(end, x, z, *held, self._at_end(end, m_end, self.p), m_end, due, 0)
        return self.whole_numbers(x), z, m, ca.logic_and(settled, end_settled), located, rough, large, error

    def whole_numbers(self, x: Any) -> Any:
        """The states x, with nan for integers whose values are fractional: a run would end there with AC147."""
        positions = integers(self.compiled)
        if not positions:
            return x
        symbol = ca.SX.sym("x", x.numel())
        result = ca.SX(symbol)
        for k in positions:
            is_fractional = ca.fabs(symbol[k] - ca.floor(symbol[k] + 0.5)) > WHOLE * ca.fmax(1, ca.fabs(symbol[k]))
            result[k] = ca.if_else(is_fractional, np.nan, symbol[k])
        return ca.Function("whole_numbers", [symbol], [result])(x)

    @cached_property
    def _whole(self) -> Any:
        """Function `(t, x, z, u, p, m) -> (x, z, rough, error)`: a step with constant modes."""
        s = Symbols(self.compiled)
        held = [s.u, s.p, s.m]
        x, z, rough = self.method.step(s.t, self.h, s.x, s.z, held)
        error = self._error(s.t, self.h, s.x, s.z, x, z, held)
        outputs: Any = ca.cse([ca.densify(v) for v in (x, z, rough, error)])
        return ca.Function("whole", s.inputs, outputs)

    def _error(self, *step: Any) -> Any:
        return self.method.error(*step) if self.estimates else ca.SX(0)

    def _fallen(self, t: Any, h: Any, x: Any, z: Any, rested: Any, held: Sequence[Any]) -> Any:
        """Error in other states because bodies at rest fall during a step and are projected back at its end."""
        return self.method.displaced(t, h, x, z, rested, held) if self.estimates and self._impacts else ca.SX(0)

    def _late(self, at: Any, width: Any, before: Any, x: Any, z: Any, held: Sequence[Any]) -> Any:
        """Error due to the uncertainty `width` of the position of an event: the change of rates times its duration."""
        if not self.estimates:
            return ca.SX(0)
        after = self.method.rates(at, x, self.method.algebraic(at, x, z, held), *held)[0]
        return self.h * width * largest(x.numel())((after - before) / ca.DM(self.compiled.nominal_x))

    @cached_property
    def _at_end(self) -> Any:
        """Function `(t, m, p) -> m` that updates relations of time to just after an instant."""
        t, p, m = ca.SX.sym("t"), ca.SX.sym("p", self.p.numel()), ca.SX.sym("m", self.compiled.n_modes)
        after = ca.SX(m)
        if self.compiled.n_timely:
            after[: self.compiled.n_timely] = self.timely(t, p)
        return ca.Function("at_end", [t, m, p], [after])

    @cached_property
    def _locate_first(self) -> Any:
        """Function `(t, x, z, u, p, m) -> (x1, z1, theta, at, xe, ze, flipped, marks, seen, rough, error)`.

        It locates the first relation that is crossed, at the relative position `theta` (1 if there is none) and the
        instant `at`. (x1, z1) are the values after the whole step, (xe, ze) those at the event, where `flipped` are the
        modes with the crossed relation flipped; `error` is that of the step up to `theta`. For each relation, `marks`
        contains whether it is the located one, whether it rests on its guard, whether it leaves it, its distance, and
        its rate, at the start of the step; then the uncertainty of `theta`, and the rates of the states at the event.
        `seen` is true if `theta` is certain, no relation was crossed there and back before, and the sides of the
        located one were not equal at an end.
        """
        s, settling, watch = Symbols(self.compiled), self.settling, self.compiled.events.watch
        t, x, z, u, p, m = s.inputs
        held = [u, p, m]
        x1, z1, rough = self.method.step(t, self.h, x, z, held)
        g0, g1 = watch(t, x, z, *held), watch(t + self.h, x1, z1, *held)
        whole = x1, z1
        # a body at rest that is pressed against its guard does not bounce again
        rate, noise = settling.rates(t, x, z, *held)
        impacts = {i.relation for i in self._impacts}
        touching = [ca.fabs(g0[k]) <= noise[k] if k in impacts else ca.SX(0) for k in range(g0.numel())]
        resting = [ca.logic_and(touches, rate[k] <= noise[k]) for k, touches in enumerate(touching)]
        launched = [ca.logic_and(touches, rate[k] > noise[k]) for k, touches in enumerate(touching)]
        # a changed input may have changed relations since the last step: they flip at its start
        begun = [ca.logic_and(g0[k] < -2 * noise[k], ca.logic_not(resting[k])) for k in range(g0.numel())]
        x1 = self._rested(t + self.h, x1, z1, held, resting)
        g1 = watch(t + self.h, x1, z1, *held)
        passed = [ca.logic_and(ca.logic_and(g0[k] > 0, g1[k] < 0), ca.logic_not(resting[k])) for k in range(g0.numel())]
        theta, chosen, width = self._crossing(s, x1, z1, g0, g1, passed)
        at_once = any_of(begun)
        theta = ca.if_else(at_once, 0, theta)
        chosen = [ca.if_else(at_once, begun[k], is_crossed) for k, is_crossed in enumerate(chosen)]
        unseen = any_of(
            ca.logic_and(g1[k] < 0, ca.logic_not(any_of((passed[k], resting[k])))) for k in range(len(chosen))
        )
        unseen = ca.logic_and(theta >= 1, unseen)
        at = t + theta * self.h
        xe, ze = self._between(t, x, z, x1, z1, held, theta)
        xe = self._rested(at, xe, ze, held, resting)
        flipped = ca.SX(m)
        for k, j in enumerate(range(settling.relations.start, settling.relations.stop)):
            flipped[j] = ca.if_else(chosen[k], 1 - m[j], m[j])
        marks = ca.vertcat(*chosen, *resting, *launched, g0, rate)
        jumps = (ca.logic_and(chosen[k], _rests(g0[k], g1[k])) for k in sorted(self.compiled.state_events.resting))
        missed = any_of((self._dips(t, self.h, x, z, x1, z1, held, theta), unseen, *jumps))
        seen = ca.logic_and(width < _LOCATED, ca.logic_not(missed))
        error = self._error(t, self.h, x, z, *whole, held, theta)
        error = error + self._fallen(t + self.h, theta * self.h, *whole, x1, held)
        marks = ca.vertcat(marks, width, self.method.rates(at, xe, ze, *held)[0])
        results = [ca.densify(v) for v in (x1, z1, theta, at, xe, ze, flipped, marks, seen, rough, error)]
        outputs: list[Any] = ca.cse(results)
        return ca.Function("reached", s.inputs, outputs)

    @cached_property
    def _rest_of_step(self) -> Any:
        """The part of the step after its event: `(t, x, z, u, p, m, *after) -> (x, z, m, seen, rough, large, error)`.

        `after` are the first six results of `_locate_first`, with (xe, ze) after the event iteration, the modes there,
        and `marks`.
        """
        s, settling, watch = Symbols(self.compiled), self.settling, self.compiled.events.watch
        t, x, z, u, p, m = s.inputs
        held = [u, p, m]
        count = len(self.compiled.state_events.relations)
        like = [x, z, ca.SX(1, 1), ca.SX(1, 1), x, z, m, ca.SX(5 * count + 1 + x.numel(), 1)]
        given = [ca.SX.sym(f"a{k}", v.numel()) for k, v in enumerate(like)]
        x1, z1, theta, at, xe, ze, me, marks = given
        offsets = [*(count * k for k in range(6)), 5 * count + 1, marks.numel()]
        chosen, resting, launched, g0, rate, width, rates = ca.vertsplit(marks, offsets)
        rest = ca.fmax(1 - theta, TICK) * self.h  # never zero: implicit methods divide by it
        x2, z2, rough = self.method.step(at, rest, xe, ze, [u, p, me])
        large = ca.logic_and(theta < 1, self.method.too_large(at, rest, xe, ze, [u, p, me]))
        error = self._error(at, rest, xe, ze, x2, z2, [u, p, me]) + self._late(at, width, rates, xe, ze, [u, p, me])
        away = settling.rates(at, xe, ze, *held)[0]
        negative = watch(t + self.h, x2, z2, u, p, me) < 0
        passed = any_of(ca.logic_and(negative[k], ca.logic_not(resting[k])) for k in range(count))
        passed = ca.logic_or(passed, self._dips(at, rest, xe, ze, x2, z2, [u, p, me], 1))
        missed = ca.logic_and(theta < 1, passed)
        x, z, new = (ca.if_else(theta < 1, a, b) for a, b in ((x2, x1), (z2, z1), (me, m)))
        new = ca.SX(new)
        for impact in self._impacts:
            k = impact.relation
            g = watch(t + self.h, x, z, *held)[k]
            fired = ca.logic_and(chosen[k], away[k] >= -1e-6 * ca.fabs(rate[k]))
            rests = ca.logic_and(any_of((resting[k], launched[k], fired)), g < 0)
            onto, still = impact.onto(t + self.h, x, z, *held)
            # the second impact of a step acts at its end: project the state back onto the guard first
            second = ca.logic_and(ca.logic_and(g0[k] > 0, g < 0), ca.logic_not(chosen[k]))
            missed = any_of((missed, second, ca.logic_and(rests, ca.logic_not(resting[k]))))
            x = ca.if_else(rests, still, ca.if_else(second, onto, x))
            j = settling.relations.start + k
            new[j] = ca.if_else(rests, m[j], new[j])
        error = ca.if_else(theta < 1, error + self._fallen(t + self.h, rest, x2, z2, x, [u, p, me]), 0)
        results = [ca.densify(v) for v in (x, z, new, ca.logic_not(missed), rough, large, error)]
        return ca.Function("rest_of_step", [*s.inputs, *given], ca.cse(results))

    def _rested(self, t: Any, x: Any, z: Any, held: Sequence[Any], resting: Sequence[Any]) -> Any:
        """States x with bodies at rest projected back onto their guards, because a step without contact lets them fall.

        Otherwise any other event of the step would find them below their guards, and their `when`s would act again.
        """
        for impact in self._impacts:
            k = impact.relation
            g, noise = self.compiled.events.watch(t, x, z, *held)[k], self.settling.rates(t, x, z, *held)[1][k]
            x = ca.if_else(ca.logic_and(resting[k], g <= noise), impact.onto(t, x, z, *held)[1], x)
        return x

    def _dips(self, t: Any, h: Any, x: Any, z: Any, x1: Any, z1: Any, held: Sequence[Any], share: Any) -> Any:
        """Whether a guard that is positive at both ends of a part may be crossed twice in the first `share` of it.

        As in `native/bracketing.c`, without its integrated points: the cubic through both ends is evaluated
        where it is lowest, and the guard itself where the tangents at both ends intersect, the position of a kink. A
        guard that oscillates within the step is not a cubic: it is evaluated at inner points, and may be crossed if it
        deviates from the cubic by more than its value and a tenth of its magnitude, or is below the cubic by more than
        the lowest value of the latter.
        """
        watch, rates = self.compiled.events.watch, self.settling.rates
        g0, g1 = watch(t, x, z, *held), watch(t + h, x1, z1, *held)
        (rate0, noise), rate1 = rates(t, x, z, *held), rates(t + h, x1, z1, *held)[0]
        found, turns = [], []
        for k in range(g0.numel()):
            a, b = h * rate0[k], h * rate1[k]
            has_minimum = ca.logic_and(ca.logic_and(a < 0, b > 0), ca.logic_and(g0[k] > noise[k], g1[k] >= 0))
            rise, fall = g1[k] - g0[k], ca.if_else(has_minimum, a - b, 1)
            meet, square, cube = (rise - b) / fall, 3 * rise - 2 * a - b, a + b - 2 * rise
            low = -a / ca.if_else(has_minimum, square + ca.sqrt(ca.fmax(square**2 - 3 * cube * a, 0)), 1)
            cubic = g0[k] + low * (a + low * (square + low * cube))
            there = watch(t + meet * h, *self._interpolate(t, h, x, z, x1, z1, held, meet), *held)[k]
            found.append(ca.logic_and(has_minimum, ca.logic_and(meet <= share, there < 0)))
            turns.append((ca.logic_and(has_minimum, low <= share), cubic))
        error: list[Any] = [0] * g0.numel()
        for position in _INSIDE:
            s = share * position
            inside = watch(t + s * h, *self._interpolate(t, h, x, z, x1, z1, held, s), *held)
            for k in range(g0.numel()):
                rise, a, b = g1[k] - g0[k], h * rate0[k], h * rate1[k]
                smooth = g0[k] + s * (a + s * (3 * rise - 2 * a - b + s * (a + b - 2 * rise)))
                deviation, least = ca.fabs(inside[k] - smooth), ca.fmin(ca.fmin(g0[k], g1[k]), inside[k])
                error[k] = ca.fmax(error[k], smooth - inside[k])
                if self.method.name in IMPLICIT:  # rates at the ends may be those of fast transients
                    deviation = ca.fmin(deviation, ca.fabs(inside[k] - g0[k] - s * rise))
                size = ca.fmax(g0[k], g1[k])
                outside = ca.logic_and(g0[k] > noise[k], g1[k] >= 0)
                jagged = ca.logic_and(deviation > least, deviation > _JAGGED * size)
                found.append(ca.logic_and(outside, ca.logic_or(inside[k] < -noise[k], jagged)))
        found += [ca.logic_and(turns[k][0], turns[k][1] < _FARTHEST * error[k]) for k in range(len(turns))]
        return any_of(found)

    def _crossing(self, s: Symbols, x1: Any, z1: Any, g0: Any, g1: Any, passed: Sequence[Any]) -> tuple[Any, Any, Any]:
        """(Relative position of the first crossing, 1 if none; mask of the guards crossed there; its uncertainty).

        The position is the root of the minimum of all crossed guards, each relative to its value at the start, because
        the guard whose secant is zero first need not be crossed first. The retained end of the bracket is scaled down
        only when it is retained again, and the last points are offset from their secants, so that both ends of the
        bracket are near the root.
        """
        if not passed:
            return ca.SX(1), [], ca.SX(0)
        share, xb, zb = ca.SX.sym("share"), ca.SX.sym("x1", x1.numel()), ca.SX.sym("z1", z1.numel())
        held = [s.u, s.p, s.m]
        between = self._between(s.t, s.x, s.z, xb, zb, held, share)
        g = self.compiled.events.watch(s.t + share * self.h, *between, *held)
        here = ca.Function("here", [share, *s.inputs, xb, zb], [ca.densify(g)])
        is_any = any_of(passed)

        def least(values: Any) -> Any:
            found: Any = ca.SX(1)
            for k, is_passed in enumerate(passed):
                found = ca.fmin(found, ca.if_else(is_passed, values[k] / ca.if_else(is_passed, g0[k], 1), 1))
            return found

        a, b, fa, fb, at_b, side = ca.SX(0), ca.SX(1), ca.SX(1), least(g1), g1, ca.SX(0)
        for k in range(_EVALUATIONS):
            c = (a * fb - b * fa) / ca.if_else(is_any, fb - fa, 1)
            if k == _EVALUATIONS - 2:
                c = c + _OFFSET * (b - a) * ca.if_else(c - a < b - c, 1, -1)
            elif k == _EVALUATIONS - 1:
                c = ca.fmin(b, c + _BEYOND * (b - a))
            at_c = here(c, *s.inputs, x1, z1)
            fc = least(at_c)
            before = fc > 0
            less_b = ca.if_else(side > 0, fb * _weight(fc / fa), fb)
            less_a = ca.if_else(side < 0, fa * _weight(fc / ca.if_else(fb == 0, 1, fb)), fa)
            fa, fb = ca.if_else(before, fc, less_a), ca.if_else(before, less_b, fc)
            at_b, side = ca.if_else(before, at_b, at_c), ca.if_else(before, 1, -1)
            a, b = ca.if_else(before, c, a), ca.if_else(before, b, c)
        chosen = [ca.logic_and(is_passed, at_b[k] <= 0) for k, is_passed in enumerate(passed)]
        # use the end of the bracket at which the relation has changed: at the other end it would change back
        theta = ca.if_else(ca.logic_and(is_any, b < 1 - TICK), b, 1)  # rounding would order it and a tick at the end
        return theta, chosen, ca.if_else(is_any, b - a, 0)

    def _between(self, t: Any, x: Any, z: Any, x1: Any, z1: Any, held: Sequence[Any], share: Any) -> tuple[Any, Any]:
        """(x, z) at the fraction `share` of a step, interpolated in x by a cubic.

        For implicit methods, whose rates may be those of fast transients, the interpolation is linear. Algebraic
        variables are solved for, because at an instant located on their linear interpolation the relation need not have
        changed.
        """
        x_between, w = self._interpolate(t, self.h, x, z, x1, z1, held, share)
        return x_between, self.method.algebraic(t + share * self.h, x_between, w, held)

    def _interpolate(
        self, t: Any, h: Any, x: Any, z: Any, x1: Any, z1: Any, held: Sequence[Any], share: Any
    ) -> tuple[Any, Any]:
        """As `_between`, with algebraic variables interpolated linearly."""
        x_between, w = x + share * (x1 - x), z + share * (z1 - z)
        if self.method.name not in IMPLICIT:
            f0 = self.method.rates(t, x, z, *held)[0]
            f1 = self.method.rates(t + h, x1, z1, *held)[0]
            bend = (1 - 2 * share) * (x1 - x) + (share - 1) * h * f0 + share * h * f1
            x_between = x_between + share * (share - 1) * bend
        return x_between, w

    @cached_property
    def _ticks(self) -> Any:
        return ticks(self.compiled, self.h)

    @cached_property
    def _impacts(self) -> list[_Impact]:
        """Relations that are the only condition of a `when` with a reset, and allow rest on their guard."""
        compiled = self.compiled
        begin = start_point(compiled)
        problem = Problem(compiled, begin.p, begin.u)
        relations = compiled.state_events.relations
        m = np.zeros(compiled.n_modes)
        found: dict[int, _Impact] = {}
        for clause in compiled.state_events.clauses:
            if len(clause.conditions) != 1 or clause.conditions[0] not in relations:
                continue
            k = relations.index(clause.conditions[0])
            for target, _ in clause.actions:
                if k in found or target >= compiled.n_dynamic:
                    continue
                regime = Regime(problem, (Hold(k, target),))
                if regime.active_set.is_possible and regime.is_solvable(begin.t, begin.x, begin.z, m):
                    found[k] = _Impact(k, _projection(compiled, k, target))
        return list(found.values())


def _rests(*distances: Any) -> Any:
    """Whether the sides of a relation are equal (its distance is `AT_REST`) at any of these points."""
    return any_of(ca.fabs(g) == AT_REST for g in distances)


def _weight(ratio: Any) -> Any:
    return ca.if_else(ratio < 1, 1 - ratio, 0.5)


def _projection(compiled: CompiledModel, relation: int, target: int) -> Any:
    """Function `(t, x, z, u, p, m) -> (onto, still)` that projects states onto the guard of a relation.

    `onto` moves the states that the reset one (`target`) drives, `still` also the reset one, so that the guard is at
    rest.
    """
    s = Symbols(compiled)
    ode = compiled.rhs(*s.inputs)[0]
    distance = compiled.events.distances(*s.inputs)[relation]
    approach = ca.jtimes(distance, ca.vertcat(s.t, s.x), ca.vertcat(1, ode))
    driven = ca.densify(ca.jacobian(ode, s.x[target]))
    unit = ca.SX.zeros(s.x.numel(), 1)
    unit[target] = 1
    slope = ca.jacobian(ca.vertcat(distance, approach), s.x)
    directions = ca.horzcat(driven, unit)
    still = s.x - directions @ ca.solve(ca.densify(slope @ directions), ca.vertcat(distance, approach))
    onto = s.x - driven * (distance / ca.densify(slope[0, :] @ driven))
    return ca.Function("onto", s.inputs, [ca.densify(onto), ca.densify(still)])


def _refuse_indeterminate_friction(compiled: CompiledModel, begin: StartPoint) -> None:
    """Refuse models with more friction elements than motions that these can stop.

    A step has one set of equations for all modes, which is checked with all elements stuck. Raises ExportError: AC610.
    """
    shares = functions_of(compiled).shares
    if shares is None:
        return
    reduced = compiled.solution.structure.reduced
    x = begin.x.copy()
    declared = [reduced.flat.declaration(reduced.scalar[v]) for v in compiled.state_variables]
    x[[d.boolean for d in declared]] = 1.0
    at = begin.t, x, begin.z, begin.u, begin.p, begin.m
    if shares.border(compiled, *at) is not None:
        names = " and ".join(shares.open(*at))
        raise ExportError(
            "AC610",
            f"a step does not take {compiled.name}: nothing determines how {names} share their load when stuck",
            cause="there are more friction elements than motions that they can stop",
            help="replace those that act on one motion by one element with the sum of their limits",
        )


def _too_fast(compiled: CompiledModel, sample: int, interval: float, step: float) -> ExportError:
    acting = users(compiled, compiled.state_events.samples[sample])
    return ExportError(
        "AC605",
        f"a clock of {compiled.name} ticks every {interval:g} s, more than once in a step of {step:g} s",
        where=tuple(c.where for c in acting[:1]),
        evidence=[c.text for c in acting[:3]],
        help=f"take a step of {interval:g} s or a fraction of it",
    )
