"""A cache of the most recently used values."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

V = TypeVar("V")


class Recent(Generic[V]):
    """The values used last: at most `most`, with a total size of at most `room`, but always at least one.

    Threads may share it; two threads that miss the same value at the same time both compute it.
    """

    def __init__(self, most: int, size: Callable[[V], int] = lambda _: 0, room: int = 0) -> None:
        self.most, self.size, self.room = most, size, room
        self.entries: OrderedDict[Hashable, V] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Hashable) -> V | None:
        """The value of this key, which becomes the most recently used; None if there is none."""
        with self._lock:
            if key in self.entries:
                self.entries.move_to_end(key)
            return self.entries.get(key)

    def put(self, key: Hashable, value: V) -> V:
        """Store a value, and return it."""
        with self._lock:
            self.entries[key] = value
            self.entries.move_to_end(key)
            total = sum(map(self.size, self.entries.values()))
            while len(self.entries) > 1 and (len(self.entries) > self.most or total > self.room):
                total -= self.size(self.entries.popitem(last=False)[1])
        return value

    def clear(self) -> None:
        """Remove all values."""
        with self._lock:
            self.entries.clear()
