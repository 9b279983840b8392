"""The driver: takes one run from its first stop to its last, whatever its equations and stops are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from acausal.arrays import Vector
from acausal.errors import InitializationError
from acausal.simulate.driver.agenda import Agenda, Position, Schedule, Stretch, TooFar
from acausal.simulate.driver.event_loop import EventLoop, LoopState
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.failure import integration_error, is_constraining
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers.segment import Segment
from acausal.simulate.start.initialize import Start

# The number of calls of compiled code in a run that reports its progress.
_MOST_REPORTS = 50
# The most stretches that may begin at one instant: a source that tries again must get farther eventually.
_MOST_TRIES = 1000


class Dynamics(Protocol):
    """What happens at stops and between them: with state events (`Hybrid`) or without (`Smooth`)."""

    terminated: str | None
    pace: float
    """Mean step of the previous stretch [s]; 0 if it is not known."""

    @property
    def reached(self) -> Moment:
        """States, variables and modes that the run has reached."""
        ...

    @property
    def equations(self) -> Problem:
        """The equations that are integrated at the moment."""
        ...

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """Execute the start of the run; `initial()` is true if the flag is "initial"."""
        ...

    def enter(self, stretch: Stretch) -> None:
        """Execute the event at the start of a stretch."""
        ...

    def advance(self, stretch: Stretch, position: Position) -> float | None:
        """Integrate to the next state event and execute it; its time [s], or None at the end of the stretch.

        Raises RuntimeError if the solver cannot continue.
        Raises TooFar if the stretch leaves the range of a source of stops.
        """
        ...

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """Take over values that were computed elsewhere."""
        ...

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """The compiled event loop over a schedule of this run, or None if it does not suit."""
        ...

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled code for the present equations, if there is any."""
        ...

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated: from the last point that was reached, with the later `times`."""
        ...

    def end(self, t: float, samples: Vector) -> None:
        """Execute the event at the end of the run."""
        ...


def pass_compiled(dynamics: Dynamics, loop: EventLoop, position: Position, *most: int | None) -> Position | None:
    """Advance the dynamics in compiled code, over at most `most` segments and events; None if it gets nowhere."""
    library, moment = dynamics.library(), dynamics.reached
    if library is None or loop.has_stalled:
        return None
    reached = loop.go(library, LoopState(position, moment.x, moment.m, dynamics.pace), *most)
    if reached is None:
        return None
    dynamics.moved(reached.x, moment.z, reached.m)
    dynamics.pace = reached.pace
    return reached.position


@dataclass
class Driver:
    """Advances one run from stop to stop."""

    agenda: Agenda
    dynamics: Dynamics
    recorder: Recorder
    solver: str
    report: Callable[[float], None] | None
    interrupted: Callable[[], None]
    stopped: Segment | None = None
    """The segment in which the solver could not continue."""
    ended: bool = False
    """Whether a source of stops has ended the run."""
    entered: Stretch | None = None
    """The present stretch; given to a driver that begins within one."""
    _opened: int = -1
    _row: int = 0
    _boundary: int = 0
    _before: Moment | None = None
    _again: int = 0
    """How many of the stretches just before this one began at the same instant."""

    def go(self) -> None:
        """Go from the first stop to the last, or until the model terminates the run.

        Raises IntegrationError (AC400 to AC407) if the solver cannot continue.
        """
        known = self.agenda.schedule
        try:
            self.through(Position(0, float(known.instants[0]), False, False))
        except InitializationError:  # names the equation if it has become a constraint on the states
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

    def through(self, position: Position) -> None:
        """Go from a position to the last stop, without the event there; failures are those of the solver."""
        known = self.agenda.schedule
        loop = None if self.agenda.sources else self.dynamics.event_loop(known)
        while position.segment < known.segments and not self.ended:
            if self.dynamics.terminated is not None and self.recorder.count:
                break
            position = self._compiled(loop, position) or self._step(position)
            if self.report is not None and not position.entered:
                self.report(self.recorder.time)

    def _compiled(self, loop: EventLoop | None, position: Position) -> Position | None:
        """The position that compiled code reaches from here; None if it gets nowhere."""
        if position.arrived:
            return None
        if self.agenda.sources:
            return self._compiled_stretch(position) if position.entered else None
        # compiled code cannot execute the start of the run, at the first instant
        if loop is None or (position.segment == 0 and not position.entered):
            return None
        most = None if self.report is None else max(1, self.agenda.schedule.segments // _MOST_REPORTS)
        reached = pass_compiled(self.dynamics, loop, position, most)
        if reached is not None and reached.entered:
            self.entered = self.agenda.stretch(reached, self.dynamics.reached, True)
        return reached

    def _compiled_stretch(self, position: Position) -> Position | None:
        """The same up to the end of the stretch at most, because sources decide there where the next one ends."""
        assert self.entered is not None, "a stretch is entered before it is passed"
        loop = self.dynamics.event_loop(self.entered.alone)
        reached = None if loop is None else pass_compiled(self.dynamics, loop, replace(position, segment=0))
        if reached is not None and reached.segment:
            return self._leave(self.entered, position, complete=True)
        return reached and replace(reached, segment=position.segment)

    def _step(self, position: Position) -> Position:
        """Execute the event at the start of a stretch, or integrate to the next stop."""
        if not position.entered:
            opens = position.segment != self._opened
            self._before = self.dynamics.reached
            previous = self.entered
            self.entered = self.agenda.stretch(position, self._before, opens)
            self._again = self._again + 1 if previous is not None and previous.start == self.entered.start else 0
            if self._again > _MOST_TRIES:
                raise RuntimeError(f"{_MOST_TRIES} stretches began at this instant, and none got any farther")
            self._opened = position.segment
            self._row, self._boundary = self.recorder.count, len(self.recorder.boundaries)
            self.dynamics.enter(self.entered)
            return Position(position.segment, self.entered.start, True, True)
        assert self.entered is not None, "a stretch is entered before it is passed"
        try:
            stop = self.dynamics.advance(self.entered, position)
        except TooFar:
            _, x, z, _ = self.recorder.point(self.recorder.count - 1)
            self.dynamics.moved(x, z, self.dynamics.reached.m)
            return self._leave(self.entered, position, complete=False)
        if stop is not None and self.dynamics.terminated is None:
            return replace(position, here=stop, fresh=False, arrived=False)
        return self._leave(self.entered, position, complete=True)

    def _leave(self, stretch: Stretch, position: Position, complete: bool) -> Position:
        """End a stretch: record what a source has caused at its start, and report to the sources."""
        if not stretch.opens:
            self._explain(stretch, self.agenda.schedule.outputs(position.segment))
        here, end = self.recorder.time, float(self.agenda.schedule.instants[position.segment + 1])
        events = self.recorder.boundaries.times[self._boundary :]
        self.ended = not self.agenda.accepts(self.recorder, events, complete)
        if self.recorder.time < here:
            self.dynamics.terminated = None  # what ended the run has been cut
        ended = here >= end or (complete and stretch.end >= end)
        return Position(position.segment + ended, here, False, False)

    def _explain(self, stretch: Stretch, outputs: Vector) -> None:
        """Record the causes of a stop that a source has made, or hide its rows from the result if there are none.

        A stretch that is tried again has only its own row in excess: those before it belong to the start of the run, to
        an instant of the schedule, or to what happened at the first attempt.
        """
        causes = (*stretch.causes, *self._flipped())
        if causes or any(self.recorder.boundaries.happenings[self._boundary]):
            self.recorder.explain(self._boundary, causes)
            return
        self.recorder.hide(self._row, self._boundary)
        if not self._again and not (np.abs(outputs - stretch.start) <= self.agenda.margin).any():
            self.recorder.hide(self._row - 1)

    def _flipped(self) -> tuple[Cause, ...]:
        """Relations that have changed at the start of the stretch."""
        assert self._before is not None, "set at the start of the stretch"
        compiled = self.recorder.compiled
        first = compiled.n_modes - len(compiled.state_events.relations)
        after = self.recorder.point(self._row)[3][first:]
        flipped = after != self._before.m[first:]
        held = list(self._before.regime.active_set.taken)  # recorded as the multipliers that hold them
        flipped[held] &= (after[held] <= 0.0) | (after[held] >= 1.0)
        texts, places = compiled.events.texts, compiled.events.places
        return tuple(Cause(texts[k], *places[k]) for k in np.flatnonzero(flipped).tolist())
