"""Integration up to the first event, by CasADi's one-step methods.

CasADi evaluates the guards after each step and locates zero crossings on its dense output. It does not iterate after a
jump, executes only one of two crossings within a step, and its dense output is less accurate than the steps. Therefore
the transition only stops the clock: a state `flag` becomes 1, which makes all rates zero, and another state, `watch`,
holds the time that has passed. The solution is integrated from one output or mesh point to the next, so that each of
them is the end of a step. Where it has stopped, it is integrated once more to that time, and the crossing is located
among such points (`bracketing.py`). The event itself is executed outside, where modes are iterated to a fixed point.
"""

from __future__ import annotations

import contextlib
import io
import math
import threading
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.simulate.equations.arguments import arguments as steep_arguments
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.calls.raw import Kept
from acausal.simulate.equations.problem import Problem
from acausal.simulate.equations.scaled import ScaledEquations, with_values
from acausal.simulate.events.guards import LOCATED, Guards, Moment, location_error, resting_band
from acausal.simulate.events.location.bracketing import Node, first_crossing, is_clear
from acausal.simulate.events.regime import Regime
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.equations import HELD, parametric
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library, StoppingEquations
from acausal.simulate.solvers.base import bounded, pace, quadratures_at
from acausal.simulate.solvers.segment import Piece, Segment

# The cost of a mesh point in an interpreted run, including its guards and events in Python, in evaluations: 0.25 ms. By
# it a run of 4000 switchings is compiled on its way, after which they take 10 us each.
_CALL_OVERHEAD = 150.0
# The most integrators that are cached for one set of equations.
_MOST_KEPT = 128
# Mesh points of one interpreted call, and the largest ratio of the lengths of their intervals.
_TOGETHER, _MOST_UNEVEN = 4, 4.0
# Mesh points of a compiled call, which takes as long as some hundred steps.
_COMPILED_TOGETHER = 128
# No guard falls more slowly, when it is estimated how soon it is reached.
_SLOWEST = 1e-300
# How often dense output may stop the solver in an interval in which the solution has no crossing.
_MOST_STOPS = 20
# A guard within its noise is overdue if its rate would have taken it this multiple of its distance from zero.
_OVERDUE = 10.0
# The instant at which a guard has come within its noise is located to this fraction: the noise makes it vague anyway.
_ENTRY_ACCURACY = 1e-9
# A guard that starts below zero may fall to this multiple of its initial value.
_ALLOWANCE = 1.001
# Added to guards that must not stop the integration.
_NEVER = 1e300
Exactly = Callable[[Node, float], Node]
_COUNTED = ("steps", "n_steps"), ("rhs_evaluations", "n_rhs"), ("jacobians", "n_jac"), ("rejected", "n_reject")
_NAMES = ["t", "x", "z", "p", "u"], ["ode", "alg", "quad", "zero"]


@dataclass(frozen=True, eq=False)
class Stop:
    """The rows before an event, and the states and algebraic variables at its `time`.

    Without an event, `time` is None, and the rows are those of the whole segment.
    """

    piece: Piece
    times: Vector
    time: float | None
    x: Vector
    z: Vector


@dataclass
class Lingering:
    """Guards of a run that are within their noise and falling, but are never passed.

    A tank that drains with the square root of its level reaches zero with the rate zero. The solution of an explicit
    method stays above zero for ever, by less than the tolerance: each step falls as far as the last one rose.
    """

    since: dict[int, tuple[float, float]] = field(default_factory=dict)
    """For each such relation, the time at which it began to linger [s], and its distance from zero."""
    events: dict[int, int] = field(default_factory=dict)
    """For each relation, the number of events that were made because it lingered."""

    def overdue(self, owners: Sequence[tuple[int, int]], before: Node, node: Node) -> int | None:
        """The index of a guard that has lingered for too long at `node`, the end of a step; None if there is none."""
        close = (node.above <= node.near / LOCATED) & (node.above > 0.0) & (node.rate < 0.0)
        if not self.since and not close.any():
            return None
        for k, (relation, side) in enumerate(owners):
            if side >= 0 or not close[k]:
                self.since.pop(relation, None)
                continue
            inside = before.above[k] <= before.near[k] / LOCATED
            t, above = self.since.get(relation, (before.t, before.above[k]) if inside else (node.t, np.inf))
            if node.above[k] < 0.5 * above:  # it falls
                self.since[relation] = node.t, float(node.above[k])
                continue
            self.since[relation] = t, above
            if -node.rate[k] * (node.t - t) > _OVERDUE * max(above, node.above[k]):
                self.events[relation] = self.events.get(relation, 0) + 1
                return k
        return None


def _overdue(
    lingering: Lingering, owners: Sequence[tuple[int, int]], nodes: list[Node], last: bool, exactly: Exactly
) -> Node | None:
    """Where a guard came within its noise that is overdue at the last node; removes this and later nodes."""
    node = nodes[-1]
    k = lingering.overdue(owners, nodes[-2], node)
    if k is None and last:
        # no further node will show that it is overdue
        for k in (j for j, (relation, _) in enumerate(owners) if lingering.since.get(relation, (0.0,))[0] == node.t):
            if -node.rate[k] * (node.t - nodes[-2].t) > _OVERDUE * node.above[k]:
                first = _entered(nodes[-2], node, k, exactly)
                middle = exactly(first, 0.5 * (first.t + node.t))
                lingering.since.clear()
                if lingering.overdue(owners, first, middle) == k or lingering.overdue(owners, middle, node) == k:
                    nodes.pop()
                    return first
        return None
    if k is None:
        return None
    lingering.since.clear()
    j = len(nodes) - 1
    while j and nodes[j - 1].above[k] <= nodes[j - 1].near[k] / LOCATED:
        j -= 1
    if j == 0:  # it came within its noise before this stretch
        return nodes.pop()
    found = _entered(nodes[j - 1], nodes[j], k, exactly)
    del nodes[j:]
    return found


def _entered(left: Node, right: Node, k: int, exactly: Exactly) -> Node:
    """The node at which guard `k` comes within its noise between two nodes, by bisection."""
    while right.t - left.t > _ENTRY_ACCURACY * right.t and left.t < (middle := 0.5 * (left.t + right.t)) < right.t:
        node = exactly(left, middle)
        left, right = (left, node) if node.above[k] <= node.near[k] / LOCATED else (node, right)
    return right


class _Upcoming(NamedTuple):
    """The next node, or None if the solver has stopped on the way to it.

    `is_quiet`: No guard may be passed before it (`bracketing.is_clear`), and none lingers.
    """

    time: float
    node: Node | None
    is_quiet: bool


class _Nodes:
    """Integrates from node to node of one segment: ends of steps, with the guards there.

    Guards may be below zero by `band` up to the first of the segment's times, and by `later` from then on.
    """

    def __init__(self, guards: Guards, moment: Moment, segment: Segment, plugin: str) -> None:
        self.guards, self.moment, self.segment, self.plugin = guards, moment, segment, plugin
        self.step = Stepper(moment.regime, segment, plugin)
        n = moment.regime.problem.n_dynamic
        distances, rates, noises = guards.state(segment.start, moment)
        self.band, self.later = _bands(guards, segment.start, distances, rates, noises)
        self.before, self._others = guards.step, segment.x[n:]
        first = Node(segment.start, segment.x[:n], distances + self.band, rates, LOCATED * noises)
        self.first = replace(first, above=np.maximum(first.above, self.band))  # below zero by noise counts as zero

    def _judged(self, times: Vector, x: Vector) -> tuple[Vector, Vector, Vector]:
        """Distances, rates and what counts as zero at ends of steps, shapes (n, guards)."""
        if self.plugin == "rosenbrock":  # an explicit step does not relax errors
            mean_step = pace(self.segment.start, float(times[-1]), self.step.counters)
            self.guards.step = least_step(self.before, mean_step)
        states = np.hstack([x, np.tile(self._others, (len(x), 1))]) if len(self._others) else x
        distances, rates, noises = self.guards.states(times, states, self.moment)
        return distances, rates, LOCATED * noises

    def exactly(self, after: Node, t: float) -> Node:
        """The node at time `t` after another one, even if guards are passed on the way."""
        if t <= after.t:
            return after
        ((_, x),) = self.step(after, [t], np.full((1, len(self.band)), _NEVER))
        distances, rates, nears = self._judged(np.array([t]), x[None, :])
        return Node(t, x, distances[0] + self.band, rates[0], nears[0])

    def ahead(self, after: Node, ends: list[float]) -> list[_Upcoming]:
        """The nodes at the next few ends, or up to a stop before one of them."""
        # compiled code takes the same band for all of them
        alone = self.step.library is not None and self.band is not self.later
        count = 1 if alone else self.step.together(after, ends)
        bands = np.empty((count, len(self.band)))
        bands[0], bands[1:] = self.band, self.later
        points = self.step(after, ends[:count], bands)
        stop = [_Upcoming(points[-1][0], None, False)] if points[-1][0] < ends[len(points) - 1] else []
        count = len(points) - len(stop)
        if not count:
            return stop
        t, x = (np.array(v) for v in zip(*points[:count], strict=True))
        distances, rates, nears = self._judged(t, x)
        # with the bands of each interval, and of the next one
        right, left = distances + bands[:count], np.vstack([after.above, distances + self.later])
        before = np.vstack([after.rate, rates[:-1]]), np.vstack([after.near, nears[:-1]])
        is_quiet = is_clear(np.diff(t, prepend=after.t), (left[:-1], *before), (right, rates, nears))
        is_quiet &= ~((left[1:] <= nears / LOCATED) & (left[1:] > 0.0) & (rates < 0.0)).any(axis=1)
        nodes = (Node(*each) for each in zip(ends, x, right, rates, nears, strict=False))
        return [*map(_Upcoming, ends, nodes, is_quiet.tolist()), *stop]

    def after_first_time(self, node: Node) -> Node:
        """A node with the bands that hold after the first of the segment's times."""
        if self.band is not self.later:
            node = replace(node, above=node.above - self.band + self.later)
            self.band = self.later
        return node

    def crossing(
        self, here: Node, upcoming: _Upcoming, end: float, instant: float, stops: int
    ) -> tuple[Node, Node | None]:
        """The next node on the way to `end`, and the node of an event before it or at it, if any.

        `instant`: Two times coincide if they are no farther apart [s].
        `stops`: How often dense output has shown a crossing on the way.
        """
        t, reached, is_quiet = upcoming
        if reached is not None:
            there = reached
        else:  # a guard was passed on dense output; a step that ends there shows whether it is passed
            there = self.exactly(here, t if t - here.t > instant and stops < _MOST_STOPS else end)
        event = None if is_quiet else first_crossing(here, there, instant, self.exactly)
        if event is None and there.t < end and ((there.above <= there.near) & (there.rate < 0.0)).any():
            event = there
        last = min(self.step.end, end)
        if (
            event is None and reached is None and there.t < last
        ):  # the end of the step in which dense output has shown it
            here, there = there, self.exactly(there, last)
            event = first_crossing(here, there, instant, self.exactly)
        return there, event


def integrate_to_event(guards: Guards, moment: Moment, segment: Segment, plugin: str, lingering: Lingering) -> Stop:
    """Integrate one segment of an ODE until a guard is reached, with `plugin`, "rosenbrock" or "erk".

    Raises RuntimeError if the solver cannot continue.
    """
    problem, ends = moment.regime.problem, segment.times.tolist()
    instants = location_error(guards.span, segment.times).tolist()
    solution = _Nodes(guards, moment, segment, plugin)
    here, nodes = solution.first, [solution.first]
    event: Node | None = None
    upcoming: list[_Upcoming] = []
    try:
        for index, (end, instant) in enumerate(zip(ends, instants, strict=True)):
            stops, is_quiet = 0, False
            while event is None and here.t < end:
                upcoming = upcoming or solution.ahead(here, ends[index:])
                first = upcoming.pop(0)
                stops, is_quiet = stops + (first.node is None), first.is_quiet
                there, event = solution.crossing(here, first, end, instant, stops)
                here = there if event is None else event
            if event is not None and end == segment.times[-1] and end - event.t <= instant / LOCATED:
                # it counts as an event of the end, or is found where the next stretch starts
                here, event = replace(event, t=end), None
            if event is not None:
                break
            here = solution.after_first_time(here)
            nodes.append(here)
            if is_quiet and not lingering.since:
                continue
            owners = moment.regime.active_set.owners
            event = _overdue(lingering, owners, nodes, end == segment.times[-1], solution.exactly)
            if event is not None:
                here = event
                break
    except Interrupted as stop:
        rows = [n.x for n in nodes[1:]]
        stop.piece = _stop(problem, segment, rows, None, rows[-1], solution.step.counters) if rows else None
        raise
    finally:
        problem.native.interpreted(f"{plugin}, events", solution.step.interpreted)
        guards.step = solution.before
    return _stop(problem, segment, [n.x for n in nodes[1:]], event, here.x, solution.step.counters)


def least_step(before: float, here: float) -> float:
    """The step over which errors have relaxed: the smaller one of the previous stretch and of this one so far [s]."""
    return min(before, here) if before and here else before or here


def _stop(
    problem: Problem, segment: Segment, rows: list[Vector], event: Node | None, last: Vector, counters: dict[str, float]
) -> Stop:
    """The rows that were solved, completed with quadratures and discrete variables."""
    times = segment.times[: len(rows)]
    time = None if event is None else event.t
    if time is not None and len(times):  # an event at an output time up to rounding errors
        time = max(time, float(times[-1]))
    x = np.array(rows).reshape(-1, problem.n_dynamic).T
    ends = times if time is None else np.append(times, time)
    quadratures = quadratures_at(problem, replace(segment, times=ends))
    discrete = segment.x[len(segment.x) - problem.compiled.discretes :]
    states = np.vstack([x, quadratures[:, : len(times)], np.tile(discrete[:, None], (1, len(times)))])
    piece = Piece(states, np.zeros((0, len(times))), counters)
    return Stop(piece, times, time, np.concatenate([last, quadratures[:, -1], discrete]), np.zeros(0))


def _bands(guards: Guards, t: float, g: Vector, rate: Vector, noise: Vector) -> tuple[Vector, Vector]:
    """How far below zero each guard may be up to the first mesh point, and from then on; shapes (guards,).

    By the noise if it rests there. If it starts below zero because of rounding errors and rises, by its distance, but
    not when it comes back: the event would be late by that, and with every hop by more.
    """
    resting = resting_band(g, rate, noise)
    below = (resting == 0.0) & guards.are_at_zero(t, g, rate, noise)
    return np.where(below, np.maximum(-_ALLOWANCE * g, resting), resting), resting


class Stepper:
    """Integrates any intervals of a stretch, compiled or interpreted, and counts the work."""

    def __init__(self, regime: Regime, segment: Segment, plugin: str) -> None:
        self.regime, self.segment, self.plugin = regime, segment, plugin
        self.library = compiled_program(regime, segment, plugin)
        self.first = segment.first
        self.end = math.inf
        """The end of the step in which dense output has passed a guard [s]; a guess in interpreted runs."""
        self._stops = 0
        self.counters: dict[str, float] = {}
        # the last number is the start of an interval, which is set before each call
        self._numbers = regime.problem.numbers(segment.p, segment.x, segment.start)
        self.interpreted = 0.0
        self._integrators: dict[tuple[float, ...], Kept] = {}
        if self.library is None:
            self._form, self._own, self._constants = _interpreted(regime)
        else:
            self._constants = regime.constants(self.library)

    def together(self, after: Node, ends: Sequence[float]) -> int:
        """How many of these times one call integrates to.

        None after a guard is about to be reached: nodes after the stop would be wasted.
        """
        if self.segment.step or len(ends) < (_TOGETHER if self.library is None else 2):
            return 1
        ends = ends[: _TOGETHER if self.library is None else _COMPILED_TOGETHER]
        falls = after.above + after.rate * (ends[-1] - after.t) < 0.0
        if self.library is not None:  # it checks rows inside of steps by itself (`native/rows.c`)
            ahead = np.maximum(after.above[falls], 0.0) / np.maximum(-after.rate[falls], _SLOWEST)
            return max(bisect(ends, after.t + ahead.min(initial=np.inf)), 1)
        lengths = [b - a for a, b in zip((after.t, *ends), ends, strict=False)]
        return _TOGETHER if max(lengths) <= _MOST_UNEVEN * min(lengths) and not falls.any() else 1

    def __call__(self, after: Node, ends: Sequence[float], bands: Vector) -> list[tuple[float, Vector]]:
        """Integrate to `together` many times; the times, and the dynamic states there.

        If a guard falls below zero by more than its band, the last of them is the time of that.

        Raises RuntimeError if the solver cannot continue.

        `bands`: How far below zero guards may be in each interval; shape (times, guards).
        """
        problem, segment = self.regime.problem, self.segment
        n = problem.n_dynamic
        x0 = np.concatenate([after.x / problem.scale_x, [0.0, 0.0]])
        length = ends[-1] - after.t
        if self.library is not None:
            numbers = self._numbers
            numbers[-1] = after.t
            p = np.concatenate([self._constants, numbers, bands[0]])
            first = 0.0 if segment.step else self.first
            sizes = segment.tolerances.relative, segment.tolerances.absolute, segment.step or 0.0
            rows, _, stats = self.library.run(x0, np.zeros(0), p, np.array(ends) - after.t, *sizes, first)
            following, self.end = stats["next"], after.t + stats["end"]
        else:
            rows, stats = self._interpreted(x0, np.array([after.t, *ends]), bands)
            steps = float(stats["n_steps"])
            following = length / steps if steps > len(ends) else 2.0 * length / len(ends)
        if not np.isfinite(rows).all():
            raise RuntimeError("the solution is not finite")
        for name, place in _COUNTED:
            self.counters[name] = self.counters.get(name, 0.0) + float(stats[place])
        states = rows[:, :n] * problem.scale_x
        if rows[-1, n + 1] > 0.5:  # stopped by a guard
            k = int(np.argmax(rows[:, n + 1] > 0.5))
            start = ends[k - 1] if k else after.t
            passed = float(rows[k, n] - rows[k - 1, n]) if k else float(rows[k, n])
            stop = min(max(start + passed, start), ends[k])
            if self.library is None:
                self.end = stop + (4.0**self._stops - 1.0) * (stop - start)
                self._stops += 1
            return [*zip(ends[:k], states[:k], strict=True), (stop, states[k])]
        self.first, self._stops = following, 0
        return list(zip(ends, states, strict=True))

    def _interpreted(self, x0: Vector, times: Vector, bands: Vector) -> tuple[Vector, dict[str, Any]]:
        """Integrate intervals of length 1 with a cached integrator, one for each power of four of the first step."""
        lengths = np.diff(times)
        bounds = [
            0.0 if bound is None else 1.0 / max(1, math.ceil(float(lengths.max()) / bound - 1e-9))
            for bound in (self.segment.step, self.segment.max_step)
        ]
        first = 0.0
        if not self.segment.step and self.first > 0.0:
            first = 4.0 ** -min(max(round(math.log(float(lengths[0]) / self.first, 4.0)), 0), 15)
        key = float(len(lengths)), first, *bounds
        if key not in self._integrators:
            self._integrators[key] = self._kept(key)
        p, u = (
            np.concatenate([self._constants, self._numbers[:-1]]),
            np.column_stack([np.arange(0.0, len(lengths)), times[:-1], lengths, bands]),
        )
        (found,), stats = self._integrators[key]({"x0": x0, "p": p, "u": u}, ("xf",))
        self.interpreted += float(stats["n_rhs"]) + _CALL_OVERHEAD * len(lengths)
        return found, stats

    def _kept(self, key: tuple[float, ...]) -> Kept:
        """The integrator for these step sizes, shared by all runs of a thread."""
        segment = self.segment
        settings = self.plugin, segment.tolerances, segment.most_steps, *key, threading.get_ident()
        cached = self._own.integrators
        if settings not in cached:
            if len(cached) >= _MOST_KEPT:
                cached.clear()
            sizes: dict[str, float] = dict(zip(("step0", "step_size", "max_step_size"), key[1:], strict=True))
            cached[settings] = self._made(np.arange(1.0, key[0] + 1.0), sizes)
        return cached[settings]

    def _made(self, ends: Vector, sizes: dict[str, float]) -> Kept:
        settings: dict[str, Any] = {
            **_settings(self.segment),
            # few different values, as each needs an integrator of its own
            "max_num_steps": 20_000 * 4 ** max(0, math.ceil(math.log(self.segment.most_steps / 20_000, 4.0))),
        }
        settings = {k: v for k, v in settings.items() if k not in sizes} | {k: v for k, v in sizes.items() if v > 0.0}
        # CasADi warns at every construction that events are experimental
        with contextlib.redirect_stderr(io.StringIO()):
            return self._form.integrator(
                self.plugin, self._own.dae, ends, {**settings, "transition": self._own.transition}
            )


def compiled_program(regime: Regime, segment: Segment, plugin: str) -> Library[EventLoopProgram] | None:
    """The integrator of a regime as compiled C, if it is compiled already or compilation pays; otherwise None."""
    problem = regime.problem

    def instructions() -> int:
        functions = (
            regime.active_set.watch,
            regime.active_set.rates.function,
            problem.compiled.events.round,
            regime.active_set.relaxed,
        )
        return sum(int(f.n_instructions()) for f in functions)

    return problem.native.stopping(
        plugin,
        _settings(segment),
        lambda: stopping_equations(regime, problem.native.zeros),
        lambda: (regime.active_set.watch, *_steep_search(regime)),
        problem.n_dynamic + 2,
        instructions,
    )


def _steep_search(regime: Regime) -> tuple[Any, ...]:
    """The function by which the compiled event loop searches steps for steep functions, if there are any."""
    known = steep_arguments(regime.compiled)
    return () if known is None else (known.along(),)


def _settings(segment: Segment) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "reltol": segment.tolerances.relative,
        "abstol": segment.tolerances.absolute,
        "max_num_steps": 10**6,
        "event_tol": 1e-13,
        "max_events": 3,
        **bounded(segment),
    }
    return {**settings, "step_size": segment.step} if segment.step else settings


@dataclass(frozen=True, eq=False)
class _Interpreted:
    """The ODE with a stop watch and a stop flag, and the transition that sets the flag.

    Its time is `stretched` (`stopping_equations`), its parameters are `[c, m, d]`, where c depends on parameters and
    inputs alone, and is empty if these are numbers. A step ends where the controls of an interval change.
    """

    dae: Any
    transition: Any
    constants: BufferedFunction | None
    integrators: dict[tuple[Any, ...], Kept] = field(default_factory=dict)


_MADE: WeakKeyDictionary[ScaledEquations, _Interpreted] = WeakKeyDictionary()


def _interpreted(regime: Regime) -> tuple[ScaledEquations, _Interpreted, Vector]:
    """The scaled equations of a regime, the functions derived from them, and their constants c.

    Regimes that hold relations have scaled equations of their own, so these serve as keys.
    """
    problem = regime.problem
    form = problem.scaled
    if form.is_shared:
        found = _MADE.get(form)
        if found is None:
            made = stopping_equations(regime, problem.native.zeros, stretched=True)
            found = _MADE[form] = _Interpreted(made.dae, made.transition, BufferedFunction(made.constants))
        assert found.constants is not None, "made just so"
        (constants,) = found.constants(problem.p, problem.u)
        if np.isfinite(constants).all():
            return form, found, constants
        form = with_values(problem.compiled, problem.p, problem.u)
    if form not in _MADE:
        made = stopping_equations(regime, (), stretched=True, values=(problem.p, problem.u))
        _MADE[form] = _Interpreted(made.dae, made.transition, None)
    return form, _MADE[form], np.zeros(0)


def stopping_equations(
    regime: Regime, zeros: Sequence[int], *, stretched: bool = False, values: tuple[Vector, Vector] | None = None
) -> StoppingEquations:
    """The ODE with a stop watch and a stop flag, and the transition that sets the flag.

    The parameters of the DAE are `[h, shift, band]`, where h depends on `[c, m, d]` alone, with c as in
    `native/equations.py`. "judged" is `(t, x, h, errors of x) -> (g, dg/dt, noise)` of all guards.

    If the DAE is `stretched`, its parameters are `[c, m, d]`, and intervals of its time have the length 1. Each has
    controls of its own: its start in that time and in the time of the model, its length in the latter, and the bands.
    With `values` of p and u, these are numbers, and c is empty. Parameters at `zeros` are zero regardless of p.
    """
    compiled = regime.compiled
    n, nq, nm = compiled.n_dynamic, compiled.quadratures, compiled.n_modes
    scale = ca.DM(regime.problem.scale_x)
    t, x, z = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("z", 0)
    origin, length = ca.SX.sym("origin"), ca.SX.sym("length")
    p, u = ca.SX.sym("p", len(compiled.parameters)), ca.SX.sym("u", len(compiled.inputs))
    numbers = ca.SX.sym("numbers", nm + compiled.discretes + 1)
    m, d, shift = ca.vertsplit(numbers, [0, nm, nm + compiled.discretes, nm + compiled.discretes + 1])
    with_zeros = ca.SX(p)
    for k in zeros:
        with_zeros[k] = 0
    time = shift + (t - origin) * length if stretched else t + shift
    given = (u, with_zeros) if values is None else (ca.SX(values[1]), ca.SX(values[0]))
    arguments = (time, ca.vertcat(x * scale, ca.SX(nq, 1), d), z, *given, m)
    ode, guards = ca.densify(compiled.rhs(*arguments)[0])[:n] / scale, ca.densify(regime.active_set.watch(*arguments))
    band = ca.SX.sym("band", guards.numel())
    if stretched:
        (ode, guards), symbols, constants = parametric([ode, guards], p, u)
        p, u = ca.vertcat(symbols, m, d), ca.vertcat(origin, shift, length, band)
        return StoppingEquations(*_stopped((t, x, z, p, u), ode, guards + band, length), constants, ())
    at, states, errors = ca.SX.sym("at"), ca.SX.sym("states", n + nq), ca.SX.sym("errors", n + nq + compiled.discretes)
    here = at, ca.vertcat(states, d), z, *given, m
    rates = regime.active_set.rates.function(*here, errors, z)[:2]
    judged = [ca.densify(e) for e in (regime.active_set.watch(*here), *rates)]
    shared: Any = ca.cse([ode, guards, *judged])
    (ode, guards, *judged), symbols, constants = parametric(shared, p, u)
    # once more with modes as parameters: most equations of clutches depend on nothing else
    parameters, none = ca.vertcat(symbols, m, d), ca.SX(0, 1)
    shared = ca.cse([ode, guards, *judged])
    (ode, guards, *judged), kept, held = parametric(shared, parameters, none, HELD)
    dae, transition = _stopped((t, x, z, ca.vertcat(kept, shift, band), none), ode, guards + band, ca.SX(1))
    whole = ca.vertcat(states, ca.SX.sym("unused", compiled.discretes))
    events = ca.Function("judged", [at, whole, kept, errors], judged, {"cse": True}), compiled.events.round
    events = *events, regime.active_set.relaxed, *_steep_search(regime)
    return StoppingEquations(dae, transition, constants, events, held)


def _stopped(inputs: tuple[Any, ...], ode: Any, zero: Any, speed: Any) -> tuple[Any, Any]:
    """The DAE of `(t, x, z, p, u)` with a stop watch of this `speed` and a stop flag, and its transition."""
    t, x, z, p, u = inputs
    watch, flag, none = ca.SX.sym("watch"), ca.SX.sym("flag"), ca.SX(0, 1)
    state = ca.vertcat(x, watch, flag)
    rates = ca.vertcat((1 - flag) * speed * ode, (1 - flag) * speed, 0)
    # no guard fires once it has stopped: several that are reached at one instant would, one after the other
    results = [rates, none, none, ca.densify(zero + _NEVER * flag)]
    dae = ca.Function("dae", [t, state, z, p, u], results, *_NAMES, {"cse": True})
    given = {"index": ca.SX.sym("index"), "t": t, "x": state, "z": z, "p": p, "u": u}
    post = {"post_x": ca.vertcat(x, watch, 1), "post_z": z}
    transition = ca.Function(
        "stop", [given[n] for n in ca.event_in()], [post[n] for n in ca.event_out()], ca.event_in(), ca.event_out()
    )
    return dae, transition
