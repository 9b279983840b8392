"""Values that cost something to make, kept as long as they are among those used last."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

V = TypeVar("V")


class Recent(Generic[V]):
    """Of many values those used last: at most `most`, whose sizes sum up to `room` at most; one at least.

    Threads may share it. Two that miss the same value at once both make it.
    """

    def __init__(self, most: int, size: Callable[[V], int] = lambda _: 0, room: int = 0) -> None:
        self.most, self.size, self.room = most, size, room
        self.entries: OrderedDict[Hashable, V] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: Hashable) -> V | None:
        """The value under this key, which is used by that; None if there is none."""
        with self._lock:
            if key in self.entries:
                self.entries.move_to_end(key)
            return self.entries.get(key)

    def put(self, key: Hashable, value: V) -> V:
        """Keep a value, and return it."""
        with self._lock:
            self.entries[key] = value
            self.entries.move_to_end(key)
            taken = sum(map(self.size, self.entries.values()))
            while len(self.entries) > 1 and (len(self.entries) > self.most or taken > self.room):
                taken -= self.size(self.entries.popitem(last=False)[1])
        return value

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self.entries.clear()
