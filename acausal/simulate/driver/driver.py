"""The driver: one run from its first stop to its last, whatever its equations and its stops are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from acausal.arrays import Vector
from acausal.errors import InitializationError
from acausal.simulate.driver.agenda import Agenda, Place, Schedule, Stretch, TooFar
from acausal.simulate.driver.event_loop import EventLoop, LoopState
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.failure import integration_error, is_constraining
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Segment
from acausal.simulate.start.initialize import Start

# Calls of compiled code in a run that reports its progress.
_REPORTS = 50
# Stretches that may begin at one instant: a source of stops that tries again comes farther each time.
_MOST_TRIES = 1000


class Dynamics(Protocol):
    """What happens between two stops and at them: with events of variables (`Hybrid`) or without (`Smooth`)."""

    terminated: str | None
    pace: float
    """Mean step of the stretch before [s], 0 when it is not known."""

    @property
    def reached(self) -> Moment:
        """Where the run is."""
        ...

    @property
    def equations(self) -> Problem:
        """The equations that are integrated at present."""
        ...

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """The start of the run; `initial()` is true for the flag "initial"."""
        ...

    def enter(self, stretch: Stretch) -> None:
        """The event at the start of a stretch."""
        ...

    def advance(self, stretch: Stretch, place: Place) -> float | None:
        """Go on to the next event of a variable and pass it: its time, None at the end of the stretch.

        Raises RuntimeError when the solver cannot go on.
        Raises TooFar when a source of stops must be asked again.
        """
        ...

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """The run was brought to these values from outside."""
        ...

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """How compiled code passes stretches of this run, if it can."""
        ...

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled code for what is in force, if there is one."""
        ...

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated: from the last point that was reached, with the outputs left."""
        ...

    def end(self, t: float, samples: Vector) -> None:
        """The event at the end of the run."""
        ...


def pass_compiled(dynamics: Dynamics, loop: EventLoop, place: Place, *most: int | None) -> Place | None:
    """Where compiled code takes the dynamics from a place, over `most` segments and events; None if nowhere."""
    library, moment = dynamics.library(), dynamics.reached
    if library is None:
        return None
    reached = loop.go(library, LoopState(place, moment.x, moment.m, dynamics.pace), *most)
    if reached is None:
        return None
    dynamics.moved(reached.x, moment.z, reached.m)
    dynamics.pace = reached.pace
    return reached.place


@dataclass
class Driver:
    """A run on its way."""

    agenda: Agenda
    dynamics: Dynamics
    recorder: Recorder
    solver: str
    report: Callable[[float], None] | None
    interrupted: Callable[[], None]
    stopped: Segment | None = None
    """Where the solver could not go on."""
    ended: bool = False
    """Whether a source of stops has ended the run."""
    entered: Stretch | None = None
    """The stretch that is under way, for a driver that begins within one."""
    _opened: int = -1
    _row: int = 0
    _boundary: int = 0
    _before: Moment | None = None
    _again: int = 0
    """How many stretches before this one began where it does."""

    def go(self) -> None:
        """Go from the first stop to the last, or to the end that the model asks for.

        Raises IntegrationError: AC400 to AC407 where the solver cannot go on.
        """
        known = self.agenda.schedule
        try:
            self.through(Place(0, float(known.instants[0]), False, False))
        except InitializationError:  # no values at a point that was reached: said by name where that is known
            stopped = self.dynamics.failed(self.entered.times if self.entered else known.times)
            if is_constraining(self.dynamics.equations, stopped):
                raise integration_error(self.dynamics.equations, self.solver, stopped, "") from None
            raise
        except RuntimeError as error:
            self.interrupted()
            self.stopped = self.dynamics.failed(self.entered.times if self.entered else known.times)
            raise integration_error(self.dynamics.equations, self.solver, self.stopped, str(error)) from None
        if self.ended:
            return
        samples = known.samples[-1]
        self.dynamics.end(self.recorder.time, samples if self.dynamics.terminated is None else 0.0 * samples)

    def through(self, place: Place) -> None:
        """From a place to the last stop; the event there is not passed, and failures are the solver's own."""
        known = self.agenda.schedule
        loop = None if self.agenda.sources else self.dynamics.event_loop(known)
        while place.segment < known.segments and not self.ended:
            if self.dynamics.terminated is not None and self.recorder.count:
                break
            place = self._compiled(loop, place) or self._step(place)
            if self.report is not None and not place.entered:
                self.report(self.recorder.time)

    def _compiled(self, loop: EventLoop | None, place: Place) -> Place | None:
        """Where compiled code comes to from here, if it does."""
        # the first instant is that of the start, about which compiled code knows nothing
        if loop is None or loop.has_stalled or place.arrived or (place.segment == 0 and not place.entered):
            return None
        most = None if self.report is None else max(1, self.agenda.schedule.segments // _REPORTS)
        reached = pass_compiled(self.dynamics, loop, place, most)
        if reached is None:
            return None
        if reached.entered:
            self.entered = self.agenda.stretch(reached, self.dynamics.reached, True)
        return reached

    def _step(self, place: Place) -> Place:
        """The event at the start of a stretch, or on to the next stop."""
        if not place.entered:
            opens = place.segment != self._opened
            self._before = self.dynamics.reached
            tried = self.entered
            self.entered = self.agenda.stretch(place, self._before, opens)
            self._again = self._again + 1 if tried is not None and tried.start == self.entered.start else 0
            if self._again > _MOST_TRIES:
                raise RuntimeError(f"{_MOST_TRIES} stretches began at this instant, and none came farther")
            self._opened = place.segment
            self._row, self._boundary = self.recorder.count, len(self.recorder.boundaries)
            self.dynamics.enter(self.entered)
            return Place(place.segment, self.entered.start, True, True)
        assert self.entered is not None, "a stretch is entered before it is passed"
        try:
            stop = self.dynamics.advance(self.entered, place)
        except TooFar:
            _, x, z, _ = self.recorder.point(self.recorder.count - 1)
            self.dynamics.moved(x, z, self.dynamics.reached.m)
            return self._left(self.entered, place, complete=False)
        if stop is not None and self.dynamics.terminated is None:
            return replace(place, here=stop, fresh=False, arrived=False)
        return self._left(self.entered, place, complete=True)

    def _left(self, stretch: Stretch, place: Place, complete: bool) -> Place:
        """The end of a stretch: what a source had to do with its start is told, and the sources are."""
        if not stretch.opens:
            self._explain(stretch, self.agenda.schedule.outputs(place.segment))
        here, end = self.recorder.time, float(self.agenda.schedule.instants[place.segment + 1])
        events = [t for t, _, _ in self.recorder.boundaries[self._boundary :]]
        self.ended = not self.agenda.accepts(self.recorder, events, complete)
        if self.recorder.time < here:
            self.dynamics.terminated = None  # what ended the run has been cut
        ended = here >= end or (complete and stretch.end >= end)
        return Place(place.segment + ended, here, False, False)

    def _explain(self, stretch: Stretch, outputs: Vector) -> None:
        """Say what happened where a source has cut, or leave the cut out of the result when nothing has.

        A stretch that is tried again has only its own row too many: those before it are of the start of the run, of an
        instant of the schedule, or of what happened where it was tried first.
        """
        causes = (*stretch.causes, *self._flipped())
        _, *happened = self.recorder.boundaries[self._boundary]
        if causes or any(happened):
            self.recorder.explain(self._boundary, causes)
            return
        self.recorder.hide(self._row, self._boundary)
        if not self._again and not (np.abs(outputs - stretch.start) <= self.agenda.margin).any():
            self.recorder.hide(self._row - 1)

    def _flipped(self) -> tuple[Cause, ...]:
        """Relations that have changed where the stretch begins."""
        assert self._before is not None, "kept where the stretch began"
        compiled = self.recorder.compiled
        first = compiled.n_modes - len(compiled.state_events.relations)
        after = self.recorder.point(self._row)[3][first:]
        flipped = after != self._before.m[first:]
        held = list(self._before.regime.active_set.taken)  # recorded as the multipliers that hold them
        flipped[held] &= (after[held] <= 0.0) | (after[held] >= 1.0)
        texts, places = compiled.events.texts, compiled.events.places
        return tuple(Cause(texts[k], *places[k]) for k in np.flatnonzero(flipped).tolist())
