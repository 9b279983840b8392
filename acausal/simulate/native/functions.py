"""CasADi functions made of compiled libraries."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca

from acausal.private import discard
from acausal.simulate.native import cache, source


def native(function: Any, *companions: Any) -> Any | None:
    """The function as compiled C; None when it cannot be had, which is never an error.

    `function`: A CasADi function; its name stays.
    `companions`: More functions for the same library. CasADi takes a function that is derived from an external one,
    such as an integrator's `jacF`, from the library when it is there by that name.
    """
    parts = (function, *companions)
    key = cache.key("functions", *(part.serialize() for part in parts))
    return made(key, lambda: source.functions(*parts), lambda path: ca.external(function.name(), str(path)))


def made(key: str, text: Callable[[], str | None] | None, load: Callable[[Path], Any]) -> Any | None:
    """What `load` makes of the library of this key; without `text` only when it is there already.

    A library that does not load is removed and made again, once.
    """
    path = cache.find(key)
    found = _loaded(path, load)
    if found is not None or text is None or cache.compiler() is None:
        return found
    written = text()
    return None if written is None else _loaded(cache.build(key, written), load)


def _loaded(path: Path | None, load: Callable[[Path], Any]) -> Any | None:
    if path is None:
        return None
    try:
        return load(path)
    except (OSError, AttributeError, RuntimeError):
        discard(path)
        return None
