"""A run without state events: one call of the solver between two stops."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from acausal.arrays import Vector
from acausal.simulate.driver.agenda import Position, Schedule, Stretch
from acausal.simulate.driver.event_loop import EventLoop, suits_event_loop
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Moment
from acausal.simulate.events.regime import Regime
from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.divisors.pivots import loses_pivots, may_lose_pivots
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import MOST_STEPS, pace, program
from acausal.simulate.solvers.recovery import recover
from acausal.simulate.solvers.segment import Piece, Segment
from acausal.simulate.start.initialize import Start, consistent

_log = logging.getLogger(__name__)
# The number of steps times variables that takes about a second.
_LONG = 1e6
# The number of steps between two outputs beyond which a solver may be crawling towards a vanishing pivot.
_CRAWLING_STEPS = 400
# The number of parts, each with a limit of its own, of a run with too many steps between two outputs.
_PARTS = 10_000


@dataclass
class Smooth:
    """The dynamics of a model without state events; see `driver.Dynamics`.

    `report` is called with the times reached within a stretch [s].
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
        """States, variables and modes that the run has reached."""
        assert self._moment is not None, "a run begins before its first stretch"
        return self._moment

    @property
    def equations(self) -> Problem:
        """The equations that are integrated."""
        return self.problem

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """Take the start of the run."""
        self._moment = Moment(start.x, start.z, m, Regime(self.problem))

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """Take over values that were computed elsewhere."""
        self._moment = replace(self.reached, x=x, z=z, m=m)

    def enter(self, stretch: Stretch) -> None:
        """Solve for the algebraic variables with the modes of the stretch."""
        moment, problem = self.reached, self.problem
        m = moment.m.copy()
        m[: len(stretch.modes)] = stretch.modes
        start = Start(moment.x, moment.z, ())
        start = consistent(problem.compiled, stretch.start, start, problem.p, problem.u, m)
        self.moved(start.x, start.z, m)
        self.recorder.begin(stretch.start, start.x, start.z, m)

    def advance(self, stretch: Stretch, position: Position) -> None:
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
            # rows that were reached in smaller pieces are recorded already
            piece = self._record(times[times > self.recorder.time], piece)
            self.moved(piece.x[:, -1], piece.z[:, -1], moment.m)

    def _record(self, times: Vector, piece: Piece) -> Piece:
        return self.recorder.add(times, piece, self.reached.m)

    def _integrated(self, segment: Segment) -> Piece:
        """Call the solver; if it fails, recover in smaller pieces, whose rows are recorded."""
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
                    # its steps may have been limited only in order to examine the pivots
                    with suppress(RuntimeError):
                        return self._solved(replace(segment, step_budget=MOST_STEPS))
            if self.solver.multistep and "TOO_MUCH_WORK" in str(error):
                segment, whole = self._finer(segment)
                if whole is not None:
                    return whole
            self._failed, last = recover(partial(self.integrate, self.problem), segment, self._record)
            if last is not None:
                return last  # smaller pieces have reached the end
            raise

    def _solved(self, segment: Segment) -> Piece:
        """Call the solver; if it is interrupted, record its rows."""
        try:
            return self.integrate(self.problem, segment)
        except Interrupted as stop:
            if stop.piece is not None:
                self._record(segment.times[: stop.piece.x.shape[1]], stop.piece)
            raise

    def _finer(self, segment: Segment) -> tuple[Segment, Piece | None]:
        """Integrate a segment with too many steps between two outputs on a fine grid, which does not depend on outputs.

        The rest of the segment, and its rows if the end was reached. A run with few outputs is thus refused exactly if
        one with many is.
        """
        fine = np.linspace(segment.start, segment.times[-1], _PARTS + 1)[1:]
        refined = replace(segment, times=np.union1d(fine, segment.times), partial=True)
        try:
            piece = self._solved(refined)
        except RuntimeError:
            return segment, None
        count = piece.x.shape[1]
        rows = np.flatnonzero(np.isin(refined.times[:count], segment.times))
        due, x, z = refined.times[rows], piece.x[:, rows], piece.z[:, rows]
        if count == len(refined.times):
            return segment, Piece(x, z, piece.counters)
        if len(due):
            self._record(due, Piece(x, z, piece.counters))
        later, here = segment.times[segment.times > refined.times[count - 1]], float(refined.times[count - 1])
        return replace(segment, start=here, times=later, x=piece.x[:, -1], z=piece.z[:, -1]), None

    def _approached(self, segment: Segment) -> Segment:
        """Record the first rows of a segment that failed, up to where the solver crawls; the rest of it."""
        try:
            piece = self.integrate(self.problem, replace(segment, partial=True, step_budget=_CRAWLING_STEPS))
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

        There is only one chunk if nobody asks for progress. Otherwise the first fiftieth shows if more are worthwhile:
        each restarts the solver, which costs steps and accuracy. The criterion is the number of steps and not the time
        that they take, so that results are reproducible.
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
        """The compiled event loop, if it suits."""
        # a single segment is no slower without, and can be divided; steep functions are searched after each call
        if schedule.segments < 2 or self.problem.compiled.is_steep or not suits_event_loop(self.problem, self.solver):
            return None
        return EventLoop(self.problem, self.recorder, schedule, self.template, self.span)

    def library(self) -> Library[EventLoopProgram] | None:
        """The compiled integrator, if there is any."""
        return program(self.problem, self.solver, self.template)

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated."""
        if self._failed is not None:
            return self._failed
        here, moment = self.recorder.time if self.recorder.segments else self.template.start, self.reached
        return replace(self.template, start=here, times=times[times > here], x=moment.x, z=moment.z, p=moment.m)

    def end(self, t: float, samples: Vector) -> None:
        """Nothing happens at the end."""
