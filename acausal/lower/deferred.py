"""Compiled models of what may change its structure: the equations with all of it are made when somebody asks for them.

A scene of 64 balls has 2080 pairs, of which a run needs 64 at a time, and compiles those
(`acausal.simulate.restructure`). Whoever only runs it would wait for equations that are never looked at.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from acausal.lower.compiled import CompiledModel
from acausal.lower.lowered import Recipe

# What is known before there are equations.
_KNOWN = frozenset(("recipe", "is_made", "__class__", "__dict__", "__hash__", "__weakref__"))
_MAKE, _LOCK = "_make", "_lock"


class DeferredModel(CompiledModel):
    """A compiled model that is made when something of it but its recipe is asked for."""

    @classmethod
    def of(cls, recipe: Recipe, make: Callable[[], CompiledModel]) -> CompiledModel:
        """The model that `make` will make, of this recipe."""
        model = cls.__new__(cls)
        model.__dict__.update({"recipe": recipe, _MAKE: make, _LOCK: threading.Lock()})
        return model

    @property
    def is_made(self) -> bool:
        """Whether there are equations yet."""
        return _MAKE not in self.__dict__

    def __getattribute__(self, name: str) -> Any:
        if name not in _KNOWN:
            own = object.__getattribute__(self, "__dict__")
            if _MAKE in own:
                _fill(own)
        return object.__getattribute__(self, name)


def _fill(own: dict[str, Any]) -> None:
    """Put what is made in place of what makes it."""
    with own[_LOCK]:
        make = own.get(_MAKE)
        if make is None:  # another thread was faster
            return
        made = make()
        own.update({name: value for name, value in made.__dict__.items() if name != "recipe"})
        del own[_MAKE]
