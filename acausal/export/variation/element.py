"""Interface of one differentiated step, and its arguments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from acausal.arrays import Vector

SMALL = 1e-3
"""Scaled value of a variable below which its error is controlled absolutely."""
LEAST = 1e-40
"""Smallest step, relative to the stretch."""


class Element(Protocol):
    """One step to the time `t` [s]; `w`, shape (n,), are the scaled states and algebraic variables there."""

    @property
    def t(self) -> float: ...
    @property
    def w(self) -> Vector: ...

    def forward(self, x: Vector, parameters: bool = True) -> Vector:
        """Variations at the end, shape (nx, k), due to `x` at the start, same shape, and to a parameter per column."""
        ...

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Pull back `rows`, shape (k, nx), to states at the start, same shape, and to parameters, shape (k, count)."""
        ...


@dataclass(frozen=True, eq=False)
class Interval:
    """An interval from `start` [s], with scaled variables `w`, shape (n,), to the last of `ends` [s].

    Steps end at each of the `ends`. `numbers` are (u, p) as one vector, shape (nu + np,), and modes, shape (nm,).
    """

    start: float
    ends: Sequence[float]
    w: Vector
    numbers: tuple[Vector, Vector]
    tolerance: float


@dataclass
class Stiffness:
    """Whether steps of a run have turned out to be stiff, remembered from stretch to stretch."""

    stiff: bool = False
