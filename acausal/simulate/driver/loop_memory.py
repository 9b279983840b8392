"""The arrays that the compiled event loop writes during one call."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np

from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.arguments import arguments as steep_arguments
from acausal.simulate.native.program import Placed

MOST_EVENTS = 1024
_WRITTEN = (
    *("x", "m", "row_time", "row_x", "row_m", "event_time", "event_row", "acts_end", "act", "fired"),
    *("jump_x", "jump_m", "jump_applied", "jump_advances", "jumps_end"),
    *("trail_time", "trail_x", "trail_end", "stretch_steps", "stretch_events", "stretch_doubts"),
)
# Mesh points of a stretch and clauses of an event for which there is room, on average (`stretches.c`).
_MESH_POINTS, _ACTS = 8, 16
# The most rounds with actions in one traced call.
_MOST_JUMPS = 4096


class LoopMemory:
    """Rows, events and jumps of one call, and the states that were reached.

    Its contents are used only until the next call, so loops of equal systems that are called one after the other share
    one: otherwise each of 256 balls has a megabyte, all of which has to be cleared.
    """

    def __init__(self, compiled: CompiledModel, longest: int, is_traced: bool, is_searched: bool) -> None:
        """For schedules with at most `longest` output times in a segment; see `struct event_loop` of event_loop.c."""
        self._compiled = compiled
        states, events = len(compiled.states), compiled.state_events
        rows, self.acts = longest + 4 * MOST_EVENTS, _ACTS * MOST_EVENTS
        self.events, self.is_traced, self.is_searched = MOST_EVENTS, is_traced, is_searched
        self.x, self.m = np.empty(states), np.empty(compiled.n_modes)
        self.row_time, self.row_x, self.row_m = np.empty(rows), np.empty((rows, states)), np.empty((rows, len(self.m)))
        self.event_time, self.event_row = np.empty(MOST_EVENTS), np.empty(MOST_EVENTS, dtype=np.int64)
        self.acts_end, self.act = np.empty(MOST_EVENTS, dtype=np.int64), np.empty(self.acts, dtype=np.int64)
        self.fired = np.empty((MOST_EVENTS, len(events.relations)), dtype=np.uint8)
        jumps = _MOST_JUMPS if is_traced else 0
        self.jump_x, self.jump_m = np.empty((jumps, states)), np.empty((jumps, compiled.n_modes))
        self.jump_applied = np.empty((jumps, sum(len(c.actions) for c in events.clauses)))
        self.jump_advances, self.jumps_end = np.empty(jumps, dtype=np.int64), np.zeros(MOST_EVENTS, dtype=np.int64)
        trail_rows = rows + _MESH_POINTS * MOST_EVENTS if is_searched else 0
        self.trail_time, self.trail_x = np.empty(trail_rows), np.empty((trail_rows, states))
        stretches = min(trail_rows, MOST_EVENTS + 1)
        self.trail_end, self.stretch_steps, self.stretch_events, self.stretch_doubts = (
            np.empty(stretches, dtype=np.int64) for _ in range(4)
        )

    @cached_property
    def placed(self) -> Placed:
        """All arrays, and others that equal systems have in common, under their names in compiled code."""
        compiled = self._compiled
        events, integers = compiled.state_events, partial(np.array, dtype=np.int64)
        steep = steep_arguments(compiled) if self.is_searched else None
        arrays = {
            "assigned_at": integers([a.position for a in events.assignments]),
            "ends": integers([c.terminate is not None for c in events.clauses]),
            "ties": integers(compiled.events.ties),
            "timed": integers(compiled.events.timed),
            "nominal": np.ascontiguousarray(compiled.nominal_x, dtype=np.float64),
            **({} if steep is None else {"owners": integers(steep.owners)}),
        }
        return Placed(arrays | {name: getattr(self, name) for name in _WRITTEN})

    def suffices(self, longest: int, is_traced: bool, is_searched: bool) -> bool:
        """Whether it suits a loop with these arguments of its system or an equal one."""
        return self.is_long_enough(longest) and self.is_traced == is_traced and self.is_searched == is_searched

    def is_long_enough(self, longest: int) -> bool:
        """Whether segments with so many output times leave enough rows for events."""
        return longest + self.events <= len(self.row_time)
