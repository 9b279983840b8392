"""One step of a variation, whatever its method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from acausal.arrays import Vector

SMALL = 1e-3
"""Of a variable by its nominal magnitude, the size below which its error counts as absolute."""
LEAST = 1e-40
"""The share of a stretch below which a step is none."""


class Element(Protocol):
    """One step to the time `t`, where states and algebraic variables by their magnitudes are `w`."""

    @property
    def t(self) -> float: ...
    @property
    def w(self) -> Vector: ...

    def forward(self, x: Vector, parameters: bool = True) -> Vector:
        """Variations at the end, shape (nx, k), from those at the start and, one in each column, from parameters."""
        ...

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Derivatives by the states at the start and by parameters, of what has `rows`, (k, nx), at the end."""
        ...


@dataclass(frozen=True, eq=False)
class Way:
    """What is stepped over: from `start`, where variables by their magnitudes are `w`, to the last of `ends`.

    Steps end at each of the `ends`. `numbers` are (u, p) in one vector, and the modes.
    """

    start: float
    ends: Sequence[float]
    w: Vector
    numbers: tuple[Vector, Vector]
    tolerance: float


@dataclass
class Temper:
    """Whether the steps of a run have turned out to be stiff; kept from stretch to stretch."""

    stiff: bool = False
