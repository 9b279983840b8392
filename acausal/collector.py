"""Garbage collection while much is made that lives."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Objects that are worth a pass of their own over all that lives, and those that may wait for it without one.
_MANY, _MOST = 100_000, 2_000_000


class _Aged:
    """Objects of this process that have been called old without being looked at, since the last look at all."""

    count = 0


@contextmanager
def collector_paused() -> Iterator[None]:
    """No cyclic garbage collection: a large model is millions of tuples without cycles, its passes cost a quarter.

    What was made meanwhile is young when the collector goes on, so that it would walk through all of it at once, again
    at its next step, and again at the one after that. Many objects are therefore called old as they are, which costs
    nothing; the collector sees them with everything that is old. Once millions have grown old that way, the next pause
    begins with a look at all, so that the models of a loop do not pile up.
    """
    if not gc.isenabled():
        yield  # within another pause, or the user's own wish
        return
    if _Aged.count > _MOST:
        gc.collect()
        _Aged.count = 0
    gc.disable()
    try:
        yield
    finally:
        young = gc.get_count()[0]
        if young > _MANY and gc.get_freeze_count() == 0:  # what a user has frozen stays frozen
            gc.freeze()
            gc.unfreeze()  # into the oldest generation
            _Aged.count += young
        gc.enable()
