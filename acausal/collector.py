"""Control of the garbage collector while many long-lived objects are made."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Least number of new objects that are moved to the oldest generation, and number of those objects after which the next
# pause begins with a full collection.
_LEAST_PROMOTED, _MOST_UNCOLLECTED = 100_000, 2_000_000


class _Promoted:
    """Number of objects that have been moved to the oldest generation without a collection since the last full one."""

    count = 0


@contextmanager
def collector_paused() -> Iterator[None]:
    """Pause cyclic garbage collection, which takes a quarter of the time for a model of millions of tuples.

    Objects that are made during the pause belong to the youngest generation, so that the collector would traverse all
    of them when it resumes, and twice more as they pass through the generations. If there are many, they are therefore
    moved to the oldest generation directly, at no cost, and collected with it. After millions of such objects, the next
    pause begins with a full collection, so that models made in a loop do not accumulate.
    """
    if not gc.isenabled():
        yield  # within another pause, or disabled by the user
        return
    if _Promoted.count > _MOST_UNCOLLECTED:
        gc.collect()
        _Promoted.count = 0
    gc.disable()
    try:
        yield
    finally:
        young = gc.get_count()[0]
        if young > _LEAST_PROMOTED and gc.get_freeze_count() == 0:  # `unfreeze` must not release a user's objects
            gc.freeze()
            gc.unfreeze()  # moves them to the oldest generation
            _Promoted.count += young
        gc.enable()
