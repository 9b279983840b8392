"""The Python side of `event_loop.c`: its structure, and programs that contain it."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from acausal.simulate.interrupt import Interrupted
from acausal.simulate.native.program import INTERRUPTED, Placed, Program, RunStructure, prepare

_FILES = "bracketing.c", "event_loop.c", "reached.c", "rounds.c", "stretches.c"


def _fields(kind: Any, names: str) -> tuple[tuple[str, Any], ...]:
    return tuple((name, kind) for name in names.split())


@cache
def source() -> str:
    """C of the event loop, to be appended to the functions and integrators that it calls."""
    return "".join(Path(__file__).with_name(name).read_text(encoding="utf-8") for name in _FILES)


class EventLoopStructure(ctypes.Structure):
    """`struct event_loop` of event_loop.c."""

    _fields_ = (
        *_fields(ctypes.c_longlong, "states dynamic discretes modes timely samples memories flags relations assigned"),
        *_fields(ctypes.c_longlong, "conditions clauses actions asserts constants boundaries"),
        *_fields(ctypes.c_double, "span relative absolute step"),
        *_fields(ctypes.c_void_p, "assigned_at ends ties timed impossible"),
        *_fields(ctypes.c_void_p, "scale nominal constant u p boundary timely_modes due times times_end"),
        *_fields(ctypes.c_longlong, "segment entered fresh arrived"),
        *_fields(ctypes.c_double, "here first"),
        *_fields(ctypes.c_void_p, "x m"),
        *_fields(ctypes.c_longlong, "count"),
        *_fields(ctypes.c_void_p, "last crowd"),
        *_fields(ctypes.c_longlong, "rows row_capacity events event_capacity acts act_capacity"),
        *_fields(ctypes.c_void_p, "row_time row_x row_m event_time event_row acts_end act fired"),
        ("run", RunStructure),
        *_fields(ctypes.c_longlong, "steps rejected rhs jacobians begun"),
        *_fields(ctypes.c_longlong, "jumps jump_capacity"),
        *_fields(ctypes.c_void_p, "jump_x jump_m jump_applied jump_advances jumps_end"),
        *_fields(ctypes.c_longlong, "trail trail_capacity stretches"),
        *_fields(ctypes.c_void_p, "trail_time trail_x trail_end stretch_steps stretch_events"),
        *_fields(ctypes.c_longlong, "columns functions"),
        *_fields(ctypes.c_void_p, "owners stretch_doubts"),
    )

    kept: tuple[Placed, ...]
    """The arrays to which its fields point, kept alive."""
    schedule: Placed
    """The same for the schedule, which may be replaced."""

    def put(self, schedule: Placed) -> None:
        """Replace the schedule, and keep it alive."""
        for name, place in schedule.at.items():
            setattr(self, name, place)
        self.schedule = schedule


class EventLoopProgram(Program):
    """A compiled integrator that can integrate over segments and ordinary events in one call."""

    def __init__(self, path: Path, nx: int, nz: int) -> None:
        """Load the library; raises OSError or AttributeError if it is no such program."""
        super().__init__(path, nx, nz)
        self.loop = ctypes.CDLL(str(path)).acausal_event_loop

    def structure(self, numbers: Mapping[str, float], schedule: Placed, *arrays: Placed) -> EventLoopStructure:
        """Create the structure with these fields; it keeps the arrays alive."""
        places = {name: place for part in arrays for name, place in part.at.items()}
        loop = EventLoopStructure(**numbers, **places)
        loop.kept = arrays
        loop.put(schedule)
        prepare(loop.run)
        return loop

    def run(self, loop: EventLoopStructure) -> None:
        """Continue the loop as far as possible; raises Interrupted on Ctrl-C, with the state in the structure."""
        if self.loop(ctypes.byref(loop)) == INTERRUPTED:
            raise Interrupted
