"""Who does what for the packages below: `result.plot()` belongs to results, and is done by the package that draws.

A class below states such a method with the types that its callers see, and asks for who does it; the package above has
the function. `acausal/__init__.py`, which knows every package and which none of them imports, says who does what. The
module of a function is loaded when it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

_MODULES: dict[str, str] = {}


def provide(modules: Mapping[str, str]) -> None:
    """Say in which modules functions of these names are."""
    _MODULES.update(modules)


def provided(name: str) -> Any:
    """The function of that name."""
    return getattr(import_module(_MODULES[name]), name)


class Diagram(Protocol):
    """A model's connections as a picture; `acausal.diagram` makes it."""

    def svg(self) -> str:
        """The picture; UsageError AC084 without dukpy."""
        ...

    def html(self) -> str:
        """A page in which blocks open and close on a click."""
        ...

    def save(self, path: str | Path) -> Path:
        """Write `.svg` or `.html`; UsageError AC012 or AC013."""
        ...
