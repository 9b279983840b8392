"""Locates events: a solver only returns its solution at given times.

It is given mesh points, instants at which it returns the solution, and may take a few steps from each to the
next; where it needs more, it stops, and is restarted from there with closer mesh points. So no step ends far from a
mesh point, whatever the output interval and the length of the run, and only a few mesh points are integrated with
frozen modes beyond an event and discarded. Where a guard is passed, or may be within the error of its interpolation
(`between.py`), the interval is sampled more finely from the mesh point before.

Mesh points are those of a few grids (`mesh.py`), whose integrators are cached. Outputs and instants of events lie
between them: they are interpolated where an error estimate permits it (`between.py`), and integrated to otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.events.guards import AT_REST, STILL, Guards, Moment
from acausal.simulate.events.location import mesh as meshing
from acausal.simulate.events.location.arrival import Arrival, first_passed, polished, root_after, up_to
from acausal.simulate.events.location.between import left_guards
from acausal.simulate.events.location.lingering import Overdue, overdue
from acausal.simulate.events.location.outputs import NotDelivered, outputs
from acausal.simulate.events.location.task import FIRST_POINTS, MOST_STEPS, Mesh, Record, Task, needs_more_steps
from acausal.simulate.events.location.turning import excursions
from acausal.simulate.events.location.withdrawn import Withdrawn
from acausal.simulate.events.regime import Regime
from acausal.simulate.events.resolution.patience import Patience
from acausal.simulate.events.resolution.phases import first_swing
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import SEARCHED_STEPS, on_equations, pace, quadratures_at
from acausal.simulate.solvers.segment import Piece, Segment, add_counters

Integrate = Callable[[Regime, Segment], Piece]

# The number of steps of a solver aimed at from one mesh point to the next, and the most where an interval is integrated
# again with finer mesh points.
_WANTED_STEPS, _MOST_STEPS_AGAIN = 2.0, 400
# The tightest tolerance that rounding errors permit.
_FINEST = 1e-14
# The number of parts of an interval with a crossing, and how often it is divided. A piece that fails is shortened by
# the first of these factors.
_DIVISION, _DEEPEST = 16, 8
# Iterations of Newton's method for an instant, from this one on only towards the passed side. They end at this fraction
# of the noise.
_ONE_SIDED, _MOST_ITERATIONS, _CLOSE = 2, 7, 1e-3
# How often an interval is halved instead, where the guard does not fall.
_MOST_TURNS = 20
# The factor of the distance of mesh points after a piece that has stopped, and the largest number of its powers after
# several such pieces in a row.
_SHRINKAGE, _MOST_SHRINKAGES = 0.2, 3
# The factor after two intervals in a row in which guards may have been passed, but were not.
_CLOSER = 0.25
# One-step methods end a step at each mesh point, and restart at no cost: the first call of a stretch has few points
# (`FIRST_POINTS`), each later one twice as many, and a run has at least so many. The least factor by which the distance
# of mesh points changes from piece to piece, and the one if each of them took a single step.
_FEWEST_IN_RUN = 64
_LEAST_CHANGE, _MOST_CHANGE = 0.25, 4.0
# The factor by which later calls have more fixed steps; the first has few, as a doubt is most likely at a start.
_FIXED_GROWTH = 256
# The horizon of a piece in lengths of the last stretches, and in those of the stretch before it, and the fewest mesh
# points up to there. One-step methods look less far ahead, which costs them nothing.
_HORIZON, _GROWTH, _LEAST_POINTS = 8.0, 16.0, 64
_NEARER = 4.0
# The number of mesh points at the start of a stretch that are its opening, in which a stop changes `openings`; and the
# factor by which they are farther apart the next time if there was no stop.
_OPENING_POINTS, _WIDENING = 16.0, 2.0
# The number of failures, and the number of steps, over which the run must have advanced by this fraction of its length.
_MOST_FAILURES, _PROGRESS = 100, 1e-6
_MOST_STEPS_STUCK, _ADVANCE = 20_000, 1e-4
# The number of parts of a stretch without guards that needs more steps than one call of a solver may take.
_PARTS = 1000


@dataclass
class Search:
    """Searches the stretches of one run for events; the distance of mesh points is carried from one to the next."""

    guards: Guards
    solver: Solver
    integrate: Integrate
    span: float
    spacing: float = np.inf
    pace: float = 0.0
    openings: dict[bytes, float] = field(default_factory=dict)
    """The distance of the first mesh points of a stretch [s], for each set of relations that hold in it."""

    def __post_init__(self) -> None:
        self.patience = Patience(self.span)

    def to_event(self, segment: Segment, moment: Moment, band: Vector, gap: float, record: Record) -> Arrival:
        """Integrate with the modes of a moment to the next event, or to the end of a segment.

        Raises RuntimeError if the solver cannot continue; rows before that are recorded.

        `band`: How far below zero each guard may be; shape (guards,).
        `gap`: The approximate length of such stretches [s]; inf if it is not known.
        `record`: Called with the rows at times of the segment, as they become available.
        """
        task = self._task(segment, moment, band, record)
        end = float(segment.times[-1])
        while True:
            here = task.segment.start
            near = 1.0 if self.solver.multistep else _NEARER
            ahead = max(_HORIZON / near * gap, _GROWTH / near * (here - segment.start), 1e-9 * self.span)
            marks, part = self._next_part(task, min(end, here + ahead))
            piece = self._attempted(moment.regime, part)
            count = piece.x.shape[1]
            if not count:
                self._shorten(task, marks, piece.stopped)
                continue
            self._note_step(task, float(part.times[count - 1]), piece)
            rows = self._mesh_rows(part, count, marks)
            mesh = self._mesh(task, part, piece, rows)
            found = self._swings(task, mesh, piece, rows, self._suspect(task, mesh, piece, rows))
            late = None
            if found is None and not (self.solver.multistep or task.finer):
                piece_values = mesh.values[mesh.start :]
                late = overdue(
                    self.guards, task.moment, mesh.times[mesh.start :], piece_values, task.largest, piece, rows
                )
            if late is not None:
                arrival = self._hastened(task, part, piece, mesh, rows, late)
                if arrival is not None:
                    return arrival
                continue
            # without the interval before a failure, as nothing is known of the guards after it
            keep, finer = int(rows[-2]) + 1 if piece.stopped and len(rows) > 2 else count, task.finer[:0]
            if found is not None:
                row, passed = found
                left, right = float(mesh.times[row]), float(mesh.times[row + 1])
                # what lies beyond is computed again: no more of it than is used
                task.most_points = max(FIRST_POINTS, 2 ** (row - mesh.start).bit_length())
                if passed and not task.finer:
                    at = self._at(task, mesh, row, piece, rows)
                    task.withdrawn.add(self.guards, left, at, mesh.values[row + 1] < 0.0)
                    left = float(mesh.times[self._last_certain(task, mesh, row, piece, rows)])
                keep = int(np.searchsorted(part.times[:count], left, side="right"))
                if not passed or not self._is_located(task, mesh, row, right - left):
                    finer = [(right, (right - left) / _DIVISION)]
                    if not task.finer:
                        if left <= task.looked_until:
                            self.spacing = min(self.spacing, _CLOSER * (right - left))
                        task.looked_until = right
                elif not self._rests(task, mesh, row, piece, rows):
                    return self._arrival(task, mesh, row, part, piece)
            try:
                self._accept(task, part, piece, mesh, keep)
            except NotDelivered as error:  # between closer mesh points they can be interpolated
                self._shorten(task, marks, str(error))
                continue
            if found is None:
                self._adapt(task, np.append(here, part.times[rows]), piece, end)
            task.finer += finer
            while task.finer and task.segment.start >= task.finer[-1][0]:
                task.finer.pop()
                self._rest(task, task.segment.start, task.segment.x, task.segment.z)
            if task.segment.start >= end:
                return Arrival(None, self._complete(task, end, task.segment.x), task.segment.z)

    def relax(self, mean_step: float = 0.0) -> None:
        """Set the step over which errors have relaxed, from this and earlier pieces; explicit steps relax none."""
        if not self.solver.explicit:
            self.guards.step = min(self.pace, mean_step) if self.pace and mean_step else self.pace or mean_step

    def _note_step(self, task: Task, end: float, piece: Piece) -> None:
        mean_step = pace(task.segment.start, end, piece.counters)
        self.relax(mean_step)
        if not (self.solver.multistep or task.finer):
            self.pace = mean_step or self.pace

    def _task(self, segment: Segment, moment: Moment, band: Vector, record: Record) -> Task:
        start, band = left_guards(self.guards, segment.start, moment, band)
        values = start.values
        times = np.array([segment.start])
        bare = replace(segment, partial=True, bare=True)
        task = Task(bare, moment, band, start, record, times, values[None, :], values, segment, Withdrawn(values))
        task.failures_from = task.steps_from = segment.start
        task.relations = moment.m[self.guards.first :].tobytes()
        return task

    def _rest(self, task: Task, t: float, x: Vector, z: Vector) -> Truth:
        """Guards that have come to rest on zero since the stretch began; their noise is added to `task.band`.

        A capacitor that discharges through 1e-5 Ohm is empty after a microsecond. Whether its voltage is then 1e-90 or
        -1e-90 V depends on rounding errors, and is no crossing to be located. A guard that falls at a rate still is.
        """
        at = replace(task.moment, x=x, z=z)
        g, rate, noise = self.guards.state(t, at)
        moved = np.abs(g) + np.abs(rate) * (t - task.start.time)
        resting: Truth = (moved <= STILL * noise) & (rate >= -noise) & ~task.start.leaving
        if resting.any():
            noise = self.guards.steady(t, at, noise)
            resting &= moved <= STILL * noise
        task.band = np.where(resting, np.maximum(task.band, 2.0 * STILL * noise), task.band)
        return resting

    def _next_part(self, task: Task, limit: float) -> tuple[Vector, Segment]:
        """The next mesh points, and the segment up to the last of them, with outputs in between if it needs them."""
        segment, problem = task.segment, task.moment.regime.problem
        here, outputs = segment.start, segment.times
        if not task.moment.regime.active_set.owners:
            if not task.is_split or segment.step is not None:
                return outputs, segment
            times = np.union1d(np.linspace(here, outputs[-1], _PARTS + 1)[1:], outputs)
            return times, replace(segment, times=times)
        least, part = meshing.resolution(here, self.span), segment
        if task.finer:  # a small error of a stiff variable may move the instant of its guard far
            part = replace(part, tolerances=segment.tolerances.scaled(task.tolerance_factor, least=_FINEST))
            until, spacing = task.finer[-1]
            length, fractions = until - here, meshing.even(max(2, round((until - here) / spacing)))
            first = self._first(task, part, length) if self.solver.multistep else 0.0
            part = replace(part, first=first, step_budget=_MOST_STEPS_AGAIN)
        elif segment.step is not None:
            most = meshing.most_points(problem, fixed=True)
            if limit >= outputs[-1]:  # no earlier stretch shows how far it is to an event
                most = min(most, task.most_points)
            count = max(1, int(most * task.shrink))
            marks = meshing.stepped(here, outputs, limit, segment.step, count)
            return marks, replace(part, times=marks)
        else:
            fewest = _LEAST_POINTS if self.solver.multistep else _LEAST_POINTS / _NEARER
            spacing = min(self._spacing(task), (limit - here) / fewest)
            length, fractions, part = self._grid(task, part, limit - here, task.shrink * spacing, least)
            until = limit if length == limit - here else here + length
        marks = np.asarray(here + length * fractions)
        marks[-1] = until
        if segment.step is None:
            return marks, replace(part, times=marks, fractions=fractions)
        marks, times = meshing.merged(marks, outputs)
        return marks, replace(part, times=times)

    def _grid(
        self, task: Task, part: Segment, horizon: float, spacing: float, least: float
    ) -> tuple[float, Vector, Segment]:
        """How far mesh points of this distance reach [s], their fractions of that, and the part with its first step."""
        problem = task.moment.regime.problem
        most = meshing.most_points(problem)
        if not self.solver.multistep:
            length, fractions = meshing.growing(
                horizon, np.inf, min(spacing, self.span / _FEWEST_IN_RUN), min(task.most_points, most), least
            )
            first = min(self.pace, length) if task.shrink == 1.0 else 0.0  # it may be much too short, not only too long
            budget = task.steps_allowed if first else task.steps_allowed + SEARCHED_STEPS - MOST_STEPS
            return length, fractions, replace(part, first=first, step_budget=budget)
        first = self._first(task, part, horizon)
        length, fractions = meshing.growing(horizon, first, spacing, most, least)
        first_step = meshing.first_step_on(fractions, length, first)
        doublings = math.ceil(math.log2(max(float(fractions[0]) * length / first_step, 16.0))) - 4
        budget = task.steps_allowed + 4 * math.ceil(doublings / 4)
        return length, fractions, replace(part, first=first_step, step_budget=budget)

    def _spacing(self, task: Task) -> float:
        """The distance of the next mesh points [s]; at the start of a stretch that of those with the same relations."""
        if task.segment.start > task.start.time:
            return self.spacing
        return self.openings.get(task.relations, self.spacing)

    def _first(self, task: Task, part: Segment, horizon: float) -> float:
        """The first step of a multistep method [s]; inf for problems without states."""
        if not task.moment.regime.problem.n_dynamic:
            return np.inf
        return task.shrink * meshing.first_step(task.moment.regime.problem, part, horizon)

    def _solved(self, regime: Regime, segment: Segment) -> Piece:
        """Integrate with a cached integrator; if it fails, with one that begins with derivatives (no `fractions`)."""
        try:
            return self.integrate(regime, segment)
        except RuntimeError as error:
            if segment.fractions is None or "TOO_MUCH_WORK" in str(error):
                raise
            return self.integrate(regime, replace(segment, fractions=None, first=0.0))

    def _attempted(self, regime: Regime, segment: Segment) -> Piece:
        try:
            return self._solved(regime, segment)
        except RuntimeError as error:
            return Piece(np.zeros((len(segment.x), 0)), np.zeros((len(segment.z), 0)), {}, str(error))

    def _shorten(self, task: Task, marks: Vector, message: str) -> None:
        """Shorten the next piece after a failure without a single row; RuntimeError if it cannot be any shorter."""
        here = task.segment.start
        task.failures += 1
        if task.failures % _MOST_FAILURES == 0:  # near a pole, ever smaller pieces succeed
            if here - task.failures_from < _PROGRESS * self.span:
                raise RuntimeError(message)
            task.failures_from = here
        if not task.moment.regime.active_set.owners:
            if task.is_split or not needs_more_steps(message):
                raise RuntimeError(message)
            task.is_split = True
            return
        if task.finer and task.tolerance_factor < 1.0 and not needs_more_steps(message):
            task.tolerance_factor = 1.0  # rounding errors of voltages over micro-ohms exceed the stricter tolerance
            return
        if float(marks[0]) - here <= 2.0 * meshing.resolution(here, self.span):
            # a start at a kink may take many tiny steps
            if not needs_more_steps(message) or task.steps_allowed >= _MOST_STEPS_STUCK:
                raise RuntimeError(message)
            task.steps_allowed *= _DIVISION
            return
        if task.finer:
            right = float(marks[0])
            task.finer.append((right, (right - here) / _DIVISION))
            if len(task.finer) > 2 * _DEEPEST:
                raise RuntimeError(message)
        else:
            task.shrink /= _DIVISION
            if task.shrink < 1e-15:
                raise RuntimeError(message)

    def _mesh_rows(self, part: Segment, count: int, marks: Vector) -> NDArray[np.int64]:
        """Which of the first `count` rows are mesh points."""
        if part.fractions is not None or marks is part.times:
            return np.arange(count)
        reached = marks[: np.searchsorted(marks, part.times[count - 1], side="right")]
        return np.searchsorted(part.times[:count], reached)

    def _mesh(self, task: Task, part: Segment, piece: Piece, rows: NDArray[np.int64]) -> Mesh:
        moment, known = task.moment, len(task.times)
        times, plain = part.times[rows], np.zeros((len(rows), len(task.band)))
        if moment.regime.active_set.owners and len(rows):
            x, z = (piece.x, piece.z) if len(rows) == piece.x.shape[1] else (piece.x[:, rows], piece.z[:, rows])
            plain = self.guards.along(times, x, z, moment.m, moment.regime)
            if task.band.any():
                plain = plain + task.band
        times, values = np.concatenate([task.times, times]), np.concatenate([task.values, plain])
        # at rows before the start, too, where a jump of the allowance would look like a guard that turns back
        near = task.start.near(times)
        head = values[: len(near)].copy()
        values[: len(near)] += near
        least = values[known:].min(axis=0, initial=np.inf)
        if len(times) > known:
            highest = values[known:].max(axis=0)
            task.withdrawn.reach(highest)
            task.largest = np.maximum(task.largest, np.maximum(highest, -least))
        return Mesh(times, head, values, task.start.judged(times, values), least, known - 1)

    def _suspect(self, task: Task, mesh: Mesh, piece: Piece, rows: NDArray[np.int64]) -> tuple[int, bool] | None:
        """The row at the start of the first interval in which a guard is passed (True) or may be (False), or None."""
        if not task.moment.regime.active_set.owners:
            return None
        last, is_passed = len(mesh.times), False
        low = np.flatnonzero(~(mesh.least >= 0.0))
        if len(low):  # or nan
            below = (mesh.values[mesh.start + 1 :, low] < 0.0).any(axis=1)
            is_passed = bool(below.any())
            last = mesh.start + 1 + int(np.argmax(below)) if is_passed else last
        if len(task.finer) < _DEEPEST:
            # with two neighbours beyond the one that is passed, which show how guards bend
            until = last + 1 + int(np.isfinite(mesh.judged[last + 1 : last + 3]).all(axis=1).cumprod().sum())
            count = min(last, len(mesh.times) - 1)
            bounds, may_pass = excursions(self.guards, task, mesh, piece, rows, count, until)
            for row in np.flatnonzero(may_pass.any(axis=1)).tolist():
                if self._is_significant(task, mesh, row, bounds[row], may_pass[row], piece, rows):
                    return row, False
        return (last - 1, True) if is_passed else None

    def _swings(
        self, task: Task, mesh: Mesh, piece: Piece, rows: NDArray[np.int64], found: tuple[int, bool] | None
    ) -> tuple[int, bool] | None:
        """`found`, or an interval up to there in which a phase advances so far that the guards between are unknown."""
        times, until = mesh.times[mesh.start :], len(rows) if found is None else found[0] - mesh.start + 1
        k, spacing = first_swing(self.guards, self.patience, task.moment, task.segment, times, piece, rows, until)
        if k is None or len(task.finer) >= _DEEPEST:
            return found
        self.spacing = min(self.spacing, spacing)
        return mesh.start + k, False

    def _at(self, task: Task, mesh: Mesh, row: int, piece: Piece, rows: NDArray[np.int64]) -> Moment:
        """The moment at a row of the mesh of a piece."""
        if row == mesh.start:
            return replace(task.moment, x=task.segment.x, z=task.segment.z)
        k = rows[row - mesh.start - 1]
        return replace(task.moment, x=piece.x[:, k], z=piece.z[:, k])

    def _is_significant(
        self, task: Task, mesh: Mesh, row: int, low: Vector, may_pass: Truth, piece: Piece, rows: NDArray[np.int64]
    ) -> bool:
        """Whether guards may fall below zero after a row, or by more than their error if they are within it there."""
        t, end = mesh.times[row : row + 2].tolist()
        if end - t <= _DIVISION * meshing.resolution(t, self.span):
            return False
        noise = 2.0 * self.guards.rates(t, self._at(task, mesh, row, piece, rows))[1]
        noise[task.start.leaving] /= max(t - task.start.time, end - t)
        if not task.finer:
            task.away = mesh.are_away(row, noise)
        noise[task.away] = 0.0
        return bool((low < -noise)[may_pass].any())

    def _hastened(
        self, task: Task, part: Segment, piece: Piece, mesh: Mesh, rows: NDArray[np.int64], late: Overdue
    ) -> Arrival | None:
        """Continue before an overdue guard came within its error, where it counts as passed; or the event at once."""
        if late.entry:
            row = late.entry - 1
            self._accept(task, part, piece, mesh, int(rows[row - 1]) + 1 if row else 0)
            shift = np.where(np.arange(len(task.band)) == late.guard, late.noise, 0.0)
            task.band, task.values = task.band - shift, task.values - shift
            return None
        if task.segment.start == task.start.time:
            self._accept(task, part, piece, mesh, piece.x.shape[1])
        t, x = task.segment.start, task.segment.x
        return Arrival(t, self._complete(task, t, x), task.segment.z)

    def _last_certain(self, task: Task, mesh: Mesh, row: int, piece: Piece, rows: NDArray[np.int64]) -> int:
        """The last row up to this one at which the guards that are passed after it exceed their error.

        The error of a component that follows a source is larger between steps of a solver than at their ends, so that a
        crossing may have happened before a mesh point at which the guard is still positive.
        """
        passed = mesh.values[row + 1] < 0.0
        while row > mesh.start:
            at = self._at(task, mesh, row, piece, rows)
            noise = self.guards.rates(float(mesh.times[row]), at, between=True)[1]
            if (mesh.values[row] > noise)[passed].all():
                break
            row -= 1
        return row

    def _adapt(self, task: Task, times: Vector, piece: Piece, end: float) -> None:
        """Adapt the distance of mesh points to the steps of the last piece."""
        if task.finer or not task.moment.regime.active_set.owners:
            return
        if task.segment.step is not None:
            task.most_points *= _FIXED_GROWTH
            return
        if len(times) < 2:
            return
        task.shrink, task.steps_allowed, task.most_points = 1.0, MOST_STEPS, 2 * task.most_points
        task.stops = task.stops + 1 if piece.stopped else 0
        gaps = np.diff(times)
        last = float(gaps[-2:].max()) if len(gaps) > 1 else float(gaps[-1])
        opens = float(times[-1]) <= task.start.time + _OPENING_POINTS * last
        if piece.stopped:  # closer than the steps were, because they are shorter after a restart
            self.spacing = _SHRINKAGE ** min(task.stops, _MOST_SHRINKAGES) * float(gaps[-1])
            if opens:
                self.openings[task.relations] = self.spacing
            return
        ramp = int(np.sum(gaps[1:] > 1.5 * gaps[:-1])) + 1
        steps, widening = piece.counters.get("steps", 0.0), _WIDENING
        if self.solver.multistep:
            rate = max(steps - 3.0 * ramp, 0.02 * len(gaps)) / max(len(gaps) - ramp, 1)
            self.spacing = last * float(np.clip(_WANTED_STEPS / rate, 0.25, 100.0))
        else:  # with one step each, points may be much too close, unless compiled steps have several of them inside
            rate = max(steps / len(gaps), 0.02)
            change = max(_WANTED_STEPS / rate, _LEAST_CHANGE) if abs(rate - 1.0) > 0.2 else _MOST_CHANGE
            widening = change if rate < 0.8 else _WIDENING
            self.spacing = last * change
        if float(times[0]) == task.start.time:
            first_spacing = float(gaps[min(ramp, len(gaps) - 1)])
            self.openings[task.relations] = first_spacing if times[-1] >= end else widening * first_spacing
        self.pace = (times[-1] - times[0]) / steps if steps else self.pace

    def _accept(self, task: Task, part: Segment, piece: Piece, mesh: Mesh, keep: int) -> None:
        """Record the outputs up to the last of the first `keep` rows, and continue from there."""
        if not keep:
            return
        segment = task.segment
        times = part.times[:keep]
        counters = dict(piece.counters)
        here = float(times[-1])
        passed = int(np.searchsorted(segment.times, here, side="right"))
        due = segment.times[:passed]
        x, z = outputs(self.integrate, task.moment.regime, segment, part, piece, due, counters)
        self._add_quadratures(task, due, x)
        task.record(due, Piece(x, z, counters))
        task.steps += counters.get("steps", 0.0)
        advance = (here - task.steps_from) / (_ADVANCE * self.span)
        if task.steps > _MOST_STEPS_STUCK * max(advance, 1.0):
            raise RuntimeError("TOO_MUCH_WORK: the run makes hardly any progress")
        if advance >= 1.0:
            task.steps_from, task.steps = here, 0.0
        x, z = piece.x[:, keep - 1], piece.z[:, keep - 1]
        task.segment = replace(segment, start=here, times=segment.times[passed:], x=x, z=z)
        if not task.moment.regime.active_set.owners:
            return
        # the parabolas of the next piece need the last mesh points of this one
        last = int(np.searchsorted(mesh.times, here)) + 1
        task.times, task.values = mesh.times[max(0, last - 3) : last], mesh.plain(max(0, last - 3), last)

    def _is_located(self, task: Task, mesh: Mesh, row: int, width: float) -> bool:
        """Whether an interval in which a guard is passed is short enough to take the root of its interpolant.

        It is not if all guards that are passed have left zero at the start of the stretch, because the end of a short
        hop must not be taken for its beginning; nor if one has come to rest, because it jumps there and has no root.
        """
        if width <= _DIVISION * meshing.resolution(float(mesh.times[row]), self.span):
            return True
        if not task.finer or len(task.finer) >= _DEEPEST:
            return bool(task.finer)
        passed = mesh.values[row + 1] < 0.0
        if (passed & self._jumps(task, mesh.plain(row, row + 2))).any():
            return False
        return not (float(mesh.times[row]) == task.start.time and task.start.leaving[passed].all())

    def _jumps(self, task: Task, values: Vector) -> Truth:
        """Guards that are at rest, where they have the value `AT_REST`, at one of these rows; shape (guards,)."""
        rests = self.guards.rests[task.moment.regime.active_set.owner]
        return np.asarray(rests & (np.abs(values) == AT_REST).any(axis=0))

    def _rests(self, task: Task, mesh: Mesh, row: int, piece: Piece, rows: NDArray[np.int64]) -> bool:
        """Whether all guards that are passed after a row have come to rest there."""
        at, passed = self._at(task, mesh, row, piece, rows), mesh.values[row + 1] < 0.0
        allowed = task.band.copy()
        return bool((self._rest(task, float(mesh.times[row]), at.x, at.z) & (task.band > allowed))[passed].all())

    def _arrival(self, task: Task, mesh: Mesh, row: int, part: Segment, piece: Piece) -> Arrival:
        """Locate the event between two mesh points: by the root of the interpolated guards, then by Newton's method."""
        segment, moment = task.segment, task.moment
        left, right = float(mesh.times[row]), float(mesh.times[row + 1])
        passed = np.flatnonzero(mesh.values[row + 1] < 0.0)
        root, which = min((root_after(mesh.times, mesh.values[:, k], mesh.start, row), int(k)) for k in passed)
        jumps = self._jumps(task, mesh.plain(row, row + 2))
        counters: dict[str, float] = {}
        t, x, z = segment.start, segment.x, segment.z
        smallest, noise = meshing.resolution(root, self.span) / 16, task.largest
        turns, value = 0, math.inf
        for iteration in range(_MOST_ITERATIONS + _MOST_TURNS):
            t = min(max(root, left), right)
            if t - segment.start <= smallest:
                t, x, z = segment.start, segment.x, segment.z
            else:
                # so that the instant is the end of a step
                last = self._solved(moment.regime, up_to(part, t))
                x, z = last.x[:, -1], last.z[:, -1]
                add_counters(counters, last.counters)
                if jumps[which] and len(z):  # as the event iteration will do
                    there = replace(segment, times=np.array([t]))
                    z = on_equations(moment.regime.problem, there, x[:, None], z[:, None])[:, 0]
            at = replace(moment, x=x, z=z)
            distances, rate, noise = self.guards.state(t, at)
            values = distances + task.band + task.start.near(np.array([t])).sum(axis=0)
            value = float(values[which])
            first = first_passed(passed, which, values, rate, noise)
            if first != which and turns < _MOST_TURNS:
                which, right, root, turns = first, t, t - float(values[first] / rate[first]), turns + 1
                continue
            if iteration + 1 - turns == _MOST_ITERATIONS:
                break
            if jumps[which] and value > 0.0:  # this integration comes to rest at another instant
                right = t + _DIVISION * max(right - left, smallest)
                root = right
                continue
            if jumps[which]:
                break
            # a guard that jumps, or an excursion of which Newton's method would find the end
            if rate[which] >= 0.0 and abs(value) > _CLOSE * noise[which] and turns < _MOST_TURNS:
                left, right, turns = (left, t, turns + 1) if value < 0.0 else (t, right, turns + 1)
                root = right if turns == _MOST_TURNS else 0.5 * (left + right)
                continue
            if rate[which] == 0.0:
                break
            step = -value / float(rate[which])  # nan where the slope of a function overflows
            if abs(step) <= smallest or abs(value) <= _CLOSE * noise[which] or not abs(step) <= right - left:
                break
            if iteration - turns >= _ONE_SIDED:
                # only the errors of these integrations are left; a guard that is passed does not flip back
                if value < 0.0:
                    break
                step *= 4.0
            root = t + step
        watched = moment.regime.active_set.owners[which][0] in moment.regime.problem.compiled.state_events.watched
        if not (jumps[which] or watched) and abs(value) <= _CLOSE * noise[which]:
            t, at = polished(self.guards, segment, replace(moment, x=x, z=z), t, which, value, right)
            x, z = at.x, at.z
        due = segment.times[: np.searchsorted(segment.times, t)]
        earlier = outputs(self.integrate, task.moment.regime, segment, part, piece, due, counters)
        self._add_quadratures(task, due, earlier[0])
        add_counters(counters, piece.counters)
        task.record(due, Piece(*earlier, counters))
        x = self._complete(task, t, x)
        widest = self.guards.rates(t, replace(moment, x=x, z=z), between=True)[1]
        vague, small = (which if n[which] > task.largest[which] else None for n in (noise, widest))
        return Arrival(t, x, z, vague, small)

    def _complete(self, task: Task, t: float, x: Vector) -> Vector:
        """All states at the end of a stretch, quadratures included."""
        found = x[:, None].copy()
        self._add_quadratures(task, np.array([t]), found)
        return found[:, 0]

    def _add_quadratures(self, task: Task, times: Vector, x: Vector) -> None:
        """Write the quadratures into the states `x` at times after those of the last call."""
        problem = task.moment.regime.problem
        if not problem.compiled.quadratures or not len(times):
            return
        quadratures = slice(problem.n_dynamic, problem.n_dynamic + problem.compiled.quadratures)
        later = times > task.quadratures_from.start
        x[quadratures, ~later] = task.quadratures_from.x[quadratures, None]
        if later.any():
            x[quadratures, later] = quadratures_at(problem, replace(task.quadratures_from, times=times[later]))
            task.quadratures_from = replace(task.quadratures_from, start=float(times[-1]), x=x[:, -1])
