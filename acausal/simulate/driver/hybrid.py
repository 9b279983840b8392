"""A run with events: integration while the modes hold, and the events between."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from acausal.arrays import Truth, Vector
from acausal.simulate.driver.agenda import Place, Schedule, Stretch
from acausal.simulate.driver.event_loop import EventLoop, LoopEvent, suits_event_loop
from acausal.simulate.driver.loop_memory import LoopMemory
from acausal.simulate.driver.missed_events import MissedEvents
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.errors import accumulated, unsettled
from acausal.simulate.events.guards import Cause, Guards, Moment, as_one, resting_band
from acausal.simulate.events.iteration import Happened, Iteration, Jump, Jumped
from acausal.simulate.events.location.search import Arrival, Search
from acausal.simulate.events.location.stopping import Lingering, Stop, compiled_program, integrate_to_event
from acausal.simulate.events.regime import Regime
from acausal.simulate.events.rest import Bounces
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import pace
from acausal.simulate.solvers.recovery import RECOVERY_STEPS
from acausal.simulate.solvers.segment import Piece, Segment, Tolerances
from acausal.simulate.start.initialize import Start

Integrate = Callable[[Regime, Segment], Piece]
_log = logging.getLogger(__name__)
# A guard creeps if it is so much slower than what is behind it.
_CREEPING = 1e-3
# Events of a guard that lingers on zero, in a run.
_LINGERING = 10
# Events in a row whose guard was never as large as it may be wrong: 20 of a relation, there and back.
_VAGUE = 40
# Events in a row whose guard was never as large as by errors of states that had not relaxed, and the share of the run
# that each of them must have brought it on.
_SMALL, _RESTLESS = 400, 1e-6
# Share of the run that is integrated at once at least.
_SHORTEST = 1e-9
# Mesh points of a one-step method in a whole run, and in any stretch.
_MOST_POINTS, _FEWEST_POINTS = 64, 4
# Stretches with the same relations that were not cleared of steep functions, after which none is tried.
_MOST_UNCLEARED = 2
# So many failures must have brought a run on by this share of it.
_MANY, _PROGRESS = 100, 1e-6
# What is said where all stays as it was: a cause without words is no event of the result.
_NOTHING = (Cause(""),)
# How often an integration that is remembered goes on until a guard is passed, and how much farther than its rate says.
_TURNS, _BEYOND = 8, 1.5


@dataclass(frozen=True, eq=False)
class Passage:
    """An event as it was passed: the guard that was reached (None at a known instant), and what followed from it."""

    time: float
    left: Moment
    guard: int | None
    happened: Happened
    edge: bool = False
    """Whether it happened because the run starts or ends there."""


@dataclass
class Hybrid:
    """The events of one run."""

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
    """Searches what has been passed by a solver that stops at guards by itself; None where nothing is steep."""
    jumped: Jumped | None = None
    """Where delayed signals are read once an event has changed their delays."""
    memories: dict[int, LoopMemory] = field(default_factory=dict)
    """Memory of compiled loops by the `id` of their common model; equal systems of a run have one."""
    moment: Moment | None = None
    notes: list[str] = field(default_factory=list)
    passages: list[Passage] = field(default_factory=list)
    terminated: str | None = None
    pace: float = 0.0
    history: list[tuple[float, Regime]] = field(default_factory=list)
    _gap: float = np.inf
    _failed: bool = False
    _vague: dict[int, int] = field(default_factory=dict)
    _small: dict[int, list[float]] = field(default_factory=dict)
    _uncleared: dict[bytes, int] = field(default_factory=dict)
    _loop: EventLoop | None = None
    _program: tuple[Regime, Library[EventLoopProgram]] | None = None
    """The compiled code of a regime, which stays as it is once it is there."""

    def __post_init__(self) -> None:
        self.guards = Guards(self.problem, self.tolerances, self.span)
        self.iteration = Iteration(self.problem, self.guards, self.jumped)
        self.bounces = Bounces(self.problem, self.guards, self.span)
        self.lingering = Lingering()
        self.search = Search(self.guards, self.solver, self.explore, self.span)
        self.single_step = self.solver.native == "integrator" and not self.problem.compiled.algebraic
        # without states there is no error to choose a step by
        self.single_step &= self.problem.n_dynamic > 0
        # what is delayed is recorded by integrations that go on to their end
        self.is_delayed = bool(self.problem.compiled.delays)
        self.single_step &= not self.is_delayed

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """The event at the start of the run; `m` is what the start has decided.

        `initial()` is true, unless `flag` is None: in a run that goes on with given states.
        """
        moment = Moment(start.x, start.z, m.copy(), Regime(self.problem))
        self.bounces.begin(t)
        happened = self.iteration.settle(t, moment, m, flag=flag)
        self.passages.append(Passage(t, moment, None, happened, edge=True))
        self._say(happened, t)

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
        """What is integrated now."""
        return self.reached.regime.problem

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """The run was brought to these values from outside."""
        self.moment = replace(self.reached, x=x, z=z, m=m)

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """How compiled code passes stretches and ordinary events of this run, if it can."""
        if self._loop is not None and self._loop.over(schedule) is not None:
            return self._loop
        if not self.single_step or not suits_event_loop(self.problem, self.solver):
            return None
        parts = self.problem, self.recorder, schedule, self.template, self.span, self.bounces, self._explained
        clears = None if self.missed_events is None else self._clears
        kind = id(self.problem.compiled.common)
        self._loop = EventLoop(*parts, self._trace if self.traced else None, clears, self.memories.get(kind))
        self.memories[kind] = self._loop.memory
        return self._loop

    def _trace(self, passed: LoopEvent) -> None:
        """Keep an event of the compiled loop."""
        now = self.reached

        def moment(x: Vector, m: Vector) -> Moment:
            return replace(now, x=x, m=m)

        jumps = tuple(Jump(moment(x, m), applied, advances) for x, m, applied, advances in passed.jumps)
        happened = Happened(moment(*passed.right), jumps=jumps)
        self.passages.append(Passage(passed.time, moment(*passed.left), passed.guard, happened))

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled code for the regime in force, if there is one."""
        regime = self.reached.regime
        if regime.holds or self._must_search(self.reached.m):
            return None
        if self._program is None or self._program[0] is not regime:
            found = compiled_program(regime, self.template, self.solver.name)
            if found is None:  # as soon as it pays
                return None
            self._program = regime, found
        return self._program[1]

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated: from the last point that was reached, with the outputs left."""
        here = self.recorder.time if self.recorder.segments else self.template.start
        moment = self.reached
        return replace(self.template, start=here, times=times[times > here], x=moment.x, z=moment.z, p=moment.m)

    def _explained(self, relations: list[int], clauses: list[int]) -> tuple[Cause, ...]:
        """Causes of an event: texts and places of these relations and clauses."""
        acting = (self.problem.compiled.state_events.clauses[k] for k in clauses)
        return (*(self.guards.causes[k] for k in relations), *(Cause(c.text, c.where, c.component) for c in acting))

    def enter(self, stretch: Stretch) -> None:
        """The event at the start of a stretch."""
        moment, here = self.reached, stretch.start
        changed = moment.m.copy()
        changed[: len(stretch.modes)] = stretch.modes
        now = Moment(moment.x, moment.z, changed, moment.regime)
        if self.recorder.count and stretch.opens:  # the start has been told already
            now = self.iteration.flipped(now, self.guards.exact(here, moment))
        happened = self.iteration.settle(here, now, moment.m, samples=stretch.samples)
        self.passages.append(Passage(here, moment, None, happened))
        self._record_start(here, self._say(happened, here), happened)
        self._gap = np.inf  # what was known of the stretches before need not hold behind it

    def advance(self, stretch: Stretch, place: Place) -> float | None:
        """Integrate to the next event, or to the end of the stretch, and pass it; see `driver.Dynamics`."""
        here, moment, times = place.here, self.reached, stretch.times
        if place.arrived:
            self._relax()
            return self._passed(here, moment)
        if not place.fresh:
            times = times[times > here + 1e-13 * max(self.span, abs(here))]
        if not len(times):
            return None
        rest = self._due(here, moment, float(times[-1]))
        if rest is not None:
            times = np.append(times[times < rest], rest)
        asked = replace(
            self.template,
            start=here,
            times=times,
            x=moment.x,
            z=moment.z,
            p=moment.m,
            first=self.pace,
            max_step=stretch.longest,
        )
        stop = self.integrated(asked, moment)
        if stop.time is None:
            self.moment = Moment(stop.x, stop.z, moment.m, moment.regime)
            return None if rest is None else self._rested(rest)
        self._gap = max(stop.time - here, self._gap / 8 if np.isfinite(self._gap) else 0.0)
        here = stop.time
        left = self.iteration.consistent(here, Moment(stop.x, stop.z, moment.m, moment.regime))
        self._record(np.array([here]), left.x[:, None], left.z[:, None], left, {})
        return self._passed(here, left)

    def _passed(self, here: float, left: Moment) -> float:
        """Pass the event of a variable at this instant, up to which all is recorded; the instant."""
        fired = self.guards.fired(here, left)
        happened = self.event(here, left, fired)
        self.passages.append(Passage(here, left, int(np.argmax(fired)), happened))
        self._record_start(here, self._say(happened, here), happened)
        return here

    def _near(self, t: float) -> float:
        """The last instant that cannot be told from this one."""
        return float(t + as_one(self.span, t))

    def _due(self, here: float, moment: Moment, end: float) -> float | None:
        """When the flights of something held at rest end, if that is within a stretch."""
        while (due := self.bounces.due(moment.regime)) is not None and due[0] <= self._near(here):
            del self.bounces.resting[due[1]]  # what was said of it at its last impact is enough
        return due[0] if due is not None and due[0] <= end else None

    def _rested(self, t: float) -> float:
        """The event of flights that end: nothing jumps, what was lower than the noise is zero."""
        found = [k for k, rest in self.bounces.resting.items() if rest.time <= self._near(t)]
        ended = [self.bounces.resting.pop(k) for k in found]
        causes, notes = tuple(rest.cause for rest in ended), tuple(rest.note for rest in ended)
        happened = Happened(self.reached, causes, notes=notes)
        self._record_start(t, self._say(happened, t), happened)
        return t

    def end(self, t: float, samples: Vector) -> None:
        """The event at the end of the run: guards that are reached, `terminal()`, perhaps a sample."""
        if self.moment is not None:
            self._finish(t, self.moment)
        if self.moment is None or not ("terminal" in self.iteration.flag_names or samples.any()):
            return
        left = self.moment
        happened = self.iteration.settle(t, left, left.m, samples=samples, flag="terminal")
        self.passages.append(Passage(t, left, None, happened, edge=True))
        # discrete equations are no causes, and yet may read a sample
        if happened.causes or not _stays(left, happened.moment):
            self._record_start(t, self._say(happened, t), happened)

    def _finish(self, t: float, left: Moment) -> None:
        """The event of guards that end the run on zero: what cannot be told from zero counts as reached.

        Nothing follows that would show the crossing; whether a solver has found it just before is left to rounding.
        """
        if not left.regime.active_set.owners:
            return
        g, rate, noise = self.guards.state(t, left)
        relations = np.array([side < 0 for _, side in left.regime.active_set.owners], dtype=bool)
        fired = relations & (np.abs(g) <= noise) & (rate < -noise)
        if fired.any():
            happened = self.event(t, left, fired)
            self.passages.append(Passage(t, left, int(np.argmax(fired)), happened, edge=True))
            self._record_start(t, self._say(happened, t), happened)
        self._note_stuck(t, left, relations & (np.abs(g) <= noise) & (rate <= 0.0), rate)

    def _note_stuck(self, t: float, left: Moment, close: Truth, rate: Vector) -> None:
        """Say of guards that a run has crept up to without passing them if the equations behind them lead away.

        A tank that drains by the root of its level is empty to the tolerance, at a rate that is zero to its root:
        whether a solver's steps go below zero, where the model goes on otherwise, is left to its rounding.
        """
        watched = self.problem.compiled.state_events.watched
        for k in np.flatnonzero(close).tolist():
            relation = left.regime.active_set.owners[k][0]
            if relation in watched:
                continue
            beyond = self.iteration.consistent(t, self.iteration.flipped(left, np.arange(len(close)) == k))
            rates, noises = self.guards.rates(t, beyond)
            if rates[k] > noises[k] and -rate[k] < _CREEPING * rates[k]:
                text = self.guards.texts[relation]
                self._note(f"{text}: zero to the tolerance at the end, and what holds behind it leads away from there")

    def event(self, t: float, left: Moment, fired: Truth) -> Happened:
        """Flip what has reached its guard, and iterate."""
        relations = [left.regime.active_set.owners[k][0] for k in np.flatnonzero(fired)]
        happened = self.iteration.settle(t, self.iteration.flipped(left, fired), left.m)
        held, landed = self.bounces.landed(t, left, happened, relations)
        if landed:
            after = self.iteration.settle(t, self.iteration.consistent(t, held), happened.moment.m)
            changed = tuple(dict.fromkeys((*happened.changed, *after.changed)))
            notes = [rest.note for rest in landed if rest.time <= self._near(t)]
            causes, notes = (*happened.causes, *after.causes), [*happened.notes, *notes, *after.notes]
            happened = replace(after, causes=causes, changed=changed, notes=tuple(notes))
        self.bounces.saw(t, relations)
        if self.bounces.endless:
            names = [self.guards.texts[k] for k in self.bounces.endless]
            raise accumulated(self.problem.compiled, t, self.bounces.count, names)
        if not happened.causes and _stays(left, happened.moment):
            return replace(happened, causes=_NOTHING)
        return replace(happened, causes=(*(self.guards.causes[k] for k in relations), *happened.causes))

    def integrated(self, segment: Segment, moment: Moment) -> Stop:
        """Integrate and record up to the next event, or to the end."""
        if not self.single_step:
            return self.searched(segment, moment, self.band(segment.start, moment))
        failures, mark = 0, segment.start
        while True:
            self._relax()
            mesh = self.mesh(segment)
            wide = replace(segment, times=np.union1d(segment.times[segment.times <= mesh[-1]], mesh))
            try:
                stop = self._stopped(wide, moment)
            except Interrupted as interrupted:
                self._rescue(segment, moment, interrupted.got)
                raise
            except RuntimeError:
                # frozen modes may lead where nothing is defined, just beyond an event: not so far, then
                reach = float(mesh[-1]) - segment.start
                failures += 1
                # near a pole small pieces arrive somewhere again and again, without getting on
                if reach <= 2 * _SHORTEST * self.span:
                    raise
                if failures % _MANY == 0:
                    if segment.start - mark < _PROGRESS * self.span:
                        raise
                    mark = segment.start
                self._gap, self._failed = reach / 64, True
                segment = replace(segment, step_budget=RECOVERY_STEPS)
                continue
            if stop is None:
                self.guards.step = 0.0
                return self.searched(segment, moment, self.band(segment.start, moment))
            self._refuse_lingering(stop)
            keep = np.isin(stop.times, segment.times)
            self._record(stop.times[keep], stop.piece.x[:, keep], stop.piece.z[:, keep], moment, stop.piece.counters)
            reached = stop.time if stop.time is not None else float(mesh[-1])
            self.pace = pace(segment.start, reached, stop.piece.counters)
            self._relax()
            if stop.time is not None or reached >= segment.times[-1]:
                return stop
            self._gap = reached - segment.start
            rest = segment.times[segment.times > reached]
            segment = replace(segment, start=reached, times=rest, x=stop.x, z=stop.z, first=self.pace)
            moment = Moment(stop.x, stop.z, moment.m, moment.regime)

    def _relax(self) -> None:
        """Take errors as an implicit step leaves them; those of an explicit one have not relaxed."""
        self.guards.step = self.pace if self.solver.name == "rosenbrock" else 0.0

    def _stopped(self, segment: Segment, moment: Moment) -> Stop | None:
        """Where the solver stops by itself; None where it may have passed over what a steep function does.

        Stretches in which the same relations hold are not tried again where that was in vain.
        """
        if self.missed_events is None:
            return integrate_to_event(self.guards, moment, segment, self.solver.name, self.lingering)
        if self._must_search(moment.m):
            return None
        stop = integrate_to_event(self.guards, moment, segment, self.solver.name, self.lingering)
        times, piece = stop.times, stop.piece
        if stop.time is not None:
            times, x = np.append(times, stop.time), np.hstack([piece.x, stop.x[:, None]])
            piece = Piece(x, np.zeros((0, len(times))), piece.counters)
        return stop if self._clears(replace(segment, times=times), piece, moment.regime.problem) else None

    def _must_search(self, m: Vector) -> bool:
        """Whether stretches in which these relations hold have to be searched: others of them were not cleared."""
        return self._uncleared.get(m[self.guards.first :].tobytes(), 0) >= _MOST_UNCLEARED

    def _clears(self, segment: Segment, piece: Piece, problem: Problem | None = None) -> bool:
        """Whether nothing was passed over by what was found of a stretch."""
        assert self.missed_events is not None, "asked only where something is steep"
        if self.missed_events.clears(problem or self.problem, segment, piece):
            return True
        relations = segment.p[self.guards.first :].tobytes()
        self._uncleared[relations] = self._uncleared.get(relations, 0) + 1
        return False

    def _refuse_lingering(self, stop: Stop) -> None:
        """Refuse what an explicit method neither passes nor leaves, as both modes lead to it."""
        names = [self.guards.texts[k] for k, count in self.lingering.events.items() if count > _LINGERING]
        if names and stop.time is not None:
            raise unsettled(self.problem.compiled, stop.time, names)

    def _rescue(self, segment: Segment, moment: Moment, got: Stop | None) -> None:
        """Record the rows of an interrupted stretch."""
        if got is not None:
            keep = np.isin(got.times, segment.times)
            self._record(got.times[keep], got.piece.x[:, keep], got.piece.z[:, keep], moment, got.piece.counters)

    def searched(self, segment: Segment, moment: Moment, band: Vector) -> Stop:
        """The same with solvers that do not stop by themselves."""
        none = Piece(np.zeros((len(moment.x), 0)), np.zeros((len(moment.z), 0)), {})

        def record(times: Vector, piece: Piece) -> None:
            if not self.is_delayed:
                self._record(times, piece.x, piece.z, moment, piece.counters)

        if self.is_delayed and not moment.regime.active_set.owners:
            reached = Arrival(None, moment.x, moment.z)
        else:
            reached = self.search.to_event(segment, moment, band, self._gap, record)
            if reached.time is not None:
                self._judge(reached, moment)
        if not self.is_delayed:
            return Stop(none, segment.times[:0], reached.time, reached.x, reached.z)
        if reached.time is not None and reached.time <= segment.start:  # it was found where the last one was passed
            return Stop(none, segment.times[:0], reached.time, reached.x, reached.z)
        return self._remembered(segment, moment, reached.time)

    def _remembered(self, segment: Segment, moment: Moment, event: float | None) -> Stop:
        """Integrate to an event that was located, or to the end, as it is remembered, and record that.

        What is delayed is remembered of the stretch as it is, and of nothing beyond it. This integration passes the
        guard a little elsewhere: in front of it, what has flipped would flip back, and be an event once more.
        """
        none, end = Piece(np.zeros((len(moment.x), 0)), np.zeros((len(moment.z), 0)), {}), float(segment.times[-1])
        until, rest, x, z = end if event is None else event, segment, moment.x, moment.z
        for turn in range(_TURNS):
            times = np.append(rest.times[rest.times < until], until)
            piece = self.integrate(moment.regime, replace(rest, times=times))
            x, z = piece.x[:, -1], piece.z[:, -1]
            ahead = 0.0
            if event is not None and turn + 1 < _TURNS:
                ahead = _BEYOND * self.guards.ahead(until, replace(moment, x=x, z=z))
            if ahead > 0.0 and until == end:  # found where the next stretch begins
                event, ahead = None, 0.0
            keep = np.isin(times, segment.times)
            keep[-1] &= event is None or ahead > 0.0
            self._record(times[keep], piece.x[:, keep], piece.z[:, keep], moment, piece.counters)
            if ahead == 0.0:
                break
            rest = replace(rest, start=until, times=segment.times[segment.times > until], x=x, z=z, first=0.0)
            event = until = min(self._near(until) + ahead, end)
        return Stop(none, segment.times[:0], event, x, z)

    def _judge(self, reached: Arrival, moment: Moment) -> None:
        """Say of a guard that it was never as large as it may be wrong; refuse it where no other one is passed."""
        self._refuse_restless(reached, moment)
        if reached.vague is None:
            self._vague.clear()
            return
        relation = moment.regime.active_set.owners[reached.vague][0]
        if relation in self.problem.compiled.state_events.watched:
            return
        text = self.guards.texts[relation]
        self._note(f"{text}: what decides it may be wrong by more than its size; a tighter tolerance locates it better")
        self._vague[relation] = self._vague.get(relation, 0) + 1
        if self._vague[relation] > _VAGUE:
            raise unsettled(self.problem.compiled, float(reached.time or 0.0), [text])

    def _refuse_restless(self, reached: Arrival, moment: Moment) -> None:
        """Refuse a relation that flips without end, hardly in time, among errors of states.

        Near `sqrt(h)` they relax so fast that a guard of 1e-17 is well known, and its events are 1e-7 s apart.
        """
        if reached.small is None or reached.time is None:
            self._small.clear()
            return
        relation = moment.regime.active_set.owners[reached.small][0]
        if relation in self.problem.compiled.state_events.watched:
            return
        times = self._small.setdefault(relation, [])
        times.append(reached.time)
        if len(times) > _SMALL:
            if times[-1] - times[0] < _SMALL * _RESTLESS * self.span:
                raise unsettled(self.problem.compiled, reached.time, [self.guards.texts[relation]])
            times.clear()

    def _note(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)
            _log.warning("%s: %s", self.problem.compiled.name, note)

    def mesh(self, segment: Segment) -> Vector:
        """Where a one-step method, which stops at events by itself, ends a step to have its guards looked at.

        Over the whole rest of the segment; where that has failed, not much farther than it has come.
        """
        end = float(segment.times[-1])
        span = end - segment.start
        reach = self._gap if self._failed else np.inf
        if reach < span / 8:
            span = min(span, max(8 * reach, _SHORTEST * self.span))
        count = max(_FEWEST_POINTS, min(math.ceil(_MOST_POINTS * span / self.span), _MOST_POINTS))  # as in a whole run
        found = segment.start + span * np.arange(1, count + 1) / count
        found[-1] = min(segment.start + span, end) if span < end - segment.start else end
        return found

    def band(self, t: float, moment: Moment) -> Vector:
        """How far past its guard each one may go: the noise where it rests there and does not leave.

        One that leaves it, from behind by rounding, may be there as long as it does not turn back.
        """
        if not moment.regime.active_set.owners:
            return np.zeros(0)
        g, rate, noise = self.guards.state(t, moment)
        resting = resting_band(g, rate, noise)
        behind = self.guards.behind(t, g, rate, noise)
        return np.where(resting > 0.0, resting, np.where(behind, np.maximum(-2.0 * g, 0.0), 0.0))

    def _say(self, happened: Happened, t: float) -> Moment:
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
    """Whether modes, states and what is held are those before the event: it was found early, and is found again."""
    same = np.array_equal(before.m, after.m) and np.array_equal(before.x, after.x)
    return same and before.regime.holds == after.regime.holds
