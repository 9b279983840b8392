"""Interface of one differentiated step, and the data that steps share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from acausal.arrays import Vector

SMALL = 1e-3
"""Scaled value of a variable below which its error is controlled absolutely."""
LEAST = 1e-40
"""Smallest step, relative to the stretch."""


Back = Callable[[Vector], tuple[Vector, Vector]]
"""Function that pulls rows, shape (k, nx), back over an interval.

It returns the rows for the states at the start, same shape, and for the parameters, (k, count).
"""


class Element(Protocol):
    """One step to the time `t` [s], with the scaled values there.

    `w`, shape (n,), are states and algebraic variables, `x`, shape (nx, k), the variations.
    """

    @property
    def t(self) -> float: ...
    @property
    def w(self) -> Vector: ...
    @property
    def x(self) -> Vector: ...

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Pull `rows`, shape (k, nx), back to states at the start, same shape, and to parameters, shape (k, count).

        This is possible only for steps that carry variations.
        """
        ...


@dataclass(eq=False)
class Accuracy:
    """Accuracy required of the variations over an interval, and the outcome.

    `scale`, shape (nx, k), are their approximate largest values over the run. Steps shorter than `shortest` [s] would
    not make them more accurate, because this is the uncertainty of the ends of the interval.
    """

    scale: Vector
    shortest: float
    loose: float = 1.0
    """Tolerance of the variations, in tolerances of the states."""
    largest: float | Vector = 0.0
    """Outcome: the largest values over the interval, shape (nx, k)."""
    noted: bool = False
    """Outcome: whether steps had errors that shorter ones would not reduce."""


@dataclass(frozen=True, eq=False)
class Interval:
    """An interval from `start` [s], with scaled variables `w`, shape (n,), to the last of `ends` [s].

    Steps end at each of the `ends`. `numbers` are (u, p) as one vector, shape (nu + np,), and modes, shape (nm,).
    Without `accuracy` the states alone limit the steps. With it, the variations are those by k parameters; another k
    columns, if there are any, contain their known errors, which steps propagate and add to.
    """

    start: float
    ends: Sequence[float]
    w: Vector
    numbers: tuple[Vector, Vector]
    tolerance: float
    accuracy: Accuracy | None = None


@dataclass
class Stiffness:
    """Whether a run has turned out to be stiff, remembered from stretch to stretch."""

    stiff: bool = False
