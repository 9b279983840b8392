"""Linear map over one event of a run, and derivatives of its instant by parameters.

At an event at t* with guard g, dt* = -(g_x X + g_p) / (g_t + g_x f), and the variations of the states jump: with
x+ = r(t, x-, p), X+ = r_x (X- + f- dt*) + r_t dt* + r_p - f+ dt* (saltation matrix). Instants of time events and
samples move with the parameters that they depend on.

Source: W. S. Galán, P. I. Barton, W. F. Feehery, Parametric sensitivity functions for hybrid discrete/continuous
systems, Applied Numerical Mathematics 31 (1999).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple, NoReturn

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.sensitivity.meeting import Group, are_equal, composed, groups, in_turn, orders
from acausal.export.sensitivity.slopes import Matrices, Slopes
from acausal.lower.build import Builder, Symbols
from acausal.lower.events.impulses import impulses
from acausal.simulate.driver.agenda import due
from acausal.simulate.driver.hybrid import Hybrid, Passage
from acausal.simulate.events.guards import same_instant
from acausal.simulate.events.regime import Regime

# Step, relative to the run and to the time scale of the states, of the difference quotient for the second derivative of
# a guard, taken backwards in time.
_BACK = 1e-6


class EventMap(NamedTuple):
    """The map over one event: derivatives of the carried variables x after it at a fixed time, and of its instant.

    Shapes: `by_x` (size, size), `by_p` (size, count), `time_x` (size,), `time_p` (count,). Of further events at the
    same instant, `apart_x` and `apart_p` are the derivatives of their delays, shapes (events, size), (events, count);
    where these are not zero, the map holds if it is `separable`.
    """

    by_x: Vector
    by_p: Vector
    time_x: Vector
    time_p: Vector
    apart_x: Vector
    apart_p: Vector
    separable: bool


class Saltation:
    """The maps over the events of one run, from `start` [s] for `duration` [s]."""

    def __init__(self, slopes: Slopes, hybrid: Hybrid, start: float, duration: float) -> None:
        self.slopes, self.hybrid, self.start, self.duration = slopes, hybrid, start, duration
        self.compiled, self.p, self.u = slopes.compiled, slopes.p, slopes.u
        self.nx, self.count, self.chosen, self.size = slopes.nx, slopes.count, slopes.chosen, slopes.size

    def __call__(self, passage: Passage) -> EventMap:
        """The map over one event, or over several that happen at one instant. Raises ExportError: AC608, AC615."""
        met = groups(self.hybrid, passage, self._instant)
        if len(met) < 2:
            return EventMap(*self._alone(passage), np.zeros((0, self.size)), np.zeros((0, self.count)), True)
        apart_x, apart_p = (np.array([group.instant[k] - met[0].instant[k] for group in met[1:]]) for k in (0, 1))
        separable = self._in_any_order(passage, met)
        if separable is not None:
            return EventMap(*separable, *met[0].instant, apart_x, apart_p, True)
        return EventMap(*self._alone(passage), apart_x, apart_p, False)

    def _in_any_order(self, passage: Passage, met: list[Group]) -> tuple[Vector, Vector] | None:
        """(dx+/dx-, dx+/dp) of events one after the other, if it is the same in every order."""
        common: tuple[Vector, Vector] | None = None
        for order in orders(met) if passage.happened.terminated is None else ():
            turns = in_turn(self.hybrid, passage, order)
            if turns is None:
                return None
            found = composed([self._alone(turn) for turn in turns])
            if common is not None and not are_equal(common, found):
                return None
            common = found
        return common

    def refuse_apart(self, passage: Passage, parameter: str) -> NoReturn:
        """Raise ExportError AC615 for events at one instant that this parameter moves apart."""
        met = groups(self.hybrid, passage, self._instant)
        causes = [self.hybrid.guards.causes[group.guards[0][0]] for group in met if group.guards]
        texts = [*(["a known instant"] if len(causes) < len(met) else []), *(cause.text for cause in causes)]
        raise ExportError(
            "AC615",
            f"sensitivities do not take {self.compiled.name}: at t = {passage.time:.9g} s events meet that {parameter} "
            "moves apart",
            where=tuple(cause.where for cause in causes if cause.where is not None),
            evidence=texts,
            cause="which of them comes first then depends on the sign of the change, and so does what follows",
            help="choose values with which they do not meet, or only parameters that move all of these instants alike",
        )

    def _alone(self, passage: Passage) -> tuple[Vector, Vector, Vector, Vector]:
        """(dx+/dx-, dx+/dp, dt*/dx-, dt*/dp) of one event, as in `EventMap`."""
        left, right, t = passage.left, passage.happened.moment, passage.time
        time_x, time_p = self._instant(passage)
        f_left, f_right = (
            np.concatenate([self.slopes.rate(at.regime, t, at), np.zeros(self.size - self.nx)]) for at in (left, right)
        )
        # columns: derivatives by the carried variables before, the parameters, and the time
        x, past = np.vsplit(np.eye(self.size, self.size + self.count + 1), [self.nx])
        past = self._after(left.regime, 4, None, t, left, x, past)
        past[:, -1] = 0.0  # values of `pre` are constant until the event
        for jump in passage.happened.jumps:
            moment = jump.moment
            x = self._set(self._assigned, self._after(moment.regime, 1, None, t, moment, x, past), x)
            acting = np.flatnonzero(jump.applied).tolist()
            impulsive = [k for k in acting if k in self._impulses]
            ordinary = [k for k in acting if k not in self._impulses]
            positions = [self._positions[k] for k in ordinary]
            values = self._after(moment.regime, 3, ordinary, t, moment, x, past)
            struck = self._struck(moment, impulsive, positions, t, x, past)
            x = self._set(positions, values, x) + struck
            if jump.advances:
                past = self._after(moment.regime, 4, None, t, moment, x, past)
        x = self._set(self._assigned, self._after(right.regime, 1, None, t, right, x, past), x)
        x = np.vstack([x, self._after(right.regime, 4, None, t, right, x, past)])
        by_x, by_p, by_t = x[:, : self.size], x[:, self.size : -1], x[:, -1]
        shift = by_x @ f_left + by_t - f_right
        by_x, by_p = by_x + np.outer(shift, time_x), by_p + np.outer(shift, time_p)
        if len(right.regime.holds) > len(left.regime.holds):
            onto_x, onto_p = self._onto(right.regime, t, right)
            by_x[: self.nx], by_p[: self.nx] = by_x[: self.nx] - onto_x @ by_x, by_p[: self.nx] - onto_x @ by_p - onto_p
        return by_x, by_p, time_x, time_p

    def _instant(self, passage: Passage) -> tuple[Vector, Vector]:
        left, t = passage.left, passage.time
        if passage.edge:
            self._refuse_moving_edge(passage)
            return np.zeros(self.size), np.zeros(self.count)
        if passage.guard is None:
            return np.zeros(self.size), self._known(t)
        guard, place = left.regime.active_set.watch, passage.guard
        slope_x, slope_p, slope_t = self.slopes.total(
            left.regime, ("guard", place), lambda *a: guard(*a)[place], t, left
        )
        rate = float(slope_t[0] + slope_x[0, : self.nx] @ self.slopes.rate(left.regime, t, left))
        if self._is_grazed(passage, place, rate):
            relation = left.regime.active_set.owners[place][0]
            if relation in self.compiled.state_events.watched:  # nothing jumps there
                return np.zeros(self.size), np.zeros(self.count)
            cause = self.hybrid.guards.causes[relation]
            raise ExportError(
                "AC615",
                f"sensitivities do not take {self.compiled.name}: at t = {t:.9g} s a relation is only grazed",
                where=() if cause.where is None else (cause.where,),
                evidence=[f"{cause.text}: its rate there, {rate:.3g} in SI units, is zero within its error"],
                help="use a tighter tolerance, if it is crossed by more than the error of a run; otherwise the instant "
                "has no derivative: choose values with which the relation is clearly crossed or not at all",
            )
        return -slope_x[0] / rate, -slope_p[0] / rate

    def _refuse_moving_edge(self, passage: Passage) -> None:
        """Raise ExportError AC615 for an event at the stop time that parameters move into or out of the run."""
        left, right = passage.left, passage.happened.moment
        changes = passage.happened.jumps or (left.m != right.m).any() or (left.x != right.x).any()
        if passage.time <= self.start or not changes:
            return
        what, where = "a sample", None
        if passage.guard is not None:
            relation = left.regime.active_set.owners[passage.guard][0]
            cause = self.hybrid.guards.causes[relation]
            what, where = cause.text, cause.where
            if relation in self.compiled.state_events.watched:  # nothing jumps there
                return
        elif self.hybrid.terminated:
            what = "terminal()"
        elif not any(derivative.any() for derivative in self._ticks(passage.time)):
            return
        raise ExportError(
            "AC615",
            f"sensitivities do not take {self.compiled.name}: at its stop time, t = {passage.time:.9g} s, {what} acts "
            "at an instant that depends on the parameters",
            where=() if where is None else (where,),
            cause="if it moves beyond the stop time it is not part of the run: the values there have no derivative",
            help="choose another stop time",
        )

    def _is_grazed(self, passage: Passage, place: int, rate: float) -> bool:
        """Whether the error of the guard makes the rate at which it is crossed uncertain.

        A guard with second derivative a that is crossed at the rate r reaches at most r^2/(2 a) below zero; an error e
        of the guard changes r by a e/r.
        """
        t, left, guards = passage.time, passage.left, self.hybrid.guards
        noise = float(guards.rates(t, left)[1][place])
        if abs(rate) * self.duration <= noise:
            return True
        ode = self.slopes.rate(left.regime, t, left)
        size = np.maximum(np.abs(left.x), self.compiled.nominal_x)
        h = _BACK * min(self.duration, float(1.0 / (np.abs(ode) / size).max(initial=1e-300)))
        before = self.hybrid.iteration.consistent(t - h, replace(left, x=left.x - h * ode))
        second = (float(guards.rates(t, left)[0][place]) - float(guards.rates(t - h, before)[0][place])) / h
        return rate**2 <= abs(second) * noise

    def _instants(self) -> Matrices:
        """Function `(p) -> (instants of time events, d instants / dp)`."""
        p = ca.SX.sym("p", len(self.p))
        instants = ca.densify(self.compiled.instants(p))
        return Matrices(ca.Function("instants", [p], [instants, ca.densify(ca.jacobian(instants, p))]))

    def _known(self, t: float) -> Vector:
        """Derivative of a time event's instant by parameters, (count,).

        Raises ExportError: AC615 if several instants coincide that parameters separate.
        """
        instants, by_p = self.slopes.kept("instants", self._instants)(self.p)
        at = [k for k, v in enumerate(instants.ravel()) if abs(v - t) <= same_instant(self.duration, t)]
        derivatives = [*by_p[at][:, self.chosen], *self._ticks(t)]
        if not derivatives:
            return np.zeros(self.count)
        if not np.allclose(derivatives, derivatives[0], rtol=1e-9, atol=0.0):
            raise ExportError(
                "AC615",
                f"sensitivities do not take {self.compiled.name}: at t = {t:.9g} s samples or time events meet that "
                "parameters move apart",
                cause="which of them comes first then depends on the sign of the change, and so may what follows",
                help="choose other values, or only parameters that move all of these instants alike",
            )
        return np.asarray(derivatives[0], dtype=np.float64)

    def _ticks(self, t: float) -> list[Vector]:
        """Derivatives, (count,) each, of the instants start + k * interval of the samples that act at `t`."""
        found = []
        for sample in np.flatnonzero(due(self.compiled, self.p, np.array([t]))[0]).tolist():
            value, slope = self.slopes.kept(("clock", sample), partial(self._clock, sample))(self.p)
            first, interval = value.ravel()
            found.append((slope[0] + round((t - first) / interval) * slope[1])[self.chosen])
        return found

    def _clock(self, sample: int) -> Matrices:
        """Function `(p) -> (start and interval of a sample, their derivatives by p)`."""
        pool = self.compiled.solution.structure.reduced.pool
        _, *nodes = pool.nodes[self.compiled.state_events.samples[sample]]
        p = ca.SX.sym("p", len(self.p))
        clock = ca.densify(ca.vertcat(*Builder(pool, ca.SX(0), p, {}).lower(nodes)))
        return Matrices(ca.Function("clock", [p], [clock, ca.densify(ca.jacobian(clock, p))]))

    @cached_property
    def _assigned(self) -> list[int]:
        """Indices in x of the variables of discrete equations."""
        return [a.position for a in self.compiled.state_events.assignments]

    @cached_property
    def _positions(self) -> list[int]:
        """Index in x of the state that each action sets."""
        return [position for clause in self.compiled.state_events.clauses for position, _ in clause.actions]

    @cached_property
    def _impulses(self) -> set[int]:
        """Indices of the actions that are impulses."""
        return {k for k, _ in impulses(self.compiled)}

    def _struck(
        self, moment: Any, impulsive: list[int], positions: list[int], t: float, x: Vector, past: Vector
    ) -> Vector:
        """Variations of the jumps of the states by the actions `impulsive`, shape of `x`.

        Raises ExportError: AC608 if other actions set states, at `positions`, at the same time.
        """
        if not impulsive:
            return np.zeros_like(x)
        if any(position < self.compiled.n_dynamic for position in positions):
            clauses = [self.compiled.state_events.clauses[k] for a, k in impulses(self.compiled) if a in impulsive]
            raise ExportError(
                "AC608",
                f"sensitivities do not take {self.compiled.name}: at t = {t:.9g} s states are reset together with an "
                "impulse",
                where=tuple(c.where for c in clauses[:2]),
                evidence=[c.text for c in clauses[:2]],
                help="let the impulse act alone, or compare two runs",
            )
        key = "struck", tuple(impulsive)
        return self.slopes.variations_of(
            moment.regime, key, lambda *a: self.compiled.events.struck(impulsive)(*a), t, moment, x, past
        )

    @staticmethod
    def _set(rows: list[int], values: Vector, x: Vector) -> Vector:
        """Variations `x` with these rows replaced by `values`."""
        if not rows:
            return x
        x = x.copy()
        x[rows] = values
        return x

    def _after(
        self, regime: Regime, output: int, rows: list[int] | None, t: float, moment: Any, x: Vector, past: Vector
    ) -> Vector:
        """Variations of `rows` of an output of `EventFunctions.reactions`, given those of states and of `pre`."""
        reactions = self.compiled.events.reactions
        count = reactions.numel_out(output) if rows is None else len(rows)
        if not count:
            return np.zeros((0, x.shape[1]))
        chosen = list(range(count)) if rows is None else rows
        key = "reactions", output, tuple(chosen)
        return self.slopes.variations_of(regime, key, lambda *a: reactions(*a)[output][chosen], t, moment, x, past)

    def _onto(self, regime: Regime, t: float, moment: Any) -> tuple[Vector, Vector]:
        """Maps whose values, subtracted from a variation, project it onto the condition of a new hold.

        They act on the carried variables and on the parameters: shapes (nx, size), (nx, count).
        """
        value, slope, directions = regime.active_set.kept(t, moment.x, moment.z, self.u, self.p, moment.m)
        slope, directions = slope.reshape(len(value), -1), directions.reshape(self.nx, -1)
        inverse = directions @ np.linalg.pinv(slope @ directions)
        key = "kept", regime.holds, regime.border
        by_p, by_m = self.slopes.kept(key, lambda: self._kept_slopes(regime))(
            t, moment.x, moment.z, self.u, self.p, moment.m
        )
        return inverse @ np.hstack([slope, by_m[:, self.slopes.memories]]), inverse @ by_p[:, self.chosen]

    def _kept_slopes(self, regime: Regime) -> Matrices:
        """Function `(t, x, z, u, p, m) ->` derivatives by p and m of the quantities that holds keep constant."""
        s = Symbols(self.compiled)
        value = regime.active_set.kept_of(*s.inputs)
        return Matrices(ca.Function("kept", s.inputs, [ca.densify(ca.jacobian(value, v)) for v in (s.p, s.m)]))
