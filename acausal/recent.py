"""Caches: the most recently used values, and values that are kept as long as their owner."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

Owner = TypeVar("Owner")
P = ParamSpec("P")
V = TypeVar("V")


def once_per_owner(function: Callable[Concatenate[Owner, P], V]) -> Callable[Concatenate[Owner, P], V]:
    """The function, called once for each first argument, mostly a compiled model, and hashable further arguments.

    Owners are told apart by identity (or their `__eq__`), and not kept alive as long as no value refers to its owner.
    """
    known: WeakKeyDictionary[Any, dict[tuple[Any, ...], V]] = WeakKeyDictionary()

    @wraps(function)
    def cached(owner: Owner, /, *args: P.args, **kwargs: P.kwargs) -> V:
        values = known.setdefault(owner, {})
        key = *args, *kwargs.items()
        if key not in values:
            values[key] = function(owner, *args, **kwargs)
        return values[key]

    return cached


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
