"""Events passed in compiled code, where a run has it and nothing unusual happens.

Between two calls of CasADi's functions the event iteration in Python takes 0.5 ms an event, in C a few microseconds.
The meaning is that of `iteration.py`; what is not ordinary is left to it (`native/flight.c` says what that is). A
flight ends before such an event, and the next one starts behind it.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from acausal.simulate.course import Course, Place
from acausal.simulate.guards import Cause, Moment
from acausal.simulate.native.flight import FlightProgram, FlightStructure
from acausal.simulate.native.policy import Library
from acausal.simulate.solvers.base import Segment, counted
from acausal.simulate.stopping import compiled_program

if TYPE_CHECKING:
    from acausal.simulate.hybrid import Hybrid

Vector = NDArray[np.float64]
_MOST_EVENTS = 1024
_ACTS = 16
# Flights in a row that ended where they began, after which no more are tried.
_VAIN = 8


class Flight:
    """The flights of one run."""

    def __init__(self, hybrid: Hybrid, course: Course, template: Segment) -> None:
        self.hybrid, self.course, self.template = hybrid, course, template
        compiled = hybrid.problem.compiled
        events = compiled.state_events
        self._vain = 0
        self._flight: FlightStructure | None = None
        self._possible = (
            hybrid.single_step
            and not hybrid.traced
            and not compiled.quadratures
            and not compiled.solution.structure.invariants
        )
        longest = int(np.max(np.diff(course.ends, prepend=0)))
        rows, self._acts = longest + 4 * _MOST_EVENTS, _ACTS * _MOST_EVENTS
        self.x, self.m = np.empty(len(compiled.states)), np.empty(compiled.n_modes)
        self.row_time, self.row_x = np.empty(rows), np.empty((rows, len(compiled.states)))
        self.row_m = np.empty((rows, compiled.n_modes))
        self.event_time, self.event_row = np.empty(_MOST_EVENTS), np.empty(_MOST_EVENTS, dtype=np.int64)
        self.acts_end, self.act = np.empty(_MOST_EVENTS, dtype=np.int64), np.empty(self._acts, dtype=np.int64)
        self.fired = np.empty((_MOST_EVENTS, len(events.relations)), dtype=np.uint8)

    def from_here(self, place: Place) -> Place | None:
        """Where a flight has come to; None where none is possible, or none has got anywhere."""
        hybrid = self.hybrid
        regime = hybrid.reached.regime
        if not self._possible or regime.holds or (place.segment == 0 and not place.entered):
            return None
        library = compiled_program(regime, self.template, hybrid.solver.name)
        if library is None:
            return None
        flight = self._prepared(library)
        flight.segment, flight.here = place.segment, place.here
        flight.entered, flight.fresh = place.entered, place.fresh
        self.x[:], self.m[:] = hybrid.reached.x, hybrid.reached.m
        bounces = hybrid.bounces
        flight.last_time, flight.standing, flight.count = bounces.time, bounces.standing, bounces.count
        flight.rows = flight.events = flight.acts = 0
        flight.steps = flight.rejected = flight.rhs = flight.jacobians = 0
        library.run.run(flight)
        bounces.time, bounces.standing, bounces.count = flight.last_time, flight.standing, flight.count
        self._vain = 0 if flight.rows else self._vain + 1
        self._possible = self._vain < _VAIN
        if not flight.rows:
            return None
        self._take(flight)
        return Place(flight.segment, flight.here, bool(flight.entered), bool(flight.fresh))

    def _prepared(self, library: Library[FlightProgram]) -> FlightStructure:
        """What the program has to know of the run; made once."""
        if self._flight is not None:
            return self._flight
        hybrid, course, compiled = self.hybrid, self.course, self.hybrid.problem.compiled
        events, bounces = compiled.state_events, hybrid.bounces
        constants = hybrid.reached.regime.constants(library)
        numbers = {
            "states": len(compiled.states),
            "dynamic": compiled.n_dynamic,
            "modes": compiled.n_modes,
            "timely": course.modes.shape[1],
            "samples": len(events.samples),
            "memories": len(events.memories),
            "flags": len(events.flags),
            "relations": len(events.relations),
            "assigned": len(events.assignments),
            "clauses": len(events.clauses),
            "actions": sum(len(c.actions) for c in events.clauses),
            "asserts": len(events.asserts),
            "constants": len(constants),
            "boundaries": len(course.instants),
            "span": hybrid.span,
            "relative": self.template.tolerance,
            "absolute": self.template.absolute,
            "step": self.template.step or 0.0,
            "row_capacity": len(self.row_time),
            "event_capacity": _MOST_EVENTS,
            "act_capacity": self._acts,
        }
        whole = partial(np.array, dtype=np.int64)
        real = partial(np.ascontiguousarray, dtype=np.float64)
        arrays = {
            "assigned_at": whole([a.position for a in events.assignments]),
            "action_at": whole([position for c in events.clauses for position, _ in c.actions]),
            "action_of": whole([k for k, c in enumerate(events.clauses) for _ in c.actions]),
            "ends": whole([c.terminate is not None for c in events.clauses]),
            "scale": real(hybrid.problem.scale_x),
            "nominal": real(compiled.nominal_x),
            "constant": real(constants),
            "u": real(hybrid.problem.u),
            "p": real(hybrid.problem.p),
            "boundary": real(course.instants),
            "timely_modes": real(course.modes),
            "due": real(course.samples),
            "times": real(course.times),
            "times_end": course.ends,
            **{name: getattr(bounces, name) for name in ("last", "gap", "crowd", "impossible")},
            **{name: getattr(self, name) for name in ("x", "m", "row_time", "row_x", "row_m", "event_time")},
            **{name: getattr(self, name) for name in ("event_row", "acts_end", "act", "fired")},
        }
        self._flight = library.run.structure(numbers, arrays)
        return self._flight

    def _take(self, flight: FlightStructure) -> None:
        """Record what a flight has passed."""
        hybrid, n = self.hybrid, flight.rows
        moment = hybrid.reached
        x, m = self.row_x[:n].T.copy(), self.row_m[:n].T.copy()
        before = np.hstack([moment.x[:, None], x[:, :-1]])
        starts = self.event_row[: flight.events]
        boundaries = []
        for k, row in enumerate(starts.tolist()):
            acts = self.act[self.acts_end[k - 1] if k else 0 : self.acts_end[k]]
            boundaries.append(
                (float(self.event_time[k]), self._causes(k, acts), self._changed(before[:, row], x[:, row]))
            )
        stats = {"n_steps": flight.steps, "n_rhs": flight.rhs, "n_jac": flight.jacobians, "n_reject": flight.rejected}
        hybrid.recorder.extend(self.row_time[:n].copy(), x, m, boundaries, counted(stats))
        hybrid.moment = Moment(self.x.copy(), moment.z, self.m.copy(), moment.regime)

    def _causes(self, event: int, acts: NDArray[np.int64]) -> tuple[Cause, ...]:
        hybrid = self.hybrid
        clauses = hybrid.problem.compiled.state_events.clauses
        found = [hybrid.guards.causes[k] for k in np.flatnonzero(self.fired[event]).tolist()]
        found += [Cause(clauses[k].text, clauses[k].where, clauses[k].component) for k in acts.tolist()]
        return tuple(found)

    def _changed(self, before: Vector, after: Vector) -> tuple[str, ...]:
        states = self.hybrid.problem.compiled.states
        return tuple(states[k] for k in np.flatnonzero(after != before).tolist())
