"""A run without events of variables: one call of the solver between two stops."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.driver.agenda import Place, Schedule, Stretch
from acausal.simulate.driver.event_loop import EventLoop, suits_event_loop
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Moment
from acausal.simulate.events.regime import Regime
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.pivots import loses_pivots, may_lose_pivots
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import MOST_STEPS, pace, program
from acausal.simulate.solvers.recovery import recover
from acausal.simulate.solvers.segment import Piece, Segment
from acausal.simulate.start.initialize import Start, consistent

_log = logging.getLogger(__name__)
# Steps times variables that take about a second.
_LONG = 1e6
# Steps between two output times from which on it is looked whether a solver crawls to a vanishing pivot.
_FEW_STEPS = 400
# Pieces of a run whose steps are counted in each when there are too many between two outputs.
_FINER = 10_000


@dataclass
class Smooth:
    """The dynamics of a model without events of variables; see `driver.Dynamics`.

    `report` is told the time reached within a stretch, None when nobody asks.
    """

    problem: Problem
    solver: Solver
    recorder: Recorder
    integrate: Callable[[Problem, Segment], Piece]
    template: Segment
    span: float
    report: Callable[[float], None] | None = None
    terminated: str | None = None
    pace: float = 0.0
    _moment: Moment | None = None
    _failed: Segment | None = None

    @property
    def reached(self) -> Moment:
        """Where the run is."""
        assert self._moment is not None, "a run begins before its first stretch"
        return self._moment

    @property
    def equations(self) -> Problem:
        """The equations that are integrated."""
        return self.problem

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """The start of the run."""
        self._moment = Moment(start.x, start.z, m, Regime(self.problem))

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """The run was brought to these values from outside."""
        self._moment = replace(self.reached, x=x, z=z, m=m)

    def enter(self, stretch: Stretch) -> None:
        """Algebraic variables under the modes of the stretch."""
        moment, problem = self.reached, self.problem
        m = moment.m.copy()
        m[: len(stretch.modes)] = stretch.modes
        start = Start(moment.x, moment.z, ())
        start = consistent(problem.compiled, stretch.start, start, problem.p, problem.u, m)
        self.moved(start.x, start.z, m)
        self.recorder.begin(stretch.start, start.x, start.z, m)

    def advance(self, stretch: Stretch, place: Place) -> None:
        """Integrate to the end of the stretch."""
        for times in self._parts(stretch.times):
            moment = self.reached
            here = replace(
                self.template,
                start=float(self.recorder.time),
                times=times,
                x=moment.x,
                z=moment.z,
                p=moment.m,
                first=self.pace,
                max_step=stretch.longest,
            )
            piece = self._integrated(here)
            self.pace = pace(here.start, float(times[-1]), piece.counters)
            # what smaller pieces have reached is recorded already
            piece = self._record(times[times > self.recorder.time], piece)
            self.moved(piece.x[:, -1], piece.z[:, -1], moment.m)

    def _record(self, times: Vector, piece: Piece) -> Piece:
        return self.recorder.add(times, piece, self.reached.m)

    def _integrated(self, segment: Segment) -> Piece:
        """Call the solver; where it fails, record what smaller pieces reach."""

        try:
            return self._solved(segment)
        except RuntimeError as error:
            _log.debug("%s: %s", self.solver.name, error)
            if may_lose_pivots(self.problem.compiled):
                segment = self._approached(segment)
                if loses_pivots(self.recorder, segment):
                    self._failed = segment
                    raise
                if not self.solver.multistep:
                    # what bounded its steps was the look at the pivots
                    with suppress(RuntimeError):
                        return self._solved(replace(segment, step_budget=MOST_STEPS))
            if self.solver.multistep and "TOO_MUCH_WORK" in str(error):
                segment, whole = self._finer(segment)
                if whole is not None:
                    return whole
            self._failed, last = recover(partial(self.integrate, self.problem), segment, self._record)
            if last is not None:
                return last  # in smaller pieces it went through
            raise

    def _solved(self, segment: Segment) -> Piece:
        """Call the solver; its rows are recorded if it is interrupted."""
        try:
            return self.integrate(self.problem, segment)
        except Interrupted as stop:
            if stop.got is not None:
                self._record(segment.times[: stop.got.x.shape[1]], stop.got)
            raise

    def _finer(self, segment: Segment) -> tuple[Segment, Piece | None]:
        """A segment that needs more steps between two outputs than is allowed, on a grid that knows of no outputs.

        What is left of it, and the rows of that when it was passed. Where the run has few outputs, it is refused where
        one with many is.
        """
        fine = np.linspace(segment.start, segment.times[-1], _FINER + 1)[1:]
        asked = replace(segment, times=np.union1d(fine, segment.times), partial=True)
        try:
            piece = self._solved(asked)
        except RuntimeError:
            return segment, None
        count = piece.x.shape[1]
        rows = np.flatnonzero(np.isin(asked.times[:count], segment.times))
        due, x, z = asked.times[rows], piece.x[:, rows], piece.z[:, rows]
        if count == len(asked.times):
            return segment, Piece(x, z, piece.counters)
        if len(due):
            self._record(due, Piece(x, z, piece.counters))
        later, here = segment.times[segment.times > asked.times[count - 1]], float(asked.times[count - 1])
        return replace(segment, start=here, times=later, x=piece.x[:, -1], z=piece.z[:, -1]), None

    def _approached(self, segment: Segment) -> Segment:
        """What is left of a segment that failed when its first rows, up to where the solver crawls, are recorded."""
        try:
            piece = self.integrate(self.problem, replace(segment, partial=True, step_budget=_FEW_STEPS))
        except RuntimeError:
            return segment
        count = min(piece.x.shape[1], len(segment.times) - 1)
        if not count:
            return segment
        times = segment.times
        piece = self._record(times[:count], replace(piece, x=piece.x[:, :count], z=piece.z[:, :count]))
        return replace(segment, start=float(times[count - 1]), times=times[count:], x=piece.x[:, -1], z=piece.z[:, -1])

    def _parts(self, times: Vector) -> Iterator[Vector]:
        """Output times in chunks, after each of which progress is reported and the run can be stopped.

        One without progress; with it, the first fiftieth tells whether there is reason for more: each chunk restarts
        the solver, at the cost of steps and of accuracy. Steps are counted, not seconds, so that a run gives the same
        result every time.
        """
        if self.report is None or len(times) < 100:
            yield times
            return
        before = self.recorder.counters.get("steps", 0.0)
        few = len(times) // 50
        yield times[:few]
        self.report(self.recorder.time)
        steps = 50.0 * (self.recorder.counters.get("steps", 0.0) - before)
        compiled = self.problem.compiled
        work = steps * (10 + len(compiled.states) + len(compiled.algebraic)) / _LONG
        parts = np.array_split(times[few:], int(np.clip(12 * work, 12, 50)) if work > 1.0 else 1)
        for part in parts[:-1]:
            yield part
            self.report(self.recorder.time)
        yield parts[-1]

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """How compiled code passes the segments by itself, if it can."""
        # one segment is faster as it is, and can be passed in parts; what is steep is looked at behind the solver
        if schedule.segments < 2 or self.problem.compiled.is_steep or not suits_event_loop(self.problem, self.solver):
            return None
        return EventLoop(self.problem, self.recorder, schedule, self.template, self.span)

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled integrator, if there is one."""
        return program(self.problem, self.solver, self.template)

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated."""
        if self._failed is not None:
            return self._failed
        here, moment = self.recorder.time, self.reached
        return replace(self.template, start=here, times=times[times > here], x=moment.x, z=moment.z, p=moment.m)

    def end(self, t: float, samples: Vector) -> None:
        """Nothing happens at the end."""
