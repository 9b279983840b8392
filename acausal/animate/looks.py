"""How components look. Shapes are attached from outside of the physics.

A look is a function of a `Part`, which knows the component, its path and its values in the result, and yields what is
to be drawn. It belongs to a class and its subclasses. A package of components names the module of its looks,
`__looks__ = "my_library.looks"`, which holds them as `LOOKS` by class (library/multibody/looks.py);
`animate(..., looks={MyBody: my_look})` adds more, or replaces these.
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
    """A mesh in the axes of what it hangs on, with its colour `#rrggbb` and how much of it lets light through."""

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
    """Whether it has no extent of its own: the ground."""
    symbol: bool = False
    """Whether it only stands for something that has no shape; it is left out where something with a shape is."""
    name: str = ""
    """What it is called behind the path of its component, when a component has several."""


@dataclass(frozen=True, eq=False)
class Stretched:
    """Pieces of length 1 along z that reach from one frame to another."""

    pieces: tuple[Piece, ...]
    frame_a: str = "frame_a"
    frame_b: str = "frame_b"


@dataclass(frozen=True, eq=False)
class Arrow:
    """The force that a component puts on what is connected to a frame, on its line of action."""

    frame: str


@dataclass(frozen=True, eq=False)
class Hole:
    """What a drill has left in a workpiece: as deep as its tip has ever been, seen from inside."""

    frame: str
    diameter: float
    point_angle: float
    thickness: float


Drawn = Rigid | Stretched | Arrow | Hole


@dataclass(frozen=True, eq=False)
class Part:
    """A component in its place, with what the result says about it; `size` is that of the scene [m]."""

    component: Component
    owner: Component | None
    path: str
    result: Result
    size: float

    def value(self, name: str) -> Any:
        """Value of a parameter or a constant, a float or an array; of a variable, at the end."""
        return self.result.final(f"{self.path}.{name}" if self.path else name)

    def largest(self, name: str) -> float:
        """The largest value over the run: a parameter of a contact that comes and goes is 0 while it is not there."""
        return float(np.nanmax(self.result[f"{self.path}.{name}" if self.path else name]))


class Up(NamedTuple):
    """A direction that points up, in the model's axes, shape (3,); where several say so, the one that is `sure`."""

    direction: Array
    sure: bool


Look = Callable[[Part], Iterable[Drawn]]


@dataclass(frozen=True)
class Looks:
    """What a package says of its classes: how they look, and which way is up by them."""

    looks: Mapping[type[Component], Look]
    up: Mapping[type[Component], Callable[[Part], Up | None]]


@cache
def _looks_of(package: str) -> Looks:
    """The module that a package, or the nearest one around it that says so, names in `__looks__`."""
    while package:
        named = getattr(sys.modules.get(package), "__looks__", None)
        if named is not None:
            found = import_module(named)
            return Looks(getattr(found, "LOOKS", {}), getattr(found, "UP", {}))
        package = package.rpartition(".")[0]
    return Looks({}, {})


def _said_of(cls: type) -> Looks:
    """What the package of a class says; modules that stand in no package say nothing."""
    return _looks_of(cls.__module__.rpartition(".")[0])


def look_of(component: Component, more: Mapping[type[Component], Look]) -> Look | None:
    """The look of the nearest class; None for what is not drawn."""
    for cls in type(component).__mro__:
        found = more.get(cls) or _said_of(cls).looks.get(cls)
        if found is not None:
            return found
    return None


def up_of(part: Part) -> Up | None:
    """Which way is up by a component; None for what does not know."""
    for cls in type(part.component).__mro__:
        found = _said_of(cls).up.get(cls)
        if found is not None:
            return found(part)
    return None
