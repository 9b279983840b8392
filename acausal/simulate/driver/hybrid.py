"""Runs with state events: integration while modes hold, and the events in between."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.driver.agenda import Position, Schedule, Stretch
from acausal.simulate.driver.event_loop import EventLoop, LoopEvent, suits_event_loop
from acausal.simulate.driver.loop_memory import LoopMemory
from acausal.simulate.driver.missed.missed_events import MissedEvents
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.errors import accumulated, unsettled
from acausal.simulate.events.guards import Cause, Guards, Moment, same_instant
from acausal.simulate.events.iteration import Happened, Iteration, Jump, Jumped
from acausal.simulate.events.location.arrival import Arrival
from acausal.simulate.events.location.search import Search
from acausal.simulate.events.loop_equations import compiled_program
from acausal.simulate.events.regime import Regime
from acausal.simulate.events.resolution.guard_arguments import guard_arguments
from acausal.simulate.events.resolution.patience import MOST_LOOKS
from acausal.simulate.events.resolution.phases import may_pulse, shows_pulses
from acausal.simulate.events.rest import Bounces
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances
from acausal.simulate.start.initialize import Start

Integrate = Callable[[Regime, Segment], Piece]
_log = logging.getLogger(__name__)
# A guard creeps if its rate is less than this fraction of its rate beyond zero.
_CREEP = 1e-3
# The most successive events whose guard was never larger than its error: 20 of a relation, there and back.
_MOST_VAGUE = 40
# The number of successive events whose guard was never larger than its error before errors of states relax, after which
# each of them must have advanced the run by this fraction on average.
_MOST_SMALL, _LEAST_ADVANCE = 400, 1e-6
# The number of stretches in which the compiled loop may have missed a steep function, after which it is not used with
# the same relations any more.
_MOST_UNCLEARED = 2
# The cause of an event at which nothing changes: causes without text are not listed in the result.
_NO_EVENT = (Cause(""),)
# How often a recorded integration is continued until its guard is passed, each time by the time that its rate predicts
# times this factor.
_MOST_TURNS, _OVERSHOOT = 8, 1.5
# The cost of an interpreted call of a one-step method, with its share of guards and events in Python, in evaluations: a
# millisecond. By it a run of 4000 switchings is compiled on its way, after which they take 10 us each.
_CALL_OVERHEAD = 600.0

_UNSAMPLED = (
    f"looked at {MOST_LOOKS} times in a hundredth of the run in vain, and from then on only where steps of the solver "
    "end, between which it may be passed there and back; max_step bounds them"
)
_UNFACTORED = (
    "a polynomial, or a product with kinks, of so many factors that what it does within one step may be missed; "
    "max_step bounds the steps"
)


@dataclass(frozen=True, eq=False)
class Passage:
    """An executed event: the guard that was reached (None at a known instant), and the outcome."""

    time: float
    left: Moment
    guard: int | None
    happened: Happened
    edge: bool = False
    """Whether it is at the start or the end of the run."""


@dataclass
class Hybrid:
    """The dynamics of a model with state events; see `driver.Dynamics`."""

    problem: Problem
    solver: Solver
    recorder: Recorder
    integrate: Integrate
    explore: Integrate
    tolerances: Tolerances
    template: Segment
    span: float
    traced: bool = False
    missed_events: MissedEvents | None = None
    """The search after the compiled loop, which stops at guards by itself; None if there are no steep functions."""
    jumped: Jumped | None = None
    """Finds where delayed signals are read after an event has changed their delays."""
    memories: dict[int, LoopMemory] = field(default_factory=dict)
    """Memory of compiled loops by the `id` of their common model, shared by equal systems of a run."""
    moment: Moment | None = None
    notes: list[str] = field(default_factory=list)
    passages: list[Passage] = field(default_factory=list)
    terminated: str | None = None
    pace: float = 0.0
    history: list[tuple[float, Regime]] = field(default_factory=list)
    _gap: float = np.inf
    _vague: dict[int, int] = field(default_factory=dict)
    _small: dict[int, list[float]] = field(default_factory=dict)
    _uncleared: dict[bytes, int] = field(default_factory=dict)
    _loop: EventLoop | None = None
    _program: tuple[Regime, Library[EventLoopProgram]] | None = None
    """A regime and its compiled code, kept once it is available."""

    def __post_init__(self) -> None:
        self.guards = Guards(self.problem, self.tolerances, self.span)
        self.iteration = Iteration(self.problem, self.guards, self.jumped)
        self.bounces = Bounces(self.problem, self.guards, self.span)
        self.search = Search(self.guards, self.solver, self._explored, self.span)
        # delayed signals are recorded by integrations that continue to the end of a segment
        self.is_delayed = bool(self.problem.compiled.delays)

    def _explored(self, regime: Regime, segment: Segment) -> Piece:
        """`explore`, counted: evaluations decide when the event loop is compiled."""
        piece = self.explore(regime, segment)
        if self.solver.native == "integrator":
            evaluations = piece.counters.get("rhs_evaluations", 0.0) + _CALL_OVERHEAD
            regime.problem.native.interpreted(f"{self.solver.name}, events", evaluations)
        return piece

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """Execute the event at the start of the run, with modes `m` of the start values.

        `initial()` is true, unless `flag` is None: in a run that continues with given states.
        """
        moment = Moment(start.x, start.z, m.copy(), Regime(self.problem))
        arguments = guard_arguments(self.problem.compiled)
        for relation in () if arguments is None or self.template.max_step is not None else arguments.unsampled:
            self._note(f"{self.guards.texts[relation]}: {_UNFACTORED}")
        self.bounces.begin(t)
        happened = self.iteration.settle(t, moment, m, flag=flag)
        self.passages.append(Passage(t, moment, None, happened, edge=True))
        self._take(happened, t)

    def regime_at(self, t: float) -> Regime:
        """The regime in force just after a time."""
        return next(regime for start, regime in reversed(self.history) if start <= t)

    @property
    def reached(self) -> Moment:
        """The moment that the run has reached."""
        assert self.moment is not None, "a run begins before its first stretch"
        return self.moment

    @property
    def equations(self) -> Problem:
        """The equations that are integrated at the moment."""
        return self.reached.regime.problem

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """Take over values that were computed elsewhere."""
        self.moment = Moment(x, z, m, self.reached.regime)

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """The compiled event loop over a schedule of this run, or None if it does not suit."""
        if self._loop is not None and self._loop.over(schedule) is not None:
            return self._loop
        if not self._suits_event_loop:
            return None
        parts = self.problem, self.recorder, schedule, self.template, self.span, self.bounces, self._causes
        clears = self._clears if self.missed_events is not None or may_pulse(self.problem.compiled) else None
        kind = id(self.problem.compiled.common)
        self._loop = EventLoop(*parts, self._trace if self.traced else None, clears, self.memories.get(kind))
        self.memories[kind] = self._loop.memory
        return self._loop

    @cached_property
    def _suits_event_loop(self) -> bool:
        return suits_event_loop(self.problem, self.solver)

    def _trace(self, passed: LoopEvent) -> None:
        """Record an event of the compiled loop as a passage."""
        now = self.reached

        def moment(x: Vector, m: Vector) -> Moment:
            return replace(now, x=x, m=m)

        jumps = tuple(Jump(moment(x, m), applied, advances) for x, m, applied, advances in passed.jumps)
        happened = Happened(moment(*passed.right), jumps=jumps)
        self.passages.append(Passage(passed.time, moment(*passed.left), passed.guard, happened))

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled code for the present regime, if there is any."""
        regime = self.reached.regime
        if regime.holds or self._must_search(self.reached.m):
            return None
        if self._program is None or self._program[0] is not regime:
            found = compiled_program(regime, self.template, self.solver.name)
            if found is None:  # compilation does not pay yet
                return None
            self._program = regime, found
        return self._program[1]

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated: from the last point that was reached, with the later `times`."""
        here = self.recorder.time if self.recorder.segments else self.template.start
        moment = self.reached
        return replace(self.template, start=here, times=times[times > here], x=moment.x, z=moment.z, p=moment.m)

    def _causes(self, relations: list[int], clauses: list[int]) -> tuple[Cause, ...]:
        """Causes of an event: texts and source locations of these relations and clauses."""
        acting = (self.problem.compiled.state_events.clauses[k] for k in clauses)
        return (*(self.guards.causes[k] for k in relations), *(Cause(c.text, c.where, c.component) for c in acting))

    def enter(self, stretch: Stretch) -> None:
        """Execute the event at the start of a stretch."""
        moment, here = self.reached, stretch.start
        changed = moment.m.copy()
        changed[: len(stretch.modes)] = stretch.modes
        now = Moment(moment.x, moment.z, changed, moment.regime)
        if self.recorder.count and stretch.opens:  # at the start of the run, `begin` has done so
            now = self.iteration.flipped(now, self.guards.exact(here, moment))
        happened = self.iteration.settle(here, now, moment.m, samples=stretch.samples)
        self.passages.append(Passage(here, moment, None, happened))
        self._record_start(here, self._take(happened, here), happened)
        self._gap = np.inf  # lengths of earlier stretches predict nothing from here on

    def advance(self, stretch: Stretch, position: Position) -> float | None:
        """Integrate to the next event and execute it, or to the end of the stretch; see `driver.Dynamics`."""
        here, moment, times = position.here, self.reached, stretch.times
        if position.arrived:
            self.search.pace = self.pace
            self.search.relax()
            return self._execute(here, moment)
        if not position.fresh:
            times = times[times > here + 1e-13 * max(self.span, abs(here))]
        if not len(times):
            return None
        rest = self._end_of_flights(here, moment, float(times[-1]))
        if rest is not None:
            times = np.append(times[times < rest], rest)
        segment = replace(
            self.template,
            start=here,
            times=times,
            x=moment.x,
            z=moment.z,
            p=moment.m,
            first=0.0 if self.solver.multistep else self.pace,
            max_step=stretch.longest,
        )
        stop = self._integrated(segment, moment)
        if stop.time is None:
            self.moment = Moment(stop.x, stop.z, moment.m, moment.regime)
            return None if rest is None else self._end_flights(rest)
        self._gap = max(stop.time - here, self._gap / 8 if np.isfinite(self._gap) else 0.0)
        here = stop.time
        self.moment = Moment(stop.x, stop.z, moment.m, moment.regime)  # where an equation may turn out to be singular
        left = self.iteration.consistent(here, self.moment)
        self._record(np.array([here]), left.x[:, None], left.z[:, None], left, {})
        return self._execute(here, left)

    def _execute(self, here: float, left: Moment) -> float:
        """Execute the state event at this instant, up to which all is recorded; returns the instant."""
        fired = self.guards.fired(here, left)
        happened = self.event(here, left, fired)
        self.passages.append(Passage(here, left, int(np.argmax(fired)), happened))
        self._record_start(here, self._take(happened, here), happened)
        return here

    def _last_same(self, t: float) -> float:
        """The last instant that counts as the same as this one."""
        return float(t + same_instant(self.span, t))

    def _end_of_flights(self, here: float, moment: Moment, end: float) -> float | None:
        """When the flights of something at rest would have ended, if that is before `end` [s]; otherwise None."""
        while (due := self.bounces.due(moment.regime)) is not None and due[0] <= self._last_same(here):
            del self.bounces.resting[due[1]]  # noted at its last impact already
        return due[0] if due is not None and due[0] <= end else None

    def _end_flights(self, t: float) -> float:
        """Record the end of flights as an event; nothing jumps, as their heights were below the noise already."""
        found = [k for k, rest in self.bounces.resting.items() if rest.time <= self._last_same(t)]
        ended = [self.bounces.resting.pop(k) for k in found]
        causes, notes = tuple(rest.cause for rest in ended), tuple(rest.note for rest in ended)
        happened = Happened(self.reached, causes, notes=notes)
        self._record_start(t, self._take(happened, t), happened)
        return t

    def end(self, t: float, samples: Vector) -> None:
        """Execute the event at the end of the run: guards that are reached, `terminal()`, perhaps a sample."""
        if self.moment is not None:
            self._finish(t, self.moment)
        if self.moment is None or not ("terminal" in self.iteration.flag_names or samples.any()):
            return
        left = self.moment
        happened = self.iteration.settle(t, left, left.m, samples=samples, flag="terminal")
        self.passages.append(Passage(t, left, None, happened, edge=True))
        # a discrete equation that reads a sample is no cause, but may have changed something
        if happened.causes or not _stays(left, happened.moment):
            self._record_start(t, self._take(happened, t), happened)

    def _finish(self, t: float, left: Moment) -> None:
        """Execute the event of guards that are zero within their noise at the end of the run.

        Nothing follows that would show whether they cross zero, and rounding errors decide whether a solver has located
        the crossing just before the end.
        """
        if not left.regime.active_set.owners:
            return
        g, rate, noise = self.guards.state(t, left)
        relations = np.array([side < 0 for _, side in left.regime.active_set.owners], dtype=bool)
        fired = relations & (np.abs(g) <= noise) & (rate < -noise)
        if fired.any():
            happened = self.event(t, left, fired)
            self.passages.append(Passage(t, left, int(np.argmax(fired)), happened, edge=True))
            self._record_start(t, self._take(happened, t), happened)
        self._note_stuck(t, left, relations & (np.abs(g) <= noise) & (rate <= 0.0), rate)

    def _note_stuck(self, t: float, left: Moment, close: Truth, rate: Vector) -> None:
        """Note guards that the run has approached without passing them if the equations beyond them lead away.

        A tank that drains with the square root of its level is empty within the tolerance, and its rate is almost zero.
        Rounding errors decide whether steps of the solver go below zero, where the model continues differently.
        """
        watched = self.problem.compiled.state_events.watched
        for k in np.flatnonzero(close).tolist():
            relation = left.regime.active_set.owners[k][0]
            if relation in watched:
                continue
            beyond = self.iteration.consistent(t, self.iteration.flipped(left, np.arange(len(close)) == k))
            rates, noises = self.guards.rates(t, beyond)
            if rates[k] > noises[k] and -rate[k] < _CREEP * rates[k]:
                text = self.guards.texts[relation]
                self._note(
                    f"{text}: zero within the tolerance at the end, and the equations beyond it lead away from it"
                )

    def event(self, t: float, left: Moment, fired: Truth) -> Happened:
        """Flip the relations whose guards have fired, and iterate."""
        relations = [left.regime.active_set.owners[k][0] for k in np.flatnonzero(fired)]
        happened = self.iteration.settle(t, self.iteration.flipped(left, fired), left.m)
        held, at_rest = self.bounces.come_to_rest(t, left, happened, relations)
        if at_rest:
            after = self.iteration.settle(t, self.iteration.consistent(t, held), happened.moment.m)
            changed = tuple(dict.fromkeys((*happened.changed, *after.changed)))
            notes = [rest.note for rest in at_rest if rest.time <= self._last_same(t)]
            causes, notes = (*happened.causes, *after.causes), [*happened.notes, *notes, *after.notes]
            happened = replace(after, causes=causes, changed=changed, notes=tuple(notes))
        self.bounces.count_events(t, relations)
        if self.bounces.endless:
            names = [self.guards.texts[k] for k in self.bounces.endless]
            raise accumulated(self.problem.compiled, t, self.bounces.count, names)
        if not happened.causes and _stays(left, happened.moment):
            return replace(happened, causes=_NO_EVENT)
        return replace(happened, causes=(*(self.guards.causes[k] for k in relations), *happened.causes))

    def _must_search(self, m: Vector) -> bool:
        """Whether stretches in which these relations hold have to be searched, because others were not cleared."""
        if not self._uncleared:
            return False
        return self._uncleared.get(m[self.guards.first :].tobytes(), 0) >= _MOST_UNCLEARED

    def _clears(self, segment: Segment, piece: Piece, is_in_doubt: bool) -> bool:
        """Whether a solution of the compiled loop in a stretch has missed nothing."""
        missed = self.missed_events if is_in_doubt else None
        is_clear = missed is None or missed.clears(self.problem, segment, piece)
        if is_clear and shows_pulses(self.problem, segment, piece):
            return True
        relations = segment.p[self.guards.first :].tobytes()
        self._uncleared[relations] = self._uncleared.get(relations, 0) + 1
        return False

    def _integrated(self, segment: Segment, moment: Moment) -> Arrival:
        """Integrate and record up to the next event, or to the end of a segment."""

        def record(times: Vector, piece: Piece) -> None:
            if not self.is_delayed:
                self._record(times, piece.x, piece.z, moment, piece.counters)

        if self.is_delayed and not moment.regime.active_set.owners:
            reached = Arrival(None, moment.x, moment.z)
        else:
            self.search.pace = self.pace
            reached = self.search.to_event(segment, moment, self.band(segment.start, moment), self._gap, record)
            self.pace = self.search.pace
            for relation in sorted(self.search.patience.lost):
                self._note(f"{self.guards.texts[relation]}: {_UNSAMPLED}")
            if reached.time is not None:
                self._check_size(reached, moment)
                reached = self._moved_to_end(segment, moment, reached)
        if not self.is_delayed:
            return reached
        if reached.time is not None and reached.time <= segment.start:  # at the instant of the last event
            return reached
        return self._integrate_recorded(segment, moment, reached.time)

    def _moved_to_end(self, segment: Segment, moment: Moment, reached: Arrival) -> Arrival:
        """Leave an event that coincides with the end of the segment to the event there, as rounding orders the two."""
        end = float(segment.times[-1])
        assert reached.time is not None, "an event has been reached"
        if reached.time <= segment.start or self._last_same(reached.time) < end:
            return reached
        if not self.is_delayed:
            self._record(np.array([end]), reached.x[:, None], reached.z[:, None], moment, {})
        return Arrival(None, reached.x, reached.z)

    def _integrate_recorded(self, segment: Segment, moment: Moment, event: float | None) -> Arrival:
        """Integrate to a located event, or to the end, with delayed signals recorded for later reading.

        They must be recorded over the stretch and not beyond. This integration passes the guard at a slightly different
        instant: if it ended before that, relations that have flipped would flip back, which would be another event.
        """
        end = float(segment.times[-1])
        until, rest, x, z = end if event is None else event, segment, moment.x, moment.z
        for turn in range(_MOST_TURNS):
            times = np.append(rest.times[rest.times < until], until)
            piece = self.integrate(moment.regime, replace(rest, times=times))
            x, z = piece.x[:, -1], piece.z[:, -1]
            ahead = 0.0
            if event is not None and turn + 1 < _MOST_TURNS:
                ahead = _OVERSHOOT * self.guards.ahead(until, replace(moment, x=x, z=z))
            if ahead > 0.0 and until == end:  # the next stretch locates it at its start
                event, ahead = None, 0.0
            keep = np.isin(times, segment.times)
            keep[-1] &= event is None or ahead > 0.0
            self._record(times[keep], piece.x[:, keep], piece.z[:, keep], moment, piece.counters)
            if ahead == 0.0:
                break
            rest = replace(rest, start=until, times=segment.times[segment.times > until], x=x, z=z, first=0.0)
            event = until = min(self._last_same(until) + ahead, end)
        return Arrival(event, x, z)

    def _check_size(self, reached: Arrival, moment: Moment) -> None:
        """Note a guard that was never larger than its error; refuse a long succession of such events."""
        self._refuse_restless(reached, moment)
        if reached.vague is None:
            self._vague.clear()
            return
        relation = moment.regime.active_set.owners[reached.vague][0]
        if relation in self.problem.compiled.state_events.watched:
            return
        text = self.guards.texts[relation]
        self._note(f"{text}: its sides never differ by more than their error; a tighter tolerance locates it better")
        self._vague[relation] = self._vague.get(relation, 0) + 1
        if self._vague[relation] > _MOST_VAGUE:
            raise unsettled(self.problem.compiled, float(reached.time or 0.0), [text])

    def _refuse_restless(self, reached: Arrival, moment: Moment) -> None:
        """Refuse a relation that flips without end and with hardly any progress in time, within errors of states.

        Near `sqrt(h)`, these relax so fast that a guard of 1e-17 is accurate, and its events are 1e-7 s apart.
        """
        if reached.small is None or reached.time is None:
            self._small.clear()
            return
        relation = moment.regime.active_set.owners[reached.small][0]
        if relation in self.problem.compiled.state_events.watched:
            return
        times = self._small.setdefault(relation, [])
        times.append(reached.time)
        if len(times) > _MOST_SMALL:
            if times[-1] - times[0] < _MOST_SMALL * _LEAST_ADVANCE * self.span:
                raise unsettled(self.problem.compiled, reached.time, [self.guards.texts[relation]])
            times.clear()

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)
            _log.warning("%s: %s", self.problem.compiled.name, note)

    def band(self, t: float, moment: Moment) -> Vector:
        """How far below zero each guard may be; shape (guards,).

        The noise if it rests at zero. If it starts below zero because of rounding errors and rises, twice its distance,
        as long as it does not turn back.
        """
        if not moment.regime.active_set.owners:
            return np.zeros(0)
        resting = self.guards.resting_band(t, moment)
        g, rate, noise = self.guards.state(t, moment)
        behind = self.guards.are_at_zero(t, g, rate, noise)
        return np.where(resting > 0.0, resting, np.where(behind, np.maximum(-2.0 * g, 0.0), 0.0))

    def _take(self, happened: Happened, t: float) -> Moment:
        self.moment = happened.moment
        self.history.append((t, happened.moment.regime))
        self.terminated = happened.terminated or self.terminated
        for note in happened.notes:
            self._note(note)
        return happened.moment

    def _record_start(self, t: float, moment: Moment, happened: Happened) -> None:
        m = moment.regime.modes(np.array([t]), moment.x[:, None], moment.z[:, None], moment.m)
        self.recorder.begin(t, moment.x, moment.z, m, happened.causes, happened.changed)

    def _record(self, times: Vector, x: Vector, z: Vector, moment: Moment, counters: dict[str, float]) -> None:
        self.iteration.check_shares(times, x, z, moment)
        self.recorder.add(times, Piece(x, z, counters), moment.regime.modes(times, x, z, moment.m))


def _stays(before: Moment, after: Moment) -> bool:
    """Whether nothing has changed at an event: it was located too early, and will be located again."""
    same = np.array_equal(before.m, after.m) and np.array_equal(before.x, after.x)
    return same and before.regime.holds == after.regime.holds
