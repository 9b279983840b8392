"""Segments and ordinary events passed in compiled code, for runs that have it.

Python takes half a millisecond between two calls of an integrator, and as long again for an event; C takes a few
microseconds. Events have the meaning that `iteration.py` gives them. Those that are not ordinary
(`native/event_loop.c` says which) are left to it: the loop ends before such an event, and starts again after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.driver.agenda import Position, Schedule, lengths
from acausal.simulate.driver.loop_memory import LoopMemory
from acausal.simulate.equations.arguments import arguments as steep_arguments
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.guards import Cause
from acausal.simulate.events.resolution.phases import may_pulse, must_be_searched
from acausal.simulate.events.rest import Bounces
from acausal.simulate.native.event_loop import EventLoopProgram, EventLoopStructure
from acausal.simulate.native.policy import Library
from acausal.simulate.native.program import Placed
from acausal.simulate.record.boundaries import Happening
from acausal.simulate.record.record import Recorder
from acausal.simulate.solvers import Solver
from acausal.simulate.solvers.base import growth
from acausal.simulate.solvers.segment import Piece, Segment

Explain = Callable[[list[int], list[int]], tuple[Cause, ...]]
Clears = Callable[[Segment, Piece, bool], bool]
# The number of successive calls without progress after which no more are made.
_MOST_EMPTY_CALLS = 8


@dataclass(frozen=True, eq=False)
class LoopState:
    """A position that the loop has reached, with states and modes, and the mean step of the solver [s]."""

    position: Position
    x: Vector
    m: Vector
    pace: float = 0.0


@dataclass(frozen=True, eq=False)
class LoopEvent:
    """An event of a traced loop: states and modes before and after it, and the relation that was reached.

    `jumps`: For each round that acted: states and modes, which actions were applied, and whether `pre` advanced.
    """

    time: float
    guard: int | None
    left: tuple[Vector, Vector]
    right: tuple[Vector, Vector]
    jumps: tuple[tuple[Vector, Vector, NDArray[np.bool_], bool], ...]


def suits_event_loop(problem: Problem, solver: Solver) -> bool:
    """Whether runs of this problem can be passed in compiled code: those of one-step methods on ODEs."""
    compiled = problem.compiled
    quadratures = range(compiled.n_dynamic, compiled.n_dynamic + compiled.quadratures)
    return (
        solver.native == "integrator"
        and not compiled.algebraic
        and compiled.n_dynamic > 0
        and not compiled.delays
        and not compiled.solution.structure.invariants
        and not any(state in quadratures for c in compiled.state_events.clauses for state, _ in c.actions)
        # within steps the loop searches the turning points and middles of steep functions, and so misses a pulse that
        # underflows on both sides (1/cosh); a method that evaluates slopes fails there, an explicit one would go on
        and not (solver.explicit and compiled.is_steep)
        # it looks at guards at the ends of steps, which nothing keeps short where no rate depends on their arguments
        and not must_be_searched(compiled)
    )


# Descriptions of events by relations, clauses and states that have changed: all runs of a model have the same few.
_KNOWN: WeakKeyDictionary[CompiledModel, dict[bytes, Happening]] = WeakKeyDictionary()
_MOST_KNOWN = 10_000


class EventLoop:
    """The compiled event loop of one run.

    `explain` describes the relations and clauses with given numbers. `bounces` is updated by each call. `trace` is
    called with every event. Only the part of a call that `clears` accepts is used; it is given the solution of each
    stretch, and whether the loop's own search for steep functions is in doubt. `memory` is that of a loop of an equal
    system, and is used if it is large enough.
    """

    def __init__(
        self,
        problem: Problem,
        recorder: Recorder,
        schedule: Schedule,
        template: Segment,
        span: float,
        bounces: Bounces | None = None,
        explain: Explain = lambda relations, clauses: (),
        trace: Callable[[LoopEvent], None] | None = None,
        clears: Clears | None = None,
        memory: LoopMemory | None = None,
    ) -> None:
        self.problem, self.recorder, self.schedule, self.template = problem, recorder, schedule, template
        self.span, self.bounces, self.explain, self.trace, self.clears = span, bounces, explain, trace, clears
        compiled = problem.compiled
        self._empty_calls = 0
        self._library: Library[EventLoopProgram] | None = None
        self._states = compiled.states
        self._known = _KNOWN.setdefault(compiled, {})
        if len(self._known) > _MOST_KNOWN:
            self._known.clear()
        self._structure: EventLoopStructure | None = None
        wanted = schedule.longest, trace is not None, clears is not None
        shared = memory is not None and memory.suffices(*wanted)
        self.memory = memory if shared and memory is not None else LoopMemory(compiled, *wanted)

    @property
    def has_stalled(self) -> bool:
        """Whether too many successive calls have made no progress."""
        return self._empty_calls >= _MOST_EMPTY_CALLS

    def over(self, schedule: Schedule) -> EventLoop | None:
        """This loop with another schedule of its run; None if its memory is too small for that."""
        if schedule is self.schedule:
            return self
        if not self.memory.is_long_enough(schedule.longest):
            return None
        self.schedule, self._empty_calls = schedule, 0
        if self._structure is not None:
            self._structure.timely = schedule.modes.shape[1]
            self._structure.put(schedule.placed)
        return self

    def go(
        self,
        library: Library[EventLoopProgram],
        start: LoopState,
        segments: int | None = None,
        events: int | None = None,
    ) -> LoopState | None:
        """Pass at most `segments` and `events`; the state reached, or None if the loop gets nowhere.

        With one event, it enters a stretch and stays there.
        """
        position, x, m = start.position, start.x, start.m
        loop = self._prepared(library)
        last = self.schedule.segments if segments is None else min(position.segment + segments, self.schedule.segments)
        loop.boundaries = last + 1
        bounces = self.bounces
        may_repeat = bounces is not None and self.clears is not None
        before = (
            (bounces.count, bounces.last.copy(), bounces.crowd.copy()) if may_repeat and bounces is not None else None
        )
        self._run(library, loop, start, events or self.memory.events)
        events_before_miss = self._events_before_miss(loop, start)
        if events_before_miss is not None:  # again, up to the stretch in which something may have been missed
            if before is not None and bounces is not None:
                bounces.count, bounces.last[:], bounces.crowd[:] = before
            self._run(library, loop, start, events_before_miss + 1)
        if bounces is not None:
            bounces.count = loop.count
        self._empty_calls = 0 if loop.rows else self._empty_calls + 1
        if not loop.rows:
            return None
        self._record(loop, position.here, x, m)
        here = Position(loop.segment, loop.here, bool(loop.entered), bool(loop.fresh), bool(loop.arrived))
        return LoopState(here, self.memory.x.copy(), self.memory.m.copy(), float(loop.first))

    def _run(self, library: Library[EventLoopProgram], loop: EventLoopStructure, start: LoopState, events: int) -> None:
        """Run from a start as far as possible with fewer than `events` events."""
        position = start.position
        loop.segment, loop.here, loop.event_capacity = position.segment, position.here, events
        loop.entered, loop.fresh, loop.arrived, loop.first = position.entered, position.fresh, False, start.pace
        self.memory.x[:], self.memory.m[:] = start.x, start.m
        if self.bounces is not None:
            loop.count = self.bounces.count
        loop.rows = loop.events = loop.acts = loop.jumps = loop.trail = loop.stretches = 0
        loop.steps = loop.rejected = loop.rhs = loop.jacobians = 0
        try:
            library.run.run(loop)
        except KeyboardInterrupt:
            if loop.rows:
                self._record(loop, position.here, start.x, start.m)
            raise

    def _events_before_miss(self, loop: EventLoopStructure, start: LoopState) -> int | None:
        """The number of events before the first stretch that may have missed something; None if there is none."""
        if self.clears is None:
            return None
        # compiled code has cleared the others by itself; there are several for each of hundreds of systems
        in_doubt = self.memory.stretch_doubts[: loop.stretches].nonzero()[0].tolist()
        examined = range(loop.stretches) if may_pulse(self.problem.compiled) else in_doubt
        if not examined:
            return None
        ends = [0, *self.memory.trail_end[: loop.stretches].tolist()]
        for k in examined:
            first, last = ends[k : k + 2]
            events = int(self.memory.stretch_events[k])
            t, x, m = start.position.here, start.x, start.m
            if events:
                row = int(self.memory.event_row[events - 1])
                t, x, m = float(self.memory.row_time[row]), self.memory.row_x[row], self.memory.row_m[row]
            times, x_rows = self.memory.trail_time[first:last], self.memory.trail_x[first:last].T
            segment = replace(self.template, start=t, times=times, x=x, p=m)
            piece = Piece(x_rows, np.zeros((0, len(times))), {"steps": float(self.memory.stretch_steps[k])})
            if len(times) and not self.clears(segment, piece, bool(self.memory.stretch_doubts[k])):
                return events
        return None

    def _prepared(self, library: Library[EventLoopProgram]) -> EventLoopStructure:
        """The data of the run for the compiled program, created once."""
        if self._structure is not None and self._library is library:
            return self._structure
        problem, schedule, compiled = self.problem, self.schedule, self.problem.compiled
        events = compiled.state_events
        (constants,) = library.constants(problem.p, problem.u)
        numbers = {
            "states": len(compiled.states),
            "dynamic": compiled.n_dynamic,
            "discretes": compiled.discretes,
            "modes": compiled.n_modes,
            "timely": schedule.modes.shape[1],
            "samples": len(events.samples),
            "memories": len(events.memories),
            "flags": len(events.flags),
            "relations": len(events.relations),
            "assigned": len(events.assignments),
            "conditions": len(events.conditions),
            "clauses": len(events.clauses),
            "actions": sum(len(c.actions) for c in events.clauses),
            "asserts": len(events.asserts),
            "constants": len(constants),
            "span": self.span,
            "relative": self.template.tolerances.relative,
            "absolute": self.template.tolerances.absolute,
            "step": self.template.step or 0.0,
            "row_capacity": len(self.memory.row_time),
            "event_capacity": self.memory.events,
            "act_capacity": self.memory.acts,
            "jump_capacity": len(self.memory.jump_x),
            "trail_capacity": len(self.memory.trail_time),
        }
        steep = None if self.clears is None else steep_arguments(compiled)
        if steep is not None:  # the program searches them by itself
            numbers |= {"columns": len(steep.owners), "functions": steep.levels.count}
        inputs = {"scale": problem.scale_x, "constant": constants, "u": problem.u, "p": problem.p}
        arrays = {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in inputs.items()}
        if self.bounces is not None:
            arrays |= {name: getattr(self.bounces, name) for name in ("last", "crowd", "impossible")}
        parts = schedule.placed, self.memory.placed, Placed(arrays)
        self._structure, self._library = library.run.structure(numbers, *parts), library
        return self._structure

    def _record(self, loop: EventLoopStructure, start: float, x_start: Vector, m_start: Vector) -> None:
        """Record the rows and events of a call."""
        n = loop.rows
        # columns are instants, as in the pieces of solvers
        rows, m = self.memory.row_x[:n].copy(), self.memory.row_m[:n].copy().T
        times, x = self.memory.row_time[:n].copy(), rows.T
        starts = self.memory.event_row[: loop.events]
        self._add_quadratures(times, x, m, starts, start, x_start)
        before = rows[starts - 1]
        before[starts == 0] = x_start
        moved = rows[starts] != before
        if self.trace is not None:
            modes = np.hstack([m_start[:, None], m])
            for k, row in enumerate(starts.tolist()):
                left, right = (before[k], modes[:, row]), (x[:, row], modes[:, row + 1])
                self.trace(LoopEvent(float(self.memory.event_time[k]), self._reached(k), left, right, self._jumps(k)))
        happenings = self._happenings(loop.events, moved)
        counters = {
            "steps": float(loop.steps),
            "rhs_evaluations": float(loop.rhs),
            "jacobians": float(loop.jacobians),
            "rejected": float(loop.rejected),
        }
        self.recorder.extend(times, x, m, self.memory.event_time[: loop.events].tolist(), happenings, counters)

    def _happenings(self, events: int, moved: Truth) -> list[Happening]:
        """What happened at each event, where `moved` are the states that have changed, shape (events, states)."""
        if not events:
            return []
        fired, counts = self.memory.fired[:events], lengths(self.memory.acts_end[:events])
        acts = np.full((events, int(counts.max())), -1)
        if acts.size:
            acts[np.arange(acts.shape[1]) < counts[:, None]] = self.memory.act[: counts.sum()]
        keys = _row_bytes(np.concatenate([fired, moved, acts.view(np.uint8)], axis=1))
        known = self._known
        for key in set(keys).difference(known):  # the same few occur again and again
            k = keys.index(key)
            acted = acts[k, : counts[k]].tolist()
            changed = tuple(self._states[j] for j in np.flatnonzero(moved[k]).tolist())
            known[key] = self.explain(np.flatnonzero(fired[k]).tolist(), acted), changed
        return [known[key] for key in keys]

    def _reached(self, event: int) -> int | None:
        """The relation that was reached; None at a known instant."""
        fired = self.memory.fired[event]
        return int(np.argmax(fired)) if fired.any() else None

    def _jumps(self, event: int) -> tuple[tuple[Vector, Vector, NDArray[np.bool_], bool], ...]:
        first = int(self.memory.jumps_end[event - 1]) if event else 0
        return tuple(
            (
                self.memory.jump_x[k].copy(),
                self.memory.jump_m[k].copy(),
                self.memory.jump_applied[k] > 0.5,
                bool(self.memory.jump_advances[k]),
            )
            for k in range(first, int(self.memory.jumps_end[event]))
        )

    def _add_quadratures(
        self, times: Vector, x: Vector, m: Vector, starts: NDArray[np.int64], start: float, x_start: Vector
    ) -> None:
        """Write the quadratures, which are integrated separately, into the rows and the state that was reached."""
        compiled = self.problem.compiled
        if not compiled.quadratures:
            return
        columns = slice(compiled.n_dynamic, compiled.n_dynamic + compiled.quadratures)
        # the stretch of each row, between two events, and rows after the first instant of their stretch
        stretch_of = np.searchsorted(starts, np.arange(len(times)), side="right")
        begins = np.append(start, times[starts])
        is_later = times > begins[stretch_of]
        used, stretches = np.unique(stretch_of[is_later], return_inverse=True)
        growths, total = np.zeros((compiled.quadratures, len(times))), np.zeros((compiled.quadratures, len(begins) + 1))
        if len(used):
            first, discrete = np.searchsorted(stretch_of, used), slice(len(x) - compiled.discretes, None)
            values = m[:, first].T, x[discrete, first].T
            growths[:, is_later] = growth(
                self.problem, begins[used], times[is_later], stretches, *values, self.template
            )
            total[:, used + 1] = growths[:, np.searchsorted(stretch_of, used, side="right") - 1]
        reached = x_start[columns, None] + np.cumsum(total, axis=1)
        x[columns] = reached[:, stretch_of] + growths
        self.memory.x[columns] = reached[:, -1]


def _row_bytes(rows: NDArray[Any]) -> list[bytes]:
    """The rows of a Boolean table as bytes."""
    count, width = rows.shape
    return np.ascontiguousarray(rows).view(f"V{width}").ravel().tolist() if width else [b""] * count
