"""Linear maps of a run, stretch by stretch and event by event, composed in forward or adjoint order.

Between events, the steps of a one-step method are differentiated exactly (`acausal/export/variation/`). The adjoint
form applies the transposed maps in reverse order.

The carried variables are the states, followed by the values of `pre` that are not states: `size` in all. A variation is
the derivative of these with respect to a parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from acausal.arrays import Truth, Vector
from acausal.export.observed import observed_function
from acausal.export.ports import Output
from acausal.export.sensitivity.saltation import EventMap, Saltation
from acausal.export.sensitivity.slopes import Matrices, Slopes
from acausal.export.variation.control import LEAST_SHARE
from acausal.export.variation.element import Accuracy, Back, Interval, Stiffness
from acausal.export.variation.variation import Variation
from acausal.lower.build import Symbols
from acausal.simulate.driver.hybrid import Passage
from acausal.simulate.driver.run import Run
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.events.regime import Regime

# Relative distance below which two instants coincide.
_APART = 1e-12
# Smallest uncertainty of an instant, as a fraction of the run, and the largest one in units of the smallest.
_ROUNDED, _MOST_UNCERTAIN = 1e-13, 1e10
# Delays between events at one instant are zero if smaller than this fraction of the terms that add up to either
# instant: those of two diodes of 1e-5 Ohm in series, which block together, are rounding errors of 2e-5.
_TOGETHER = 1e-4
# A first, rough integration estimates the magnitude of the variations: its tolerance, and the number of points at which
# each stretch is evaluated.
_ROUGH, _POINTS = 1e-5, 5
# If the estimate turns out to exceed the magnitude of the variations by more than this factor, they are computed again
# from the start, with what is known by then; at most until the given number of attempts.
_FAR, _ATTEMPTS = 100.0, 4
# Tolerance of rough variations, in tolerances of rough states, where the steps of the states are too long for them.
_LOOSE = 1e4


@dataclass(frozen=True, eq=False)
class Derivatives:
    """d outputs / d parameters at the end, shape (ny, count), d event times / d parameters, shape (n_events, count).

    `wrong`: the error of `final` that is known and that shorter steps would not reduce, same shape.
    """

    final: Vector
    of_times: Vector
    wrong: Vector


T = TypeVar("T")


class Chain:
    """The linear maps of a run, for the `count` parameters with the indices `chosen` in p."""

    def __init__(self, run: Run, chosen: list[int], wanted: Sequence[Output], tolerance: float) -> None:
        assert run.hybrid is not None, "a traced run records its events"
        assert run.hybrid.moment is not None, "the run has started"
        self.compiled, self.p, self.u = run.compiled, run.p, run.u
        self.chosen, self.wanted, self.tolerance = chosen, wanted, tolerance
        self.passages: list[Passage] = run.hybrid.passages
        self.last = run.hybrid.moment
        self.stop = run.hybrid.recorder.time
        self.slopes = Slopes(run.compiled, run.p, run.u, chosen)
        first = self.passages[0].time
        self._saltation = Saltation(self.slopes, run.hybrid, first, self.stop - first)
        self._events: dict[int, EventMap] = {}
        self.nx, self.count, self.size = self.slopes.nx, self.slopes.count, self.slopes.size
        self.stiffness, self.native = Stiffness(), run.options.native
        self.requests: list[tuple[Accuracy, list[int], Vector]] = []
        """Of the last integrations of variations: accuracy, indices of carried variables, and their scale."""
        self._largest, self._is_final = np.zeros((self.size, self.count)), True
        self.hybrid = run.hybrid
        self.marks = self._marks(run.options.max_step)
        own = [k for k, passage in enumerate(self.passages) if not passage.edge]
        self.terminal = own[-1] if run.hybrid.terminated and own else None
        """Index of the event that ended the run, if any; the instant of the final values moves with it."""

    def _marks(self, longest: float | None) -> Vector:
        """Instants [s] between events at which a step of a variation must end, so as not to step over a burst; (k,).

        The states need not show the burst, for instance if it is multiplied by a parameter that is zero. If the steps
        of the run are limited to `longest` [s], because not all kinks are located, so are those of the variations.
        """
        first, hybrid = self.passages[0].time, self.hybrid
        instants = [np.zeros(0) if longest is None else np.arange(first, self.stop, longest)]
        for k in range(len(self.passages)):
            stretch = self.stretch(k)
            if hybrid.missed_events is not None and stretch.end > stretch.start:
                times = np.linspace(stretch.start, stretch.end, 3)[1:]
                segment = replace(
                    hybrid.template, start=stretch.start, times=times, x=stretch.x, z=stretch.z, p=stretch.m
                )
                instants.append(hybrid.missed_events.candidates(stretch.regime.problem, segment))
        marks = np.unique(np.concatenate(instants))
        is_distinct = np.diff(marks, prepend=-np.inf) > _APART * np.abs(marks).max(initial=0.0)
        return np.asarray(marks[is_distinct])

    def event(self, k: int) -> EventMap:
        """The map over passage `k`."""
        if k not in self._events:
            self._events[k] = self._saltation(self.passages[k])
        return self._events[k]

    @cached_property
    def scale(self) -> Vector:
        """Rough magnitude of the variations over the run: their largest values, shape (size, count)."""
        found: Vector = self._ahead[0]
        return found

    @cached_property
    def _ahead(self) -> Vector:
        """Rough largest values from the event before each stretch to the end, (stretches + 1, size, count)."""
        x, stiffness = self.start(), Stiffness()
        largest, found = np.abs(x), [np.abs(x)]
        for k in range(len(self.passages)):
            by_x, by_p, *_ = self.event(k)
            x = by_x @ x + by_p
            largest, here = np.maximum(largest, np.abs(x)), np.abs(x)
            x, reached = self._reached(self.stretch(k), x, largest, stiffness)
            largest = np.maximum(largest, reached)
            found.append(np.maximum(here, reached))
        found[1] = np.maximum(*found[:2])
        return np.array([np.max(found[k:], axis=0) for k in range(1, len(found))] + [np.zeros_like(x)])

    def _reached(self, stretch: Stretch, x: Vector, largest: Vector, stiffness: Stiffness) -> tuple[Vector, Vector]:
        """(Variations at the end of a stretch, largest ones on it), roughly; shapes (size, count).

        `x` are those at its start, `largest` the largest before it. Where the steps of the states meet nearly infinite
        slopes, rough variations may become a billion times too large. Therefore a stretch with such growth is
        integrated again, with steps that are short enough for the variations.
        """
        before = replace(stiffness)
        points = [x, *stretch.roughly(x, stiffness, None)]
        reached = np.abs(points).max(axis=0)
        if ((reached > _FAR * largest) & (largest > 0.0)).any():
            points = [x, *stretch.roughly(x, before, np.where(largest > 0.0, largest, reached))]
            reached = np.abs(points).max(axis=0)
        return points[-1], reached

    @cached_property
    def uncertain(self) -> list[float]:
        """Uncertainty of the instant of each passage [s]."""
        uncertainties = []
        for passage in self.passages:
            error = _ROUNDED * max(abs(passage.time), self.stop - self.passages[0].time)
            if passage.guard is not None:
                rates, noises = self.hybrid.guards.rates(passage.time, passage.left)
                rate, noise = abs(float(rates[passage.guard])), float(noises[passage.guard])
                error = max(error, min(0.1 * noise / rate, error * _MOST_UNCERTAIN) if rate else 0.0)
            uncertainties.append(error)
        return uncertainties

    def forward(self) -> Derivatives:
        """Derivatives by a forward sweep, with a column for each parameter."""
        return self._judged(self._forward)

    def _judged(self, derive: Callable[[], Derivatives | None]) -> Derivatives:
        """The results of `derive`, repeated if it returns None, because variations turn out to be far smaller."""
        for attempts in reversed(range(_ATTEMPTS)):
            self.requests.clear()
            self._largest, self._is_final = np.abs(self.start()), attempts == 0
            found = derive()
            if found is not None:
                return found
        raise AssertionError("the last attempt is not judged")

    def _are_far_smaller(self, k: int) -> bool:
        """Whether variations, now known to the end of stretch `k`, are far smaller than their estimated magnitude.

        Most wrong estimates come from the first touch, so the truth is known soon after the start.
        """
        for accuracy, rows, scale in self.requests:
            self._largest[rows] = np.maximum(self._largest[rows], accuracy.largest * scale)
        self.requests.clear()
        known = np.maximum(self._largest, self._ahead[k + 1])
        least = LEAST_SHARE * known.max(axis=0, initial=0.0)
        if self._is_final or not (self.scale > _FAR * (known + least)).any():
            return False
        self.scale = known
        return True

    def _begun(self) -> Vector:
        """Variations at the start, followed by as many columns for their known errors; shape (size, 2 * count)."""
        x = self.start()
        return np.hstack([x, np.zeros_like(x)])

    def _across(self, k: int, x: Vector) -> tuple[Vector, Vector]:
        """(Variations after event k, those of its instant), from `x` before; shapes (size, 2 * count), (2 * count,).

        Those of the instant are nan where several events happen then that a parameter moves apart.
        """
        by_x, by_p, time_x, time_p, *_ = self.event(k)
        found, times = by_x @ x, time_x @ x
        found[:, : self.count] += by_p
        times[: self.count] += time_p
        times[: self.count][self._are_moved_apart(k, x[:, : self.count])] = np.nan
        if k == self.terminal:
            found[: self.nx] += np.outer(self._ending_rate(), times)
        return found, times

    def _are_moved_apart(self, k: int, x: Vector) -> Truth:
        """Whether each parameter moves the events of passage `k` apart, from variations `x` before; shape (count,)."""
        event = self.event(k)
        delays = event.apart_x @ x + event.apart_p
        size = np.abs(x)
        terms = np.abs(event.time_x) @ size + np.abs(event.time_p)
        terms = np.maximum(terms, np.abs(event.time_x + event.apart_x) @ size + np.abs(event.time_p + event.apart_p))
        found = np.asarray((np.abs(delays) > _TOGETHER * terms).any(axis=0))
        if found.any() and not event.separable:
            self._saltation.refuse_apart(self.passages[k], self.compiled.parameters[self.chosen[int(np.argmax(found))]])
        return found

    def _ended(self, x: Vector, times: Sequence[Vector]) -> tuple[Vector, Vector]:
        """(Derivatives of the outputs, their known errors), (ny, count), from variations `x` at the end and of events.

        Shapes of `x` and `times` as in `_across`.
        """
        y_x, y_p, y_t = self.output()
        found = y_x @ x
        if self.terminal is not None:
            found = found + np.outer(y_t, times[self.terminal])
        return np.asarray(found[:, : self.count] + y_p, dtype=np.float64), found[:, self.count :]

    def _forward(self) -> Derivatives | None:
        x, times = self._begun(), []
        for k in range(len(self.passages)):
            x, instant = self._across(k, x)
            times.append(instant)
            x = self.stretch(k).forward(x)
            if self._are_far_smaller(k):
                return None
        final, wrong = self._ended(x, times)
        return Derivatives(final, np.array(times)[:, : self.count], wrong)

    def variations(self, k: int, t: float) -> Vector:
        """Variations of the carried variables at an instant [s] of stretch `k`, shape (size, count)."""
        x = self.start()
        for j in range(k + 1):
            by_x, by_p, *_ = self.event(j)
            x = by_x @ x + by_p
            if j < k:
                x = self.stretch(j).forward(x)
        stretch = self.stretch(k)
        stops = np.array([t]) if t < stretch.end else np.zeros(0)
        return next((there for _, _, there in stretch.carry(stops, x)), x)

    def _ending_rate(self) -> Vector:
        assert self.terminal is not None, "the run has been ended"
        passage = self.passages[self.terminal]
        moment = passage.happened.moment
        return self.slopes.rate(moment.regime, passage.time, moment)

    def trajectory(
        self, times: Vector, states: Callable[[Vector], Vector] | None = None, *, with_errors: bool = False
    ) -> Vector:
        """d outputs / d parameters at `times`, shape (times, outputs, parameters); at an event just after it.

        `states` maps instants to states of the run, shape (instants, nx); it replaces steps on stretches without
        variations. `with_errors` doubles the columns: the derivatives are followed by their known errors.
        """
        x = self._begun() if with_errors else self.start()
        found = np.zeros((len(times), len(self.wanted), x.shape[1]))
        for k, passage in enumerate(self.passages):
            by_x, by_p, *_ = self.event(k)
            self._are_moved_apart(k, x[:, : self.count])  # or refused
            x = by_x @ x
            x[:, : self.count] += by_p
            last = k + 1 == len(self.passages)
            until = np.inf if last else self.passages[k + 1].time
            inside = np.flatnonzero((times >= passage.time) & (times < until))
            stretch, at = self.stretch(k), times[inside]
            w, variations = [np.concatenate([stretch.x, stretch.z])], [x]
            stops = np.unique(at[at > passage.time])
            if states is not None and self.is_still(stretch.regime, x):
                w += list(states(stops))
                variations += [x] * len(stops)
            else:
                x, points = stretch.passed(stops[stops < stretch.end], x)
                for t, variables, carried in points:
                    if t in stops:
                        w.append(variables)
                        variations.append(carried)
            if not len(inside):
                continue
            index = np.searchsorted(stops, at, side="right")
            found[inside] = self._output_derivatives(stretch, at, np.array(w)[index], np.array(variations)[index])
        return found

    def is_still(self, regime: Regime, x: Vector) -> bool:
        """Whether variations `x`, shape (size, count), are zero and remain zero in this regime."""
        slopes = self.variation(regime).slopes
        return not x.any() and slopes.n == slopes.nx and not (slopes.columns >= slopes.n).any()

    def is_fast(self) -> bool:
        """Whether `trajectory` needs compiled steps only, or none; with steps in Python it would cost many runs."""
        still, regimes = not self.start().any(), [passage.happened.moment.regime for passage in self.passages]
        for k, regime in enumerate(regimes):
            _, by_p, *_ = self.event(k)
            still = still and self.is_still(regime, by_p)
        return still or all(self.variation(regime).is_compiled(self.native) for regime in regimes)

    def _output_derivatives(self, stretch: Stretch, times: Vector, w: Vector, x: Vector) -> Vector:
        """d outputs / d parameters at k instants of one stretch, shape (k, ny, count).

        `times`: shape (k,); `w`: variables, shape (k, nx + nz); `x`: variations, shape (k, size, count). If columns of
        errors follow the variations, they follow the derivatives, too.
        """
        c, regime, k = self.compiled, stretch.regime, len(times)
        outputs = tuple(output.name for output in self.wanted)
        key = "shown", *outputs, tuple(self.chosen), regime.holds, regime.border
        packed = self.slopes.kept(key, lambda: BufferedFunction(self._packed(regime)))
        rows = packed.many(times[:, None], w[:, : self.nx], w[:, self.nx :], self.u, self.p, stretch.m)
        nz, width = len(c.algebraic), (self.size, self.count, len(c.algebraic))
        shapes = [(size, n) for size in (len(outputs), nz) for n in width]
        ends = np.cumsum([a * b for a, b in shapes])[:-1]
        parts = [
            part.reshape(k, n, size).transpose(0, 2, 1)
            for part, (size, n) in zip(np.split(rows, ends, axis=1), shapes, strict=True)
        ]
        by_x, by_p, by_z, implied_x, implied_p, implied_z = parts
        if nz:
            inner = by_z @ np.linalg.pinv(implied_z)
            by_x, by_p = by_x - inner @ implied_x, by_p - inner @ implied_p
        found = np.asarray(by_x @ x)
        found[:, :, : self.count] += by_p
        return found

    def _packed(self, regime: Regime) -> Any:
        """Function: derivatives of outputs and algebraic equations by carried variables, chosen parameters, and z."""
        s = Symbols(self.compiled)
        pieces = []
        for value in (self.observed(*s.inputs), regime.compiled.rhs(*s.inputs)[1]):
            by_p = ca.jacobian(value, s.p[self.chosen])
            past = ca.jacobian(value, s.m)[:, self.slopes.memories.tolist()]
            pieces += [ca.horzcat(ca.jacobian(value, s.x), past), by_p, ca.jacobian(value, s.z)]
        return ca.Function("shown", s.inputs, [ca.vertcat(*(ca.vec(ca.densify(piece)) for piece in pieces))])

    def _outputs_total(self, regime: Regime, t: float, moment: Any) -> tuple[Vector, Vector, Vector]:
        """Derivatives of the outputs by carried variables (ny, size), parameters (ny, count) and time (ny,)."""
        key = "outputs", *(output.name for output in self.wanted)
        return self.slopes.total(regime, key, lambda *a: self.observed(*a), t, moment)

    @cached_property
    def observed(self) -> Any:
        """Function `(t, x, z, u, p, m) -> y`."""
        key = "observed", *(output.name for output in self.wanted)
        return self.slopes.kept(key, lambda: observed_function(self.compiled, self.wanted))

    def adjoint(self) -> Derivatives:
        """The results of `forward`, by one backward sweep from the end, to which each event adds its time as a row.

        It starts with a forward sweep, because the steps have to be short enough for the variations.
        """
        return self._judged(self._adjoint)

    def _adjoint(self) -> Derivatives | None:
        x, times, path = self._begun(), [], []
        for k in range(len(self.passages)):
            x, instant = self._across(k, x)
            times.append(instant)
            x, back = self.stretch(k).recorded(x)
            path.append((self.event(k), back))
            if self._are_far_smaller(k):
                return None
        _, wrong = self._ended(x, times)
        rows, total, y_t = self.output()
        for k, ((on_x, on_p, time_x, time_p, *_), back) in reversed(list(enumerate(path))):
            rows, by_p = back(rows)
            total = total + by_p + rows @ on_p
            before = rows @ on_x
            if k == self.terminal:
                by_time = rows[:, : self.nx] @ self._ending_rate()
                by_time[: len(y_t)] += y_t
                before, total = before + np.outer(by_time, time_x), total + np.outer(by_time, time_p)
            rows = np.vstack([before, time_x])
            total = np.vstack([total, time_p])
        total = total + rows @ self.start()
        count = len(self.wanted)
        of_times = np.where(np.isnan(times)[:, : self.count], np.nan, total[count:][::-1])
        return Derivatives(total[:count], of_times, wrong)

    def is_no_event(self, k: int) -> bool:
        """Whether passage `k` is not an event of the model, but a located kink or the middle of a burst."""
        passage = self.passages[k]
        if passage.guard is None:
            return True
        return passage.left.regime.active_set.owners[passage.guard][0] in self.compiled.state_events.watched

    def stretch(self, k: int) -> Stretch:
        """The linear map from just after event k to the next one, or to the end."""
        moment = self.passages[k].happened.moment
        until = self.passages[k + 1].time if k + 1 < len(self.passages) else self.stop
        return Stretch(self, k, moment.regime, moment.x, moment.z, moment.m, self.passages[k].time, until)

    def variation(self, regime: Regime) -> Variation:
        """The variational equations of a regime, cached."""
        key = "variation", regime.holds, regime.border, tuple(self.chosen)
        return self.slopes.kept(key, lambda: Variation(regime.compiled, self.chosen))

    def start(self) -> Vector:
        """Derivatives by parameters of the carried variables at the start, before its events; shape (size, count)."""
        passage = self.passages[0]
        moment, c = passage.left, self.compiled
        nothing = np.zeros((self.size - self.nx, self.count))
        (direct,) = self.slopes.kept("given", self._given)(self.p)
        direct = direct[:, self.chosen]
        free = [k for k, v in enumerate(c.state_variables) if v not in c.start.direct and v not in c.start.defaulted]
        if not free:
            return np.vstack([direct, nothing])
        slopes = self.slopes.kept("start", self._start_slopes)
        by_x, by_z, by_m, by_p = slopes(passage.time, moment.x, moment.z, self.u, self.p, moment.m)
        direct[free] = 0.0
        right = by_x @ direct + by_p[:, self.chosen]
        unknown = np.linalg.lstsq(np.hstack([by_x[:, free], by_z, by_m[:, self.slopes.memories]]), -right, rcond=None)[
            0
        ]
        direct[free] = unknown[: len(free)]
        return np.vstack([direct, nothing])

    def _given(self) -> Matrices:
        """Function `(p) -> d declared starts / dp`."""
        p = ca.SX.sym("p", len(self.p))
        return Matrices(ca.Function("given", [p], [ca.densify(ca.jacobian(self.compiled.guess(p)[0], p))]))

    def _start_slopes(self) -> Matrices:
        """Function `(t, x, z, u, p, m) ->` derivatives of the start conditions by x, z, m and p."""
        c, s = self.compiled, Symbols(self.compiled)
        first = c.n_timely + len(c.state_events.samples)
        held = s.m[first : first + self.size - self.nx]
        remembered = c.events.reactions(*s.inputs)[4] - held if held.numel() else ca.SX(0, 1)
        r = ca.vertcat(c.conditions(*s.inputs)[0], c.rhs(*s.inputs)[1], remembered)
        return Matrices(ca.Function("slopes", s.inputs, [ca.densify(ca.jacobian(r, v)) for v in (s.x, s.z, s.m, s.p)]))

    def output(self) -> tuple[Vector, Vector, Vector]:
        """d outputs at the end by carried variables (ny, size), parameters (ny, count), and time (ny,)."""
        return self._outputs_total(self.last.regime, self.stop, self.last)

    def values(self) -> Vector:
        """The outputs at the end, shape (ny,)."""
        at = self.last
        return np.array(self.observed(self.stop, at.x, at.z, self.u, self.p, at.m)).ravel()


@dataclass(frozen=True, eq=False)
class Stretch:
    """Stretch `number`, free of events, from `start` to `end` [s], with x (nx,), z (nz,) and m (nm,) at its start."""

    chain: Chain
    number: int
    regime: Regime
    x: Vector
    z: Vector
    m: Vector
    start: float
    end: float

    def carry(self, stops: Vector, x: Vector, *, parameters: bool = True) -> Iterator[tuple[float, Vector, Vector]]:
        """Yield (time [s], variables (nx + nz,), variations (size, count)) at `stops`, ascending, and at the end.

        `x`: variations at the start, shape (size, count), or (size, 2 * count) as in `Chain`. Without `parameters` the
        columns are arbitrary directions, to which the parameters contribute nothing.
        """
        c = self.chain
        if self.end <= self.start:
            return
        variation, rows = c.variation(self.regime), self._rows
        slopes = variation.slopes
        scale, variables = slopes.scale[: slopes.nx, None], [*range(c.nx), *range(slopes.nx, slopes.n)]
        interval = self._interval([*stops.tolist(), self.end], variation)
        if parameters:
            interval = replace(interval, accuracy=self._accuracy(scale))
        stop_times = {*stops.tolist(), self.end}
        for t, w, there in variation.carry(interval, x[rows] / scale, c.stiffness, c.native, parameters=parameters):
            if t not in stop_times:
                continue
            found = x.copy()
            found[rows] = there * scale
            yield t, (w * slopes.scale)[variables], found

    def forward(self, x: Vector) -> Vector:
        """Variations at the end due to `x` at the start and to parameters, shapes as in `carry`."""
        return self.passed(np.zeros(0), x)[0]

    def passed(self, stops: Vector, x: Vector) -> tuple[Vector, list[tuple[float, Vector, Vector]]]:
        """(Variations at the end; the items of `carry` at `stops` and at the end), with as many columns as `x`."""

        def carried(x: Vector) -> tuple[Vector, list[tuple[float, Vector, Vector]]]:
            points = list(self.carry(stops, x))
            return points[-1][2] if points else x, points

        there, points = self._with_errors(x, carried)
        return there, [(t, w, np.pad(v, ((0, 0), (0, x.shape[1] - v.shape[1])))) for t, w, v in points]

    def _with_errors(self, x: Vector, carried: Callable[[Vector], tuple[Vector, T]]) -> tuple[Vector, T]:
        """The results of `carried` for `x`; its columns of errors, if any, are left out as long as they are zero."""
        c, before = self.chain, len(self.chain.requests)
        if x.shape[1] > c.count and not x[:, c.count :].any():
            end, other = carried(x[:, : c.count])
            if not any(accuracy.noted for accuracy, *_ in c.requests[before:]):
                return np.hstack([end, np.zeros_like(end)]), other
        return carried(x)

    def parts(self, ends: Vector) -> Iterator[tuple[float, Vector]]:
        """Yield (end [s], linear map (size, size)) of each part of the stretch up to the next of `ends`, shape (k,)."""
        unit = np.eye(self.chain.size)
        here = self
        for end in ends.tolist():
            part = replace(here, end=end)
            for t, w, linear_map in part.carry(np.zeros(0), unit, parameters=False):
                yield t, linear_map
                here = replace(here, start=t, x=w[: self.chain.nx], z=w[self.chain.nx :])

    def recorded(self, x: Vector) -> tuple[Vector, Back]:
        """(Variations at the end, as from `forward`; function that pulls rows, shape (k, size), back to the start)."""
        return self._with_errors(x, self._recorded)

    def _recorded(self, x: Vector) -> tuple[Vector, Back]:
        c = self.chain
        if self.end <= self.start:
            return x, lambda rows: (rows, np.zeros((len(rows), c.count)))
        variation, integrated = c.variation(self.regime), self._rows
        scale = variation.slopes.scale[: variation.slopes.nx]
        interval = replace(self._interval([self.end], variation), accuracy=self._accuracy(scale[:, None]))
        end, scaled_back = variation.recorded(interval, x[integrated] / scale[:, None], c.stiffness, c.native)
        there = x.copy()
        there[integrated] = end * scale[:, None]

        def back(rows: Vector) -> tuple[Vector, Vector]:
            found = rows.copy()
            by_x, total = scaled_back(rows[:, integrated] * scale)
            found[:, integrated] = by_x / scale
            return found, total

        return there, back

    def roughly(self, x: Vector, stiffness: Stiffness, scale: Vector | None) -> Iterator[Vector]:
        """Yield rough variations, due to `x` at the start and to parameters, at a few points; shapes (size, count).

        Steps are short enough for variations of the magnitude `scale`, same shape, or, if it is None, for the states.
        """
        c = self.chain
        if self.end <= self.start:
            return
        variation = c.variation(self.regime)
        sizes = variation.slopes.scale[: variation.slopes.nx, None]
        interval = self._interval(np.linspace(self.start, self.end, _POINTS + 1)[1:].tolist(), variation)
        interval = replace(interval, tolerance=max(_ROUGH, c.tolerance))
        if scale is not None:
            interval = replace(interval, accuracy=Accuracy(scale[self._rows] / sizes, self._shortest, _LOOSE))
        for *_, there in variation.carry(interval, x[self._rows] / sizes, stiffness, c.native):
            found = x.copy()
            found[self._rows] = there * sizes
            yield found

    def _accuracy(self, scale: Vector) -> Accuracy:
        """The accuracy required of variations that are scaled by `scale`, shape (nx, 1)."""
        c = self.chain
        found = Accuracy(c.scale[self._rows] / scale, self._shortest)
        c.requests.append((found, self._rows, scale))
        return found

    @property
    def _shortest(self) -> float:
        """Uncertainty of the instants of both ends [s]: shorter steps are pointless."""
        return max(self.chain.uncertain[self.number : self.number + 2])

    @cached_property
    def _rows(self) -> list[int]:
        """Indices, among the carried variables, of the states and of the values of `pre` that the equations read."""
        c, held = self.chain, self.chain.variation(self.regime).slopes.held
        return [*range(c.nx), *(c.nx + k - int(c.slopes.memories[0]) for k in held)]

    def _interval(self, ends: Sequence[float], variation: Variation) -> Interval:
        c = self.chain
        w = np.concatenate([self.x, self.m[variation.slopes.held], self.z]) / variation.slopes.scale
        marks = c.marks[(c.marks > self.start) & (c.marks < self.end)]
        nearest = np.abs(marks[:, None] - np.append(ends, self.start)).min(axis=1)
        ends = np.sort(np.append(marks[nearest > _APART * max(abs(self.start), abs(self.end))], ends)).tolist()
        return Interval(self.start, ends, w, (np.concatenate([c.u, c.p]), self.m), c.tolerance)
