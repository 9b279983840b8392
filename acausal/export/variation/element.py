"""Interface of one differentiated step, and its arguments."""

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
"""Pulls back rows, shape (k, nx), over an interval to states at its start, same shape, and parameters, (k, count)."""


class Element(Protocol):
    """One step to the time `t` [s], with scaled values there.

    `w`, shape (n,), are states and algebraic variables, `x`, shape (nx, k), the variations that are carried.
    """

    @property
    def t(self) -> float: ...
    @property
    def w(self) -> Vector: ...
    @property
    def x(self) -> Vector: ...

    def adjoint(self, rows: Vector) -> tuple[Vector, Vector]:
        """Pull back `rows`, shape (k, nx), to states at the start, same shape, and to parameters, shape (k, count).

        Steps that carry no variations cannot.
        """
        ...


@dataclass(eq=False)
class Accuracy:
    """What is asked of the variations over an interval.

    `scale`, shape (nx, k), are their largest values over the run, roughly. Steps shorter than `shortest` [s] would not
    make them more accurate, since the ends of the interval are known no better.
    """

    scale: Vector
    shortest: float
    loose: float = 1.0
    """How many times the tolerance of the states variations may be wrong."""
    largest: float | Vector = 0.0
    """The largest values over the interval that have been found, shape (nx, k)."""
    noted: bool = False
    """Whether steps had errors that shorter ones would not make smaller."""


@dataclass(frozen=True, eq=False)
class Interval:
    """An interval from `start` [s], with scaled variables `w`, shape (n,), to the last of `ends` [s].

    Steps end at each of the `ends`. `numbers` are (u, p) as one vector, shape (nu + np,), and modes, shape (nm,).
    Without `accuracy` steps are as long as their states allow. With it, variations are those by k parameters; another k
    columns, if there are any, are what is known to be wrong in them: steps carry it on, and add to it.
    """

    start: float
    ends: Sequence[float]
    w: Vector
    numbers: tuple[Vector, Vector]
    tolerance: float
    accuracy: Accuracy | None = None


@dataclass
class Stiffness:
    """Whether steps of a run have turned out to be stiff, remembered from stretch to stretch."""

    stiff: bool = False
