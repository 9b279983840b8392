"""A run with events: stretches in which the modes hold, and what happens between them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.course import Course, Place
from acausal.simulate.event_errors import accumulated
from acausal.simulate.flight import Flight, Landing, can_fly
from acausal.simulate.guards import LOCATED, Cause, Guards, Moment, Tolerances, Truth
from acausal.simulate.initialize import Start
from acausal.simulate.iteration import Happened, Iteration
from acausal.simulate.looking import LOOKS, first_crossing, locate
from acausal.simulate.patience import PATIENCE
from acausal.simulate.problem import Problem
from acausal.simulate.record import Recorder
from acausal.simulate.regime import Regime
from acausal.simulate.rest import Bounces
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import Piece, Segment, pace
from acausal.simulate.stopping import Stop, compiled_program, integrate_to_event

Vector = NDArray[np.float64]
Integrate = Callable[[Regime, Segment], Piece]
_log = logging.getLogger(__name__)
# Share of the run that is integrated at once at least.
_SHORTEST = 1e-9
# So many failures must have brought a run on by this share of it.
_MANY, _PROGRESS = 100, 1e-6


@dataclass(frozen=True, eq=False)
class Passage:
    """An event as it was passed: the guard that was reached (None at a known instant), and what followed from it."""

    time: float
    left: Moment
    guard: int | None
    happened: Happened


@dataclass
class Hybrid:
    """The events of one run."""

    problem: Problem
    solver: Solver
    recorder: Recorder
    integrate: Integrate
    tolerances: Tolerances
    span: float
    traced: bool = False
    moment: Moment | None = None
    notes: list[str] = field(default_factory=list)
    passages: list[Passage] = field(default_factory=list)
    terminated: str | None = None
    history: list[tuple[float, Regime]] = field(default_factory=list)
    _gap: float = np.inf
    _pace: float = 0.0
    _failed: bool = False

    def __post_init__(self) -> None:
        self.guards = Guards(self.problem, self.tolerances, self.span)
        self.iteration = Iteration(self.problem, self.guards)
        self.bounces = Bounces(self.problem, self.guards, self.span)
        self.single_step = self.solver.name in ("rosenbrock", "erk") and not self.problem.compiled.algebraic
        # without states there is no error to choose a step by
        self.single_step &= self.problem.n_dynamic > 0
        # what is delayed is recorded by integrations that go on to their end
        self.single_step &= not self.problem.compiled.delays

    def begin(self, t: float, start: Start, m: Vector, *, flag: str | None = "initial") -> None:
        """The event at the start of the run; `m` is what the start has decided.

        `initial()` is true, unless `flag` is None: in a run that goes on with given states.
        """
        moment = Moment(start.x, start.z, m.copy(), Regime(self.problem))
        self._say(self.iteration.settle(t, moment, m, flag=flag), t)

    def regime_at(self, t: float) -> Regime:
        """The regime in force just after a time."""
        return next(regime for start, regime in reversed(self.history) if start <= t)

    def run(self, course: Course, template: Segment, report: Callable[[float], None]) -> None:
        """Go from the first instant of the course to the last, or to the end that the model asks for.

        `report` is told the time that was reached.
        """
        flight = None
        if not self.traced and self.single_step and can_fly(self.problem, self.solver):
            rest = self.span, self.bounces, self._explained
            flight = Flight(self.problem, self.recorder, course, template, *rest)
        place = Place(0, float(course.instants[0]), False, False)
        while place.segment < course.segments and self.terminated is None:
            flown = self._flown(flight, template, place)
            if flown is not None:
                place = flown
            else:
                place = self.stretch(course, template, place) if place.entered else self.enter(course, place)
            if not place.entered:
                report(self.recorder.time)

    def _flown(self, flight: Flight | None, template: Segment, place: Place) -> Place | None:
        """Where compiled code comes to from here, if it does."""
        moment = self.reached
        # the first instant is that of the start, about which compiled code knows nothing
        if flight is None or flight.is_vain or moment.regime.holds or (place.segment == 0 and not place.entered):
            return None
        library = compiled_program(moment.regime, template, self.solver.name)
        landing = None if library is None else flight.go(library, Landing(place, moment.x, moment.m, self._pace))
        if landing is None:
            return None
        self.moment, self._pace = replace(moment, x=landing.x, m=landing.m), landing.pace
        return landing.place

    def _explained(self, relations: list[int], clauses: list[int]) -> tuple[Cause, ...]:
        """What relations and clauses are, in the user's words."""
        acting = (self.problem.compiled.state_events.clauses[k] for k in clauses)
        return (*(self.guards.causes[k] for k in relations), *(Cause(c.text, c.where, c.component) for c in acting))

    def enter(self, course: Course, place: Place) -> Place:
        """The event at the start of a segment."""
        moment = self.reached
        timely = course.modes.shape[1]
        here = float(course.instants[place.segment])
        changed = moment.m.copy()
        changed[:timely] = course.modes[place.segment]
        samples = course.samples[place.segment]
        happened = self.iteration.settle(here, replace(moment, m=changed), moment.m, samples=samples)
        self.passages.append(Passage(here, moment, None, happened))
        self._record_start(here, self._say(happened, here), happened)
        return replace(place, here=here, entered=True, fresh=True)

    def stretch(self, course: Course, template: Segment, place: Place) -> Place:
        """Integrate to the next event, or to the end of the segment, and pass it."""
        here, moment, times = place.here, self.reached, course.outputs(place.segment)
        if not place.fresh:
            times = times[times > here + 1e-13 * max(self.span, abs(here))]
        if not len(times):
            return Place(place.segment + 1, here, False, False)
        asked = replace(template, start=here, times=times, x=moment.x, z=moment.z, p=moment.m, first=self._pace)
        stop = self.integrated(asked, moment)
        if stop.time is None:
            self.moment = replace(moment, x=stop.x, z=stop.z)
            return Place(place.segment + 1, float(times[-1]), False, False)
        self._gap = max(stop.time - here, self._gap / 8 if np.isfinite(self._gap) else 0.0)
        here = stop.time
        left = self.iteration.consistent(here, replace(moment, x=stop.x, z=stop.z))
        self._record(np.array([here]), left.x[:, None], left.z[:, None], left, {})
        fired = self.guards.fired(here, left)
        happened = self.event(here, left, fired)
        self.passages.append(Passage(here, left, int(np.argmax(fired)), happened))
        self._record_start(here, self._say(happened, here), happened)
        return replace(place, here=here, fresh=False)

    @property
    def reached(self) -> Moment:
        """The moment that the run has reached."""
        assert self.moment is not None, "a run begins before its first segment"
        return self.moment

    def end(self, t: float, samples: Vector) -> None:
        """The event at the end of the run: guards that are reached, `terminal()`, perhaps a sample."""
        if self.moment is not None and not self.traced:
            self._finish(t, self.moment)
        if self.moment is None or not ("terminal" in self.iteration.flag_names or samples.any()):
            return
        happened = self.iteration.settle(t, self.moment, self.moment.m, samples=samples, flag="terminal")
        if happened.causes:
            self._record_start(t, self._say(happened, t), happened)

    def _finish(self, t: float, left: Moment) -> None:
        """The event of guards that end the run on zero: what cannot be told from zero counts as reached.

        Nothing follows that would show the crossing; whether a solver has found it just before is left to rounding.
        """
        if not left.regime.owners:
            return
        g, (rate, noise) = self.guards.distances(t, left), self.guards.rates(t, left)
        relations = np.array([side < 0 for _, side in left.regime.owners], dtype=bool)
        fired = relations & (np.abs(g) <= noise) & (rate < -noise)
        if fired.any():
            happened = self.event(t, left, fired)
            self._record_start(t, self._say(happened, t), happened)

    def event(self, t: float, left: Moment, fired: Truth) -> Happened:
        """Flip what has reached its guard, and iterate."""
        relations = [left.regime.owners[k][0] for k in np.flatnonzero(fired)]
        moment, rested, notes = self.bounces.rest(t, left, relations)
        if rested:
            moment = self.iteration.consistent(t, moment)
            fired = np.array([side < 0 and k in relations and k not in rested for k, side in moment.regime.owners])
        happened = self.iteration.settle(t, self.iteration.flipped(moment, fired), left.m)
        held, landed, more = self.bounces.landed(t, left, happened.moment, relations)
        if landed:
            after = self.iteration.settle(t, self.iteration.consistent(t, held), happened.moment.m)
            changed = tuple(dict.fromkeys((*happened.changed, *after.changed)))
            notes += [*happened.notes, *more]
            happened = replace(after, causes=(*happened.causes, *after.causes), changed=changed)
        if rested or landed:
            happened = replace(happened, notes=(*notes, *happened.notes))
        self.bounces.saw(t, relations if happened.changed else [])
        if self.bounces.is_endless:
            names = [self.guards.texts[k] for k in self.bounces.crowded]
            raise accumulated(self.problem.compiled.name, t, self.bounces.count, names)
        return replace(happened, causes=(*(self.guards.causes[k] for k in relations), *happened.causes))

    def integrated(self, segment: Segment, moment: Moment) -> Stop:
        """Integrate and record up to the next event, or to the end."""
        band = self.band(segment.start, moment)
        failures, mark = 0, segment.start
        while True:
            looks = self.looks(segment)
            wide = replace(segment, times=np.union1d(segment.times[segment.times <= looks[-1]], looks))
            try:
                stop = self.checked(segment, moment, self.attempt(moment, wide, band), band)
            except RuntimeError:
                # frozen modes may lead where nothing is defined, just beyond an event: not so far, then
                reach = float(looks[-1]) - segment.start
                failures += 1
                # near a pole small pieces arrive somewhere again and again, without getting on
                if reach <= 2 * _SHORTEST * self.span:
                    raise
                if failures % _MANY == 0:
                    if segment.start - mark < _PROGRESS * self.span:
                        raise
                    mark = segment.start
                self._gap, self._failed = reach / 64, True
                segment = replace(segment, patience=PATIENCE)
                continue
            keep = np.isin(stop.times, segment.times)
            self._record(stop.times[keep], stop.piece.x[:, keep], stop.piece.z[:, keep], moment, stop.piece.counters)
            reached = stop.time if stop.time is not None else float(looks[-1])
            self._pace = pace(segment.start, reached, stop.piece.counters)
            if stop.time is not None or reached >= segment.times[-1]:
                return stop
            self._gap = reached - segment.start
            rest = segment.times[segment.times > reached]
            segment = replace(segment, start=reached, times=rest, x=stop.x, z=stop.z, first=self._pace)
            moment = replace(moment, x=stop.x, z=stop.z)

    def attempt(self, moment: Moment, segment: Segment, band: Vector) -> Stop:
        """Integrate with frozen modes, to the end or to the event that the solver itself stops at."""
        if self.single_step:
            return integrate_to_event(moment.regime, segment, band, self.solver.name)
        piece = self.integrate(moment.regime, segment)
        return Stop(piece, segment.times, None, piece.x[:, -1], piece.z[:, -1])

    def looks(self, segment: Segment) -> Vector:
        """Where the guards are looked at: over the whole rest of the segment when events are rare.

        What lies beyond an event is computed in vain, so the first look after one reaches not much farther than the
        last two events were apart. One-step methods stop at the event by themselves.
        """
        end = float(segment.times[-1])
        span = end - segment.start
        reach = np.inf if self.single_step and not self._failed else self._gap
        if reach < span / 8:
            span = min(span, max(8 * reach, _SHORTEST * self.span))
        count = LOOKS // 4 if self.single_step or span < self.span / 100 else LOOKS
        found = segment.start + span * np.arange(1, count + 1) / count
        found[-1] = min(segment.start + span, end) if span < end - segment.start else end
        return found

    def checked(self, segment: Segment, moment: Moment, stop: Stop, band: Vector) -> Stop:
        """The same stretch, ended at the first guard that was passed between the rows."""
        if not moment.regime.owners or not len(stop.times):
            return stop
        g = self.guards.along(stop.times, stop.piece.x, stop.piece.z, moment.m, moment.regime)
        if stop.time is not None:  # a row at the event itself may be past it, by rounding
            g = g[stop.times < stop.time - 1e-12 * max(self.span, abs(stop.time))]
        g = np.vstack([np.maximum(self.guards.distances(segment.start, moment), 0.0), g])
        times, x, z = stop.times, stop.piece.x, stop.piece.z
        done = 0
        while True:
            found = first_crossing(np.append(segment.start, times)[done : len(g)], g[done:], band)
            if found is None:
                return stop
            k, seen = found[0] + done - 1, found[1]  # row of the stop
            a = k - 1 if seen else k - 2
            start = segment.start if a < 0 else float(times[a])
            xa, za = (segment.x, segment.z) if a < 0 else (x[:, a], z[:, a])
            inside = replace(segment, start=start, times=times[k : k + 1], x=xa, z=za)
            at = replace(moment, x=xa, z=za)
            closer = locate(self.guards, at, inside, band, lambda s: self.integrate(moment.regime, s))
            if closer.time is None:
                # a longer step had seen what a shorter one does not: it may come in the next interval
                done = k + 1
                g[done] = np.maximum(g[done], 0.0)
                continue
            keep = a + 1
            rows = Piece(x[:, :keep], z[:, :keep], {**stop.piece.counters})
            return Stop(rows, times[:keep], closer.time, closer.x, closer.z)

    def band(self, t: float, moment: Moment) -> Vector:
        """How far past its guard each one may go: the noise where it rests there and does not leave.

        One that leaves it, from behind by rounding, may be there as long as it does not turn back.
        """
        if not moment.regime.owners:
            return np.zeros(0)
        g, (rate, noise) = self.guards.distances(t, moment), self.guards.rates(t, moment)
        resting: Truth = (g <= LOCATED * noise) & (rate <= noise)
        return np.where(resting, 2 * noise, np.where(np.abs(g) <= noise, np.maximum(-2.0 * g, 0.0), 0.0))

    def _say(self, happened: Happened, t: float) -> Moment:
        self.moment = happened.moment
        self.history.append((t, happened.moment.regime))
        self.terminated = happened.terminated
        for note in happened.notes:
            if note not in self.notes:
                self.notes.append(note)
                _log.warning("%s: %s", self.problem.compiled.name, note)
        return happened.moment

    def _record_start(self, t: float, moment: Moment, happened: Happened) -> None:
        m = moment.regime.modes(np.array([t]), moment.x[:, None], moment.z[:, None], moment.m)
        self.recorder.begin(t, moment.x, moment.z, m, happened.causes, happened.changed)

    def _record(self, times: Vector, x: Vector, z: Vector, moment: Moment, counters: dict[str, float]) -> None:
        self.recorder.add(times, Piece(x, z, counters), moment.regime.modes(times, x, z, moment.m))
