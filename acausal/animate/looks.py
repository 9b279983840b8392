"""Looks: the shapes of components, defined separately from their physics.

A look is a function of a `Part` (the component, its path and its values in the result) that yields the shapes to draw.
It belongs to a class and its subclasses. A package of components names the module of its looks,
`__looks__ = "my_library.looks"`, which has them as `LOOKS` by class (library/multibody/looks.py);
`animate(..., looks={MyBody: my_look})` adds others, or replaces these.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from acausal.animate.meshes import Array, Mesh
from acausal.language.component import Component
from acausal.result.result import Result

STEEL, BLUE, ORANGE, DARK, GREEN, RED, GROUND = (
    "#9aa4b0",
    "#4477aa",
    "#ee8833",
    "#444a52",
    "#55a868",
    "#cc3344",
    "#c9cdd2",
)


@dataclass(frozen=True, eq=False)
class Piece:
    """A mesh in the axes of the frame to which it belongs, with its colour `#rrggbb` and its opacity."""

    mesh: Mesh
    color: str = STEEL
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Rigid:
    """Pieces that move with a frame; `trail` is a point in it whose path is drawn."""

    pieces: tuple[Piece, ...]
    frame: str = "frame_a"
    trail: tuple[float, float, float] | None = None
    endless: bool = False
    """Whether it is unbounded, such as the ground, and does not count for the size of the scene."""
    symbol: bool = False
    """Whether it only symbolises a component without a shape; it is omitted if a component with a shape is there."""
    name: str = ""
    """Suffix to the path of its component, if the component has several."""


@dataclass(frozen=True, eq=False)
class Stretched:
    """Pieces of length 1 along z that are stretched from one frame to another."""

    pieces: tuple[Piece, ...]
    frame_a: str = "frame_a"
    frame_b: str = "frame_b"


@dataclass(frozen=True, eq=False)
class Arrow:
    """The force that a component exerts at a frame on its neighbour, drawn on its line of action."""

    frame: str


@dataclass(frozen=True, eq=False)
class Hole:
    """The hole of a drill in a workpiece, as deep as its tip has ever been, seen from inside."""

    frame: str
    diameter: float
    point_angle: float
    thickness: float


Drawn = Rigid | Stretched | Arrow | Hole


@dataclass(frozen=True, eq=False)
class Part:
    """A component in the model, with its values in the result; `size` is that of the scene [m]."""

    component: Component
    owner: Component | None
    path: str
    result: Result
    size: float

    def value(self, name: str) -> Any:
        """Value of a parameter or a constant, a float or an array; of a variable, at the end."""
        return self.result.final(f"{self.path}.{name}" if self.path else name)

    def largest(self, name: str) -> float:
        """The largest value over the run: parameters of a contact that comes and goes are 0 in its absence."""
        return float(np.nanmax(self.result[f"{self.path}.{name}" if self.path else name]))


class Up(NamedTuple):
    """A direction that points up, in the model's axes, shape (3,); of several, one that is `sure` has priority."""

    direction: Array
    sure: bool


Look = Callable[[Part], Iterable[Drawn]]


@dataclass(frozen=True)
class Looks:
    """The looks of the classes of a package, and functions that return the upward direction, by class."""

    looks: Mapping[type[Component], Look]
    up: Mapping[type[Component], Callable[[Part], Up | None]]


@cache
def _looks_of(package: str) -> Looks:
    """The looks in the module that `__looks__` names in a package, or in the nearest enclosing one that has it."""
    while package:
        named = getattr(sys.modules.get(package), "__looks__", None)
        if named is not None:
            found = import_module(named)
            return Looks(getattr(found, "LOOKS", {}), getattr(found, "UP", {}))
        package = package.rpartition(".")[0]
    return Looks({}, {})


def _looks_for(cls: type) -> Looks:
    """The looks in the package of a class; empty for a module outside of packages."""
    return _looks_of(cls.__module__.rpartition(".")[0])


def look_of(component: Component, more: Mapping[type[Component], Look]) -> Look | None:
    """The look of the nearest class; None for a component that is not drawn."""
    for cls in type(component).__mro__:
        found = more.get(cls) or _looks_for(cls).looks.get(cls)
        if found is not None:
            return found
    return None


def up_of(part: Part) -> Up | None:
    """The upward direction by a component, or None."""
    for cls in type(part.component).__mro__:
        found = _looks_for(cls).up.get(cls)
        if found is not None:
            return found(part)
    return None
