"""Derivatives of final values and of event times with respect to parameters, through all events of a run.

Between events steps of a method of their own are differentiated (`acausal/export/variation/`). At an event at t* with
guard g the derivative of the time is dt* = -(g_x X + g_p) / (g_t + g_x f), and that of the states jumps: with
x+ = r(t, x-, p), X+ = r_x (X- + f- dt*) + r_t dt* + r_p - f+ dt* (the saltation matrix). The sequence of events is that
of the nominal run. Time events and samples move with the parameters that their instants depend on.

Source: W. S. Galán, P. I. Barton, W. F. Feehery, Parametric sensitivity functions for hybrid discrete/continuous
systems, Applied Numerical Mathematics 31 (1999); the adjoint form is its transpose, in reverse order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeVar
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.errors import ExportError, UsageError, nearest
from acausal.export.forms import SENSITIVITIES, check
from acausal.export.observed import observed_function
from acausal.export.ports import Output, named_outputs
from acausal.export.variation.element import Temper, Way
from acausal.export.variation.variation import Variation
from acausal.language.component import Component
from acausal.lower.build import Builder
from acausal.lower.compile import compile
from acausal.lower.compiled import CompiledModel
from acausal.lower.events.impulses import impulses
from acausal.lower.symbols import Symbols
from acausal.result.result import Result
from acausal.simulate.arguments import input_vector, parameter_vector
from acausal.simulate.driver.hybrid import Passage
from acausal.simulate.driver.run import Run
from acausal.simulate.equations.calls.quick import Quick
from acausal.simulate.equations.kept import kept
from acausal.simulate.events.regime import Regime
from acausal.simulate.events.sampling import due
from acausal.simulate.inputs.given import Inputs
from acausal.simulate.options import options

Vector = NDArray[np.float64]

# Models are compared by identity, and forgotten when nobody else holds them.
_KEPT: WeakKeyDictionary[CompiledModel, dict[Any, Any]] = WeakKeyDictionary()
T = TypeVar("T")
# How far back the rate of a guard is compared, as a share of the run and of the time in which states change.
_BACK = 1e-6


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """First derivatives of one run.

    Attributes
    ----------
    parameters, outputs
        Names, in the order of columns and rows.
    final
        d output / d parameter at the stop time, shape (outputs, parameters), SI.
    values
        The outputs at the stop time.
    event_times
        Instants of the located events [s], shape (events,).
    of_event_times
        d instant / d parameter, shape (events, parameters).
    result
        The run itself.
    times, along
        Instants that were asked for [s], and d output / d parameter at each, shape (times, outputs, parameters); at
        an event just after it.
    """

    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    final: Vector
    values: Vector
    event_times: Vector
    of_event_times: Vector
    result: Result
    times: Vector = field(default_factory=lambda: np.zeros(0))
    along: Vector = field(default_factory=lambda: np.zeros((0, 0, 0)))


def sensitivities(
    model: Component | CompiledModel,
    parameters: Sequence[str],
    outputs: Sequence[str],
    *,
    start_time: float | None = None,
    stop_time: float | None = None,
    tolerance: float = 1e-10,
    solver: str | None = None,
    values: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
    method: Literal["forward", "adjoint"] = "forward",
    times: Sequence[float] | Vector = (),
    native: bool | None = None,
) -> Sensitivities:
    """Differentiate the final values of `outputs` and all event times with respect to `parameters`.

    Parameters
    ----------
    parameters
        Names of scalar parameters that are free (no numbers) in the compiled model.
    outputs
        Names of variables, as in a `Result`.
    values
        Values of parameters for this run, by path, in SI.
    method
        "forward" integrates a column per parameter, "adjoint" a row per output and event backwards. The results are
        equal, and the times nearly so: both share the steps of `acausal.export.variation`.
    times
        Instants at which the outputs are differentiated, too.
    native
        Whether the run and its derivatives use compiled C, as in `simulate`; what was compiled is kept on disk.

    Raises
    ------
    UsageError
        AC020 for an unknown parameter or none at all, AC010 for an unknown output, AC025 for an unknown method, AC044
        for `times` outside of the run.
    ExportError
        AC608 where states are reset together with an impulse, AC615 where a relation is only grazed.
    AcausalError
        What the run itself raises.
    """
    if method not in ("forward", "adjoint"):
        raise UsageError("AC025", f"there is no method '{method}'", help="methods: forward, adjoint")
    compiled = model if isinstance(model, CompiledModel) else compile(model, parameters=values)
    wanted = named_outputs(compiled, outputs)
    check(compiled, SENSITIVITIES, wanted)
    chosen = _places_of(compiled, parameters)
    opts = options(
        compiled.flat.experiment,
        start_time=start_time,
        stop_time=stop_time,
        tolerance=tolerance,
        solver=solver,
        native=native,
    )
    p = parameter_vector(compiled, (values or {}) if isinstance(model, CompiledModel) else {})
    run = Run(compiled, opts, p, Inputs(input_vector(compiled, inputs or {})), None, traced=True)
    result = run.result()
    chain = Chain(run, chosen, wanted, tolerance)
    asked = np.asarray(times, dtype=float)
    if len(asked) and not (chain.passages[0].time <= asked.min() and asked.max() <= chain.stop):
        raise UsageError(
            "AC044",
            f"derivatives are asked for from {asked.min():g} to {asked.max():g} s, outside of the run",
            help=f"the run goes from {chain.passages[0].time:g} to {chain.stop:g} s",
        )
    final, of_times = chain.forward() if method == "forward" else chain.adjoint()
    located = [k for k in range(len(chain.passages)) if not chain.is_unseen(k)]
    return Sensitivities(
        tuple(parameters),
        tuple(output.name for output in wanted),
        final,
        chain.values(),
        np.array([chain.passages[k].time for k in located]),
        of_times[located],
        result,
        asked,
        chain.trajectory(asked) if len(asked) else np.zeros((0, len(wanted), len(parameters))),
    )


def _places_of(compiled: CompiledModel, parameters: Sequence[str]) -> list[int]:
    """Where parameters stand among those of the model; UsageError AC020 for one that is not there, or for none."""
    if not parameters:
        free = ", ".join(compiled.parameters[:6]) or "none"
        raise UsageError("AC020", "there is no parameter to differentiate for", evidence=[f"parameters: {free}"])
    for name in parameters:
        if name not in compiled.parameters:
            close = nearest(name, list(compiled.parameters))
            evidence = [f"did you mean {', '.join(close)}?"] if close else []
            raise UsageError("AC020", f"there is no parameter '{name}'", evidence=evidence)
    return [compiled.parameters.index(name) for name in parameters]


class Matrices:
    """A function whose outputs are matrices, called quickly."""

    def __init__(self, function: Any) -> None:
        self._quick = Quick(function)
        self._shapes = [function.size_out(k) for k in range(function.n_out())]

    def __call__(self, *arguments: Any) -> list[Vector]:
        """Its outputs."""
        return [v.reshape(shape) for v, shape in zip(self._quick(*arguments), self._shapes, strict=True)]


class Chain:
    """The linear maps of a run, stretch by stretch and event by event."""

    def __init__(self, run: Run, chosen: list[int], wanted: Sequence[Output], tolerance: float) -> None:
        assert run.hybrid is not None, "a traced run keeps its events"
        assert run.hybrid.moment is not None, "it has begun"
        self.compiled, self.p, self.u, self.hybrid = run.compiled, run.p, run.u, run.hybrid
        self.chosen, self.wanted, self.tolerance = chosen, wanted, tolerance
        self.passages: list[Passage] = run.hybrid.passages
        self.last = run.hybrid.moment
        self.stop = run.hybrid.recorder.time
        self.nx, self.count = len(self.compiled.states), len(chosen)
        self.temper, self.native = Temper(), run.options.native

    def forward(self) -> tuple[Vector, Vector]:
        """(d outputs, d event times) / d parameters; states are carried along."""
        x = self.start()
        of_times = np.zeros((len(self.passages), self.count))
        for k, passage in enumerate(self.passages):
            by_x, by_p, time_x, time_p = self.event(passage)
            of_times[k] = time_x @ x + time_p
            x = by_x @ x + by_p
            x = self.stretch(k).forward(x)
        y_x, y_p = self.output()
        return y_x @ x + y_p, of_times

    def trajectory(self, times: Vector, states: Callable[[Vector], Vector] | None = None) -> Vector:
        """d outputs / d parameters at `times`, shape (times, outputs, parameters); at events just after them.

        `states` are those of the run at some instants, shape (instants, nx): where nothing varies along a stretch, no
        step is made to know them.
        """
        found = np.zeros((len(times), len(self.wanted), self.count))
        x = self.start()
        for k, passage in enumerate(self.passages):
            by_x, by_p, *_ = self.event(passage)
            x = by_x @ x + by_p
            last = k + 1 == len(self.passages)
            until = np.inf if last else self.passages[k + 1].time
            inside = np.flatnonzero((times >= passage.time) & (times < until))
            stretch, at = self.stretch(k), times[inside]
            w, there = [np.concatenate([stretch.x, stretch.z])], [x]
            stops = np.unique(at[at > passage.time])
            if states is not None and self.is_still(stretch.regime, x):
                w += list(states(stops))
                there += [x] * len(stops)
            else:
                for t, variables, carried in stretch.carry(stops[stops < stretch.end], x):
                    x = carried
                    if t in stops:
                        w.append(variables)
                        there.append(x)
            if not len(inside):
                continue
            place = np.searchsorted(stops, at, side="right")
            found[inside] = self._shown(stretch, at, np.array(w)[place], np.array(there)[place])
        return found

    def is_still(self, regime: Regime, x: Vector) -> bool:
        """Whether states without variations `x` have none from the parameters under this regime, either."""
        slopes = self.variation(regime).slopes
        return not x.any() and slopes.n == slopes.nx and not (slopes.columns >= slopes.n).any()

    def is_quick(self) -> bool:
        """Whether a trajectory takes compiled steps, or none: in Python it costs many runs."""
        still, regimes = not self.start().any(), [passage.happened.moment.regime for passage in self.passages]
        for passage, regime in zip(self.passages, regimes, strict=True):
            _, by_p, *_ = self.event(passage)
            still = still and self.is_still(regime, by_p)
        return still or all(self.variation(regime).is_compiled(self.native) for regime in regimes)

    def _shown(self, stretch: Stretch, times: Vector, w: Vector, x: Vector) -> Vector:
        """d outputs / d parameters at k instants of one stretch; `w` are variables, `x` variations, (k, nx, count)."""
        c, regime, k = self.compiled, stretch.regime, len(times)
        outputs = tuple(output.name for output in self.wanted)
        key = "shown", *outputs, tuple(self.chosen), regime.holds, regime.border
        packed = self._kept(key, lambda: Quick(self._packed(regime)))
        rows = packed.many(times[:, None], w[:, : self.nx], w[:, self.nx :], self.u, self.p, stretch.m)
        nz, width = len(c.algebraic), (self.nx, self.count, len(c.algebraic))
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
        return np.asarray(by_x @ x + by_p)

    def _packed(self, regime: Regime) -> Any:
        """Derivatives of the outputs and of the algebraic equations by x, the chosen parameters, and z, in a row."""
        s = Symbols(self.compiled)
        pieces = []
        for value in (self._observed(*s.inputs), regime.compiled.rhs(*s.inputs)[1]):
            by_p = ca.jacobian(value, s.p)[:, self.chosen]
            pieces += [ca.jacobian(value, s.x), by_p, ca.jacobian(value, s.z)]
        return ca.Function("shown", s.inputs, [ca.vertcat(*(ca.vec(ca.densify(piece)) for piece in pieces))])

    def _shown_by(self, regime: Regime, t: float, moment: Any) -> tuple[Vector, Vector, Vector]:
        """Derivatives of the outputs by states, parameters and time."""
        key = "outputs", *(output.name for output in self.wanted)
        return self._total(regime, key, lambda *a: self._observed(*a), t, moment)

    @cached_property
    def _observed(self) -> Any:
        key = "observed", *(output.name for output in self.wanted)
        return self._kept(key, lambda: observed_function(self.compiled, self.wanted))

    def adjoint(self) -> tuple[Vector, Vector]:
        """The same, from the end backwards: one sweep, in which each event time joins at its event."""
        rows, total = self.output()
        for k in reversed(range(len(self.passages))):
            rows, by_p = self.stretch(k).adjoint(rows)
            on_x, on_p, time_x, time_p = self.event(self.passages[k])
            total = total + by_p + rows @ on_p
            rows = np.vstack([rows @ on_x, time_x])
            total = np.vstack([total, time_p])
        total = total + rows @ self.start()
        count = len(self.wanted)
        return total[:count], total[count:][::-1]

    def is_unseen(self, k: int) -> bool:
        """Whether a stretch only ends there, without an event: at a kink or in the middle of a burst."""
        passage = self.passages[k]
        if passage.guard is None:
            return True
        return passage.left.regime.owners[passage.guard][0] in self.compiled.state_events.watched

    def stretch(self, k: int) -> Stretch:
        """The linear map from just after event k to the next one, or to the end."""
        moment = self.passages[k].happened.moment
        until = self.passages[k + 1].time if k + 1 < len(self.passages) else self.stop
        return Stretch(self, moment.regime, moment.x, moment.z, moment.m, self.passages[k].time, until)

    def variation(self, regime: Regime) -> Variation:
        """The equations of a regime with their slopes."""
        key = "variation", regime.holds, regime.border, tuple(self.chosen)
        return self._kept(key, lambda: Variation(regime.compiled, self.chosen))

    def _kept(self, key: Any, make: Callable[[], T]) -> T:
        """What is made once for a model."""
        own = _KEPT.setdefault(self.compiled, {})
        if key not in own:
            own[key] = make()
        found: T = own[key]
        return found

    def start(self) -> Vector:
        """Derivatives of the states at the start."""
        passage = self.passages[0]
        moment, c = passage.left, self.compiled
        (direct,) = self._kept("given", self._given)(self.p)
        direct = direct[:, self.chosen]
        free = [k for k, v in enumerate(c.state_variables) if v not in c.start.direct and v not in c.start.defaulted]
        if not free:
            return direct
        slopes = self._kept("start", self._start_slopes)
        by_x, by_z, by_p = slopes(passage.time, moment.x, moment.z, self.u, self.p, moment.m)
        direct[free] = 0.0
        right = by_x @ direct + by_p[:, self.chosen]
        unknown = np.linalg.lstsq(np.hstack([by_x[:, free], by_z]), -right, rcond=None)[0]
        direct[free] = unknown[: len(free)]
        return direct

    def _given(self) -> Matrices:
        """`(p) -> derivatives of the declared starts`."""
        p = ca.SX.sym("p", len(self.p))
        return Matrices(ca.Function("given", [p], [ca.densify(ca.jacobian(self.compiled.guess(p)[0], p))]))

    def _start_slopes(self) -> Matrices:
        """`(t, x, z, u, p, m) -> derivatives of the start conditions by x, z and p`."""
        c, s = self.compiled, Symbols(self.compiled)
        r = ca.vertcat(c.conditions(*s.inputs)[0], c.rhs(*s.inputs)[1])
        return Matrices(ca.Function("slopes", s.inputs, [ca.densify(ca.jacobian(r, v)) for v in (s.x, s.z, s.p)]))

    def event(self, passage: Passage) -> tuple[Vector, Vector, Vector, Vector]:
        """(dx+/dx-, dx+/dp, dt*/dx-, dt*/dp) of one event, at fixed time on both sides."""
        left, right, t = passage.left, passage.happened.moment, passage.time
        time_x, time_p = self._instant(passage)
        f_left, f_right = self._rate(left.regime, t, left), self._rate(right.regime, t, right)
        columns = self.nx + self.count + 1
        x = np.eye(self.nx, columns)  # variations of the states by the states before, the parameters, and the time
        past = self._after(left.regime, 4, None, t, left, x, np.zeros((len(self._memories), columns)))
        past[:, -1] = 0.0  # what is remembered does not change until the event
        for jump in passage.happened.jumps:
            moment = jump.moment
            x = self._set(self._assigned, self._after(moment.regime, 1, None, t, moment, x, past), x)
            acting = np.flatnonzero(jump.applied).tolist()
            hits = [k for k in acting if k in self._impulses]
            rows = [k for k in acting if k not in self._impulses]
            places = [self._places[k] for k in rows]
            values = self._after(moment.regime, 3, rows, t, moment, x, past)
            struck = self._struck(moment, hits, places, t, x, past)
            x = self._set(places, values, x) + struck
            if jump.advances:
                past = self._after(moment.regime, 4, None, t, moment, x, past)
        x = self._set(self._assigned, self._after(right.regime, 1, None, t, right, x, past), x)
        by_x, by_p, by_t = x[:, : self.nx], x[:, self.nx : -1], x[:, -1]
        shift = by_x @ f_left + by_t - f_right
        by_x, by_p = by_x + np.outer(shift, time_x), by_p + np.outer(shift, time_p)
        if len(right.regime.holds) > len(left.regime.holds):
            ways = self._onto(right.regime, t, right)
            by_x, by_p = by_x - ways[0] @ by_x, by_p - ways[0] @ by_p - ways[1]
        return by_x, by_p, time_x, time_p

    def _instant(self, passage: Passage) -> tuple[Vector, Vector]:
        left, t = passage.left, passage.time
        if passage.guard is None:
            instants, by_p = self._kept("instants", self._instants)(self.p)
            at = [k for k, v in enumerate(instants.ravel()) if abs(v - t) <= 1e-12 * max(1.0, abs(t))]
            return np.zeros(self.nx), by_p[at[0], self.chosen] if at else self._tick(t)
        guard, place = left.regime.watch, passage.guard
        own = self._total(left.regime, ("guard", place), lambda *a: guard(*a)[place], t, left)
        slope_x, slope_p, slope_t = own
        rate = float(slope_t[0] + slope_x[0] @ self._rate(left.regime, t, left))
        if self._is_grazed(passage, place, rate):
            relation = left.regime.owners[place][0]
            if relation in self.compiled.state_events.watched:  # nothing jumps there
                return np.zeros(self.nx), np.zeros(self.count)
            cause = self.hybrid.guards.causes[relation]
            raise ExportError(
                "AC615",
                f"sensitivities do not take {self.compiled.name}: at t = {t:.9g} s a relation is only grazed",
                where=() if cause.where is None else (cause.where,),
                evidence=[f"{cause.text}: its rate there, {rate:.3g} in SI units, cannot be told from zero"],
                help="a tighter tolerance where it is passed by more than the error of a run; else the instant has no "
                "derivative: choose parameters by which the relation is passed clearly or not at all",
            )
        return -slope_x[0] / rate, -slope_p[0] / rate

    def _is_grazed(self, passage: Passage, place: int, rate: float) -> bool:
        """Whether the rate at which a guard is passed would be another one, or none, within the error of the guard.

        A guard that turns at the rate a, passed at r, is r^2/(2 a) deep behind zero at most: an error e of it changes r
        by a e/r.
        """
        t, left, guards = passage.time, passage.left, self.hybrid.guards
        noise = float(guards.rates(t, left)[1][place])
        if abs(rate) * (self.stop - self.passages[0].time) <= noise:
            return True
        ode = self._rate(left.regime, t, left)
        size = np.maximum(np.abs(left.x), self.compiled.nominal_x)
        h = _BACK * min(self.stop - self.passages[0].time, float(1.0 / (np.abs(ode) / size).max(initial=1e-300)))
        before = self.hybrid.iteration.consistent(t - h, replace(left, x=left.x - h * ode))
        turns = (float(guards.rates(t, left)[0][place]) - float(guards.rates(t - h, before)[0][place])) / h
        return rate**2 <= abs(turns) * noise

    def _instants(self) -> Matrices:
        """`(p) -> instants of time events, and their derivatives`."""
        p = ca.SX.sym("p", len(self.p))
        instants = ca.densify(self.compiled.instants(p))
        return Matrices(ca.Function("instants", [p], [instants, ca.densify(ca.jacobian(instants, p))]))

    def _tick(self, t: float) -> Vector:
        """How an instant of a sample moves: start + k * interval, with the number k of the tick."""
        acting = np.flatnonzero(due(self.compiled, self.p, np.array([t]))[0])
        if not len(acting):
            return np.zeros(self.count)
        sample = int(acting[0])
        value, slope = self._kept(("clock", sample), lambda: self._clock(sample))(self.p)
        first, interval = value.ravel()
        by_p = slope[0] + round((t - first) / interval) * slope[1]
        return np.asarray(by_p[self.chosen], dtype=np.float64)

    def _clock(self, sample: int) -> Matrices:
        """`(p) -> start and interval of a sample, and their derivatives`."""
        pool = self.compiled.solution.structure.reduced.pool
        _, *nodes = pool.nodes[self.compiled.state_events.samples[sample]]
        p = ca.SX.sym("p", len(self.p))
        clock = ca.densify(ca.vertcat(*Builder(pool, ca.SX(0), p, {}).lower(nodes)))
        return Matrices(ca.Function("clock", [p], [clock, ca.densify(ca.jacobian(clock, p))]))

    @cached_property
    def _memories(self) -> NDArray[np.int64]:
        """Places among the modes of what `pre` remembers."""
        events = self.compiled.state_events
        first = self.compiled.n_timely + len(events.samples)
        return np.arange(first, first + len(events.memories))

    @cached_property
    def _assigned(self) -> list[int]:
        """Places of the variables of discrete equations."""
        return [a.position for a in self.compiled.state_events.assignments]

    @cached_property
    def _places(self) -> list[int]:
        """The state that each action sets."""
        return [position for clause in self.compiled.state_events.clauses for position, _ in clause.actions]

    @cached_property
    def _impulses(self) -> set[int]:
        """Actions that are impulses."""
        return {k for k, _ in impulses(self.compiled)}

    def _struck(self, moment: Any, hits: list[int], places: list[int], t: float, x: Vector, past: Vector) -> Vector:
        """Variations of what impulses add to the states."""
        if not hits:
            return np.zeros_like(x)
        if any(place < self.compiled.n_dynamic for place in places):
            clauses = [self.compiled.state_events.clauses[k] for a, k in impulses(self.compiled) if a in hits]
            raise ExportError(
                "AC608",
                f"sensitivities do not take {self.compiled.name}: at t = {t:.9g} s states are reset together with an "
                "impulse",
                where=tuple(c.where for c in clauses[:2]),
                evidence=[c.text for c in clauses[:2]],
                help="let the impulse act alone, or compare two runs",
            )
        key = "struck", tuple(hits)
        return self._carried(moment.regime, key, lambda *a: self.compiled.events.struck(hits)(*a), t, moment, x, past)

    @staticmethod
    def _set(places: list[int], values: Vector, x: Vector) -> Vector:
        """Variations in which some states take new ones."""
        if not places:
            return x
        x = x.copy()
        x[places] = values
        return x

    def _after(
        self, regime: Regime, output: int, rows: list[int] | None, t: float, moment: Any, x: Vector, past: Vector
    ) -> Vector:
        """Variations of what the model reacts with, given those of the states and of what is remembered."""
        reactions = self.compiled.events.reactions
        count = reactions.numel_out(output) if rows is None else len(rows)
        if not count:
            return np.zeros((0, x.shape[1]))
        chosen = list(range(count)) if rows is None else rows
        key = "reactions", output, tuple(chosen)
        return self._carried(regime, key, lambda *a: reactions(*a)[output][chosen], t, moment, x, past)

    def _carried(
        self, regime: Regime, key: tuple[Any, ...], function: Any, t: float, moment: Any, x: Vector, past: Vector
    ) -> Vector:
        """Variations of a function of all, given those of the states and of what is remembered."""
        by_x, by_p, by_t, by_past = self._full(regime, key, function, t, moment)
        found = by_x @ x + by_past @ past
        found[:, self.nx : -1] += by_p
        found[:, -1] += by_t
        return np.asarray(found, dtype=np.float64)

    def _onto(self, regime: Regime, t: float, moment: Any) -> tuple[Vector, Vector]:
        """Projection of a variation onto what a new hold keeps: `(by states, by parameters)` to subtract."""
        value, slope, ways = regime.kept(t, moment.x, moment.z, self.u, self.p, moment.m)
        slope, ways = slope.reshape(len(value), -1), ways.reshape(self.nx, -1)
        inverse = ways @ np.linalg.pinv(slope @ ways)
        key = "kept", regime.holds, regime.border
        (by_p,) = self._kept(key, lambda: self._kept_slopes(regime))(t, moment.x, moment.z, self.u, self.p, moment.m)
        return inverse @ slope, inverse @ by_p[:, self.chosen]

    def _kept_slopes(self, regime: Regime) -> Matrices:
        """`(t, x, z, u, p, m) -> derivatives by p of what a hold keeps`."""
        s = Symbols(self.compiled)
        return Matrices(ca.Function("kept", s.inputs, [ca.densify(ca.jacobian(regime.kept_of(*s.inputs), s.p))]))

    def _rate(self, regime: Regime, t: float, moment: Any) -> Vector:
        return kept(regime.compiled).rhs(t, moment.x, moment.z, self.u, self.p, moment.m)[0]

    def _total(
        self, regime: Regime, key: tuple[Any, ...], function: Any, t: float, moment: Any
    ) -> tuple[Vector, Vector, Vector]:
        """Derivatives with respect to (x, chosen p, t) of a function of all, algebraic variables eliminated."""
        return self._full(regime, key, function, t, moment)[:3]

    def _full(
        self, regime: Regime, key: tuple[Any, ...], function: Any, t: float, moment: Any
    ) -> tuple[Vector, Vector, Vector, Vector]:
        """The same, and with respect to what is remembered; `key` tells the functions of a regime apart."""
        own_key = *key, regime.holds, regime.border
        slopes = self._kept(own_key, lambda: self._slopes(regime, function))
        *own, by_z, implied_x, implied_p, implied_t, implied_past, implied_z = slopes(
            t, moment.x, moment.z, self.u, self.p, moment.m
        )
        if len(regime.compiled.algebraic):
            inner = by_z @ np.linalg.pinv(implied_z)
            implied = implied_x, implied_p, implied_t, implied_past
            own = [a - inner @ b for a, b in zip(own, implied, strict=True)]
        return own[0], own[1][:, self.chosen], own[2].ravel(), own[3]

    def _slopes(self, regime: Regime, function: Any) -> Matrices:
        """Derivatives of a function and of the algebraic equations by x, p, t, what is remembered, and z."""
        s, c = Symbols(self.compiled), regime.compiled
        pieces = []
        for value in (function(*s.inputs), c.rhs(*s.inputs)[1]):
            pieces += [ca.jacobian(value, v) for v in (s.x, s.p, s.t)]
            pieces += [ca.jacobian(value, s.m)[:, self._memories.tolist()], ca.jacobian(value, s.z)]
        return Matrices(ca.Function("slopes", s.inputs, [ca.densify(piece) for piece in pieces]))

    def output(self) -> tuple[Vector, Vector]:
        """d output / d states and d output / d parameters at the end."""
        return self._shown_by(self.last.regime, self.stop, self.last)[:2]

    def values(self) -> Vector:
        """The outputs at the end."""
        at = self.last
        return np.array(self._observed(self.stop, at.x, at.z, self.u, self.p, at.m)).ravel()


@dataclass(frozen=True, eq=False)
class Stretch:
    """One stretch without events."""

    chain: Chain
    regime: Regime
    x: Vector
    z: Vector
    m: Vector
    start: float
    end: float

    def carry(self, stops: Vector, x: Vector, *, parameters: bool = True) -> Iterator[tuple[float, Vector, Vector]]:
        """At the stops, which are in order and inside, and at the end: the time, all variables, and the variations."""
        c = self.chain
        if self.end <= self.start:
            return
        variation, scale = c.variation(self.regime), c.compiled.nominal_x[:, None]
        way = self._way([*stops.tolist(), self.end], variation)
        for t, w, there in variation.carry(way, x / scale, c.temper, c.native, parameters=parameters):
            yield t, w * variation.slopes.scale, there * scale

    def forward(self, x: Vector) -> Vector:
        """Variations of the states at the end from those at the start, and from the parameters."""
        found = x
        for *_, there in self.carry(np.zeros(0), x):
            found = there
        return found

    def parts(self, ends: Vector) -> Iterator[tuple[float, Vector]]:
        """For each part of the stretch its end, and the map of variations of the states over it."""
        unit = np.eye(len(self.chain.compiled.nominal_x))
        here = self
        for end in ends.tolist():
            part = replace(here, end=end)
            for t, w, through in part.carry(np.zeros(0), unit, parameters=False):
                yield t, through
                here = replace(here, start=t, x=w[: len(unit)], z=w[len(unit) :])

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Derivatives with respect to the states at the start, and to the parameters, of what has `rows` at the end."""
        c = self.chain
        if self.end <= self.start:
            return rows, np.zeros((len(rows), c.count))
        variation, scale = c.variation(self.regime), c.compiled.nominal_x
        rows, total = variation.back(self._way([self.end], variation), rows * scale, c.temper, c.native)
        return rows / scale, total

    def _way(self, ends: Sequence[float], variation: Variation) -> Way:
        c = self.chain
        w = np.concatenate([self.x, self.z]) / variation.slopes.scale
        return Way(self.start, ends, w, (np.concatenate([c.u, c.p]), self.m), c.tolerance)
