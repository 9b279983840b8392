"""Systems that share no equation, each with its own steps and events between the stops that concern all of them.

If they were integrated together, an impact of one body would make all bodies take small steps. Here each system goes
from stop to stop with the same driver, as a model of its own with a record of its own, and the records are merged:
outputs are common, and the states of the others at an event of one system are obtained by integration from their last
restart.

If a system terminates the run, violates an assertion or cannot continue, the stretch is integrated again as one system,
so that events, messages and source locations are those of any other run.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import AcausalError
from acausal.lower.subsystems.split import Subsystem
from acausal.simulate.driver.agenda import Agenda, Position, Schedule, Stretch
from acausal.simulate.driver.driver import Driver, pass_compiled
from acausal.simulate.driver.event_loop import EventLoop
from acausal.simulate.driver.hybrid import Hybrid
from acausal.simulate.driver.smooth import Smooth
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Cause, Moment
from acausal.simulate.events.location.between import between
from acausal.simulate.events.regime import Hold, Regime
from acausal.simulate.native.event_loop import EventLoopProgram
from acausal.simulate.native.policy import Library
from acausal.simulate.record.boundaries import Boundaries
from acausal.simulate.record.merge import Rows, merged
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.segment import Piece, Segment, add_counters
from acausal.simulate.start.initialize import Start

_log = logging.getLogger(__name__)
_NO_Z = np.zeros(0)
# The number of mesh points of a stretch between which rows are interpolated, closer together near its ends; and the
# largest number of rows that are integrated to instead.
_POINTS, _MOST_UNINTERPOLATED = 24, 8
_FRACTIONS = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, _POINTS + 1) / _POINTS)
# The number of parts of a stretch in a run that reports its progress.
_PARTS = 20


@dataclass
class Member:
    """One of the independent systems during a run."""

    part: Subsystem
    problem: Problem
    solver: Solver
    recorder: Recorder
    dynamics: Hybrid | Smooth
    span: float
    _first: int = 0
    _boundary: int = 0
    ahead: Position | None = None
    """The position that compiled code has reached in the present stretch, if it has continued beyond its start."""

    @property
    def template(self) -> Segment:
        """A segment for its solver; start, times and states are set for each call."""
        return self.dynamics.template

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """Execute the start of the run, with states and modes of the whole model."""
        self.dynamics.begin(t, Start(start.x[self.part.states], _NO_Z, ()), m[self.part.modes], flag)

    def enter(self, stretch: Stretch, whole: bool) -> tuple[tuple[Cause, ...], tuple[str, ...]]:
        """Execute the event at the start of a stretch; returns its causes and the changed variables.

        With `whole`, compiled code continues through the whole stretch, which saves a call for each of hundreds of
        systems.
        """
        self._first, before, self.ahead = self.recorder.count, len(self.recorder.boundaries), None
        if self._first:  # compiled code cannot execute the start of the run
            position = self._compiled(stretch, Position(0, stretch.start, False, False), None if whole else 1)
            if position is not None:
                self._boundary, self.ahead = before + 1, position if whole else None
                return self.recorder.boundaries.happenings[before]
        self.dynamics.enter(stretch)
        self._boundary = len(self.recorder.boundaries)
        if isinstance(self.dynamics, Smooth):
            return (), ()
        happened = self.dynamics.passages[-1].happened
        return happened.causes, happened.changed

    def advance(self, stretch: Stretch, interrupted: Callable[[], None]) -> None:
        """Integrate from the last row to the end of the present stretch, or of a part of it."""
        ahead, self.ahead = self.ahead, None
        if ahead is None and self.recorder.count > self._first + 1:
            self._first, self._boundary = self.recorder.count - 1, len(self.recorder.boundaries)
        begins = Position(0, stretch.start, True, True)
        position = ahead or self._compiled(stretch, begins) or begins
        if position.segment:
            return
        own, agenda = replace(stretch, opens=True), Agenda(stretch.alone, (), self.span)
        driver = Driver(agenda, self.dynamics, self.recorder, self.solver.name, None, interrupted, entered=own)
        driver.through(position)

    def _compiled(self, stretch: Stretch, position: Position, events: int | None = None) -> Position | None:
        """The position that compiled code reaches, with at most `events` events; None if it gets nowhere."""
        loop = self.dynamics.event_loop(stretch.alone)
        return None if loop is None else pass_compiled(self.dynamics, loop, position, None, events)

    @cached_property
    def kind(self) -> tuple[bytes, ...]:
        """The modes of time and the samples that belong to it; systems with equal ones share their stretches."""
        return self._timely.tobytes(), self._samples.tobytes()

    @property
    def _timely(self) -> NDArray[np.int64]:
        return self.part.modes[: self.part.model.n_timely]

    @property
    def _samples(self) -> NDArray[np.int64]:
        model = self.part.model
        return self.part.modes[model.n_timely : model.n_timely + len(model.state_events.samples)]

    def own(self, stretch: Stretch) -> Stretch:
        """The stretch with the modes of time and the samples that belong to this system."""
        samples = stretch.samples[self._samples - len(stretch.modes)]
        return replace(stretch, modes=stretch.modes[self._timely], samples=samples)

    @property
    def entered(self) -> tuple[Vector, Vector]:
        """States and modes after the event at the start of the stretch."""
        _, x, _, m = self.recorder.point(self._first)
        return x, m

    def rows(self) -> Rows:
        """The rows of the last part of a stretch, including the one at its start."""
        times, x, _, m = self.recorder.rows(self._first)
        return Rows(times, x, m, self.recorder.boundaries.since(self._boundary))

    def between(self, rows: Rows, starts: NDArray[np.int64], times: Vector) -> tuple[Vector, Vector]:
        """States and modes at other times, shapes (nx, n) and (nm, n), integrated from the rows `starts` before them.

        Raises RuntimeError if the solver fails.
        """
        x, m = np.empty((len(rows.x), len(times))), np.empty((len(rows.m), len(times)))
        start_rows = starts[np.searchsorted(rows.times[starts], times, side="right") - 1]
        for row in np.unique(start_rows).tolist():
            here = np.flatnonzero(start_rows == row)
            t = float(rows.times[row])
            near = times[here] - t <= 1e-13 * max(self.span, abs(t))
            x[:, here[near]], m[:, here[near]] = rows.x[:, [row]], rows.m[:, [row]]
            here = here[~near]
            if not len(here):
                continue
            segment = replace(self.template, start=t, times=times[here], x=rows.x[:, row], z=_NO_Z, p=rows.m[:, row])
            regime = self.dynamics.regime_at(t) if isinstance(self.dynamics, Hybrid) else Regime(self.problem)
            x[:, here] = self._solved(regime, segment)
            m[:, here] = _columns(regime.modes(times[here], x[:, here], _NO_Z, rows.m[:, row]), len(here))
        return x, m

    def _solved(self, regime: Regime, segment: Segment) -> Vector:
        """States at the times of a segment, shape (nx, n).

        An interpreted step ends at each of these times, and they are fixed when CasADi creates the integrator. Many of
        them are therefore interpolated between mesh points, whose integrator is cached, where an error estimate permits
        it.
        """
        problem, times = regime.problem, segment.times
        is_compiled = problem.native.used or self.solver.multistep or segment.step is not None
        # between two mesh points a steep function may rise and fall, which no polynomial shows
        is_smooth = not problem.compiled.is_steep and problem.n_dynamic > 0
        if is_compiled or not is_smooth or len(times) <= _MOST_UNINTERPOLATED:
            return self._integrated(regime, segment)
        mesh = segment.start + segment.length * _FRACTIONS
        states = self._integrated(regime, replace(segment, times=mesh, fractions=_FRACTIONS))
        nodes, values = np.append(segment.start, mesh), np.column_stack([segment.x, states]).T
        size = np.abs(values[np.searchsorted(nodes, times).clip(1, _POINTS) - 1])
        n = problem.n_dynamic
        allowed = np.full(size.shape, np.inf)
        allowed[:, :n] = segment.tolerances.of(size[:, :n], problem.scale_x)
        interpolated_values, good = between(nodes, values, times, allowed)
        x = interpolated_values.T
        if not good.all():
            rest = times[~good]
            k = int(np.searchsorted(nodes, rest[0])) - 1  # the mesh point before them
            x[:, ~good] = self._integrated(regime, replace(segment, start=float(nodes[k]), times=rest, x=values[k]))
        return x

    def _integrated(self, regime: Regime, segment: Segment) -> Vector:
        if isinstance(self.dynamics, Hybrid):
            return self.dynamics.explore(regime, segment).x
        return self.dynamics.integrate(self.problem, segment).x


@dataclass
class IndependentSystems:
    """The dynamics of several systems; see `driver.Dynamics`.

    `problem` and `recorder` are those of the whole model; `as_one` creates its dynamics as one system.
    """

    problem: Problem
    recorder: Recorder
    members: Sequence[Member]
    as_one: Callable[[], Hybrid]
    interrupted: Callable[[], None]
    report: Callable[[float], None] | None = None
    terminated: str | None = None
    pace: float = 0.0
    one: Hybrid | None = None
    """The dynamics of the whole model, once it is integrated as one system."""
    joined: float = np.inf
    """Since when that is so [s]."""
    _x: Vector = field(default_factory=lambda: np.zeros(0))
    _m: Vector = field(default_factory=lambda: np.zeros(0))
    _notes: tuple[str, ...] = ()

    @property
    def reached(self) -> Moment:
        """States, variables and modes that the run has reached."""
        if self.one is not None:
            return self.one.reached
        return Moment(self._x, _NO_Z, self._m, self._regime([m.dynamics.reached.regime for m in self.members]))

    def regime_at(self, t: float) -> Regime:
        """The regime in force just after a time."""
        if self.one is not None and t >= self.joined:
            return self.one.regime_at(t)
        of_members = (member.dynamics for member in self.members)
        return self._regime([d.regime_at(t) if isinstance(d, Hybrid) else Regime(d.problem) for d in of_members])

    def _regime(self, regimes: Sequence[Regime]) -> Regime:
        """The regime of the whole model that consists of those of its systems."""
        holds = []
        first = self.problem.compiled.n_modes - len(self.problem.compiled.state_events.relations)
        for member, regime in zip(self.members, regimes, strict=True):
            model, states = member.part.model, member.part.states
            relations = member.part.modes[model.n_modes - len(model.state_events.relations) :] - first
            targets = [None if h.target is None else int(states[h.target]) for h in regime.holds]
            relation_of = [int(relations[h.relation]) for h in regime.holds]
            holds += [Hold(*pair) for pair in zip(relation_of, targets, strict=True)]
        return Regime(self.problem, tuple(holds))

    @property
    def equations(self) -> Problem:
        """The equations that are integrated at the moment."""
        return self.problem if self.one is None else self.one.equations

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the run."""
        return self._notes if self.one is None else tuple(dict.fromkeys((*self._notes, *self.one.notes)))

    def begin(self, t: float, start: Start, m: Vector, flag: str | None) -> None:
        """Execute the start of the run."""
        self._x, self._m = start.x.copy(), m.copy()
        try:
            for member in self.members:
                member.begin(t, start, m, flag)
        except (AcausalError, RuntimeError) as error:
            self._join(t, error, flag)
        self._gather()

    def enter(self, stretch: Stretch) -> None:
        """Execute the event at the start of a stretch."""
        happened: list[tuple[tuple[Cause, ...], tuple[str, ...]]] = []
        if self.one is None:
            try:
                own = self._own(stretch)
                whole = not self._in_parts(stretch)
                happened = [member.enter(own[member.kind], whole) for member in self.members]
            except (AcausalError, RuntimeError) as error:
                self._join(stretch.start, error)
        if self.one is not None:
            self.one.enter(stretch)
            self._gather()
            return
        self._gather()
        self._m[: len(stretch.modes)] = stretch.modes
        causes = tuple(c for own, _ in happened for c in own)
        if any(c.text for c in causes) or not all(own for own, _ in happened):
            causes = tuple(c for c in causes if c.text)  # without any, it is a time event
        changed = tuple(c for _, own in happened for c in own)
        m = self._m.copy()
        for member in self.members:
            x, modes = member.entered
            m[member.part.modes] = modes
            if member.ahead is not None:  # the values gathered are those of a later position
                self._x[member.part.states], self._m[member.part.modes] = x, modes
        self.recorder.begin(stretch.start, self._x, _NO_Z, m, causes, changed)

    def advance(self, stretch: Stretch, position: Position) -> float | None:
        """Integrate each system to the end of the stretch; in parts, after each of which progress is reported."""
        parts = np.array_split(stretch.times, _PARTS) if self._in_parts(stretch) else [stretch.times]
        for times in parts:
            if self.one is None:
                self._advance_members(replace(stretch, start=position.here, end=float(times[-1]), times=times))
            if self.one is not None:
                stop = self.one.advance(stretch, position)
                self._gather()
                return stop
            position = replace(position, here=float(times[-1]), fresh=False)
            if self.report is not None:
                self.report(position.here)
        return None

    def _in_parts(self, stretch: Stretch) -> bool:
        """Whether progress is reported within a stretch."""
        return self.report is not None and len(stretch.times) >= 2 * _PARTS

    def _own(self, stretch: Stretch) -> dict[tuple[bytes, ...], Stretch]:
        """The stretch of each kind of systems."""
        found: dict[tuple[bytes, ...], Stretch] = {}
        for member in self.members:
            if member.kind not in found:
                found[member.kind] = member.own(stretch)
        return found

    def _advance_members(self, part: Stretch) -> None:
        """Integrate a part of a stretch, system by system; if one fails, the run continues as one system."""
        try:
            own = self._own(part)
            for member in self.members:
                member.advance(own[member.kind], self.interrupted)
                if member.dynamics.terminated is not None:
                    self._join(part.start, member.dynamics.terminated)
                    return
            self._record(part)
            self._gather()
        except (AcausalError, RuntimeError) as error:
            self._join(part.start, error)

    def _join(self, t: float, reason: object, flag: str | None = None) -> None:
        """Continue as one system from the values of the whole model at time `t`."""
        self.interrupted()
        _log.debug("%s: one system from t = %g s on: %s", self.problem.compiled.name, t, reason)
        self.one, self.joined = self.as_one(), t
        self.one.begin(t, Start(self._x, _NO_Z, ()), self._m, flag)

    def _gather(self) -> None:
        """Collect states, modes and notes of all systems."""
        if self.one is not None:
            self._x, self._m = self.one.reached.x, self.one.reached.m
            self.terminated, self.pace = self.one.terminated, self.one.pace
            return
        all_ = (member.dynamics for member in self.members)
        self._notes = tuple(dict.fromkeys(n for own in all_ if isinstance(own, Hybrid) for n in own.notes))
        self._x, self._m = self._x.copy(), self._m.copy()  # the old arrays belong to records and moments
        for member in self.members:
            moment = member.dynamics.reached
            self._x[member.part.states], self._m[member.part.modes] = moment.x, moment.m

    def _record(self, stretch: Stretch) -> None:
        """Record the rows of all systems as rows of the whole model."""
        found = merged([member.rows() for member in self.members], stretch.times, self._filled)
        # columns are instants, as in the pieces of solvers
        x, m = (np.tile(values, (len(found.times), 1)).T for values in (self._x, self._m))
        for k, member in enumerate(self.members):
            x[member.part.states], m[member.part.modes] = found.values(k)
        counters: dict[str, float] = {}
        for member in self.members:
            add_counters(counters, member.recorder.counters)
            member.recorder.counters.clear()
        instants = [float(found.times[row]) for row, _, _ in found.events]
        self.recorder.extend(
            found.times, x, m, instants, [(causes, changed) for _, causes, changed in found.events], counters
        )

    def _filled(self, k: int, rows: Rows, times: Vector) -> tuple[Vector, Vector]:
        """States and modes of one system at events of the others."""
        return self.members[k].between(rows, rows.starts, times)

    def again(self, t: float, row: tuple[Vector, Vector], times: Vector) -> tuple[Piece, Vector]:
        """The solution at times after a recorded row of states and modes at `t`, and its modes."""
        x, m = (np.repeat(values[:, None], len(times), axis=1) for values in row)
        for member in self.members:
            own_times, own_x, _, own_m = member.recorder.rows()
            rows = Rows(own_times, own_x, own_m, Boundaries())
            found = member.between(rows, np.arange(len(own_times)), times)
            x[member.part.states], m[member.part.modes] = found
        return Piece(x, np.zeros((0, len(times))), {}), m

    def moved(self, x: Vector, z: Vector, m: Vector) -> None:
        """Take over values that were computed elsewhere."""
        if self.one is not None:
            self.one.moved(x, z, m)
        self._x, self._m = x.copy(), m.copy()
        for member in self.members:
            member.dynamics.moved(x[member.part.states], _NO_Z, m[member.part.modes])

    def event_loop(self, schedule: Schedule) -> EventLoop | None:
        """None: each system has a loop of its own."""
        return None

    def library(self) -> Library[EventLoopProgram] | None:
        """None: each system has its own."""
        return None

    def failed(self, times: Vector) -> Segment:
        """The segment that could not be integrated."""
        return (self.one or self.as_one()).failed(times)

    def end(self, t: float, samples: Vector) -> None:
        """Execute the event at the end of the run."""
        if self.one is not None:
            self.one.end(t, samples)
            return
        first = self.problem.compiled.n_timely
        before = [len(member.recorder.boundaries) for member in self.members]
        for member in self.members:
            model = member.part.model
            own = member.part.modes[model.n_timely : model.n_timely + len(model.state_events.samples)] - first
            member.dynamics.end(t, samples[own])
        found = [
            h for member, k in zip(self.members, before, strict=True) for h in member.recorder.boundaries.happenings[k:]
        ]
        self._gather()
        if not found:
            return
        m = self._m.copy()
        for member in self.members:
            m[member.part.modes] = member.recorder.point(member.recorder.count - 1)[3]
        causes = tuple(c for own, _ in found for c in own)
        changed = tuple(c for _, own in found for c in own)
        self.recorder.begin(t, self._x, _NO_Z, m, causes, changed)


def _columns(m: Vector, count: int) -> Vector:
    return m if m.ndim == 2 else np.repeat(m[:, None], count, axis=1)
