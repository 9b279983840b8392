"""What the stages of a run are timed with: elapsed time, or processor time where runs are compared on a busy machine.

It is asked for here and not kept in each module that times something: whoever replaces it then reaches all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from time import perf_counter

CLOCK: ContextVar[Callable[[], float]] = ContextVar("clock of runs", default=perf_counter)


def seconds() -> float:
    """Seconds since an instant that is always the same."""
    return CLOCK.get()()
