"""Functions of higher packages that methods in lower packages call, such as `result.plot()`, without an import cycle.

The class in the lower package declares the method with its types, and requests the function by name with `provided`.
`acausal/__init__.py`, which may import every package and is imported by none of them, registers the module of each
function. That module is loaded on the first request.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

_MODULES: dict[str, str] = {}


def provide(modules: Mapping[str, str]) -> None:
    """Register the modules of functions, by the names of the functions."""
    _MODULES.update(modules)


def provided(name: str) -> Any:
    """The function of this name, whose module is loaded if necessary."""
    return getattr(import_module(_MODULES[name]), name)


class Diagram(Protocol):
    """A picture of the connections of a model; `acausal.diagram` makes it."""

    def svg(self) -> str:
        """The picture; UsageError AC084 without dukpy."""
        ...

    def html(self) -> str:
        """A page in which blocks open and close on a click."""
        ...

    def save(self, path: str | Path) -> Path:
        """Write `.svg` or `.html`; UsageError AC012 or AC013."""
        ...
