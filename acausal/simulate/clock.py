"""The clock that times the stages of a run: elapsed time, or processor time to compare runs on a busy machine.

Modules call `seconds` instead of holding a clock of their own, so that replacing `CLOCK` affects all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from time import perf_counter

CLOCK: ContextVar[Callable[[], float]] = ContextVar("clock of runs", default=perf_counter)


def seconds() -> float:
    """Seconds since a fixed but arbitrary instant."""
    return CLOCK.get()()
