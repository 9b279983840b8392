"""Data of an optimal-control problem: meshes, phases, guards, boundary values and integrals, constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from acausal.errors import Span


@dataclass(frozen=True)
class Mesh:
    """Collocation or shooting intervals of one phase."""

    fractions: tuple[float, ...]  # lengths of the intervals as fractions of the phase; their sum is 1

    @staticmethod
    def uniform(intervals: int) -> Mesh:
        """Intervals of equal length."""
        return Mesh((1.0 / intervals,) * intervals)

    def refined(self, bad: set[int]) -> Mesh:
        """The mesh with these intervals halved."""
        halves = [[f / 2, f / 2] if k in bad else [f] for k, f in enumerate(self.fractions)]
        return Mesh(tuple(f for part in halves for f in part))

    def __len__(self) -> int:
        return len(self.fractions)


@dataclass(frozen=True, eq=False)
class PhaseSpec:
    """Declaration of one phase."""

    name: str
    # Limits of its duration, and its duration in the guess [s].
    shortest: float
    longest: float
    expected: float
    mesh: Mesh
    # Number of the guard that is zero at its end; None if the end is free or fixed in time.
    switch: int | None = None


@dataclass(frozen=True, eq=False)
class Guard:
    """An expression whose upward zero crossing ends a phase.

    `relation` is its number among the relations of the model, None for an expression of the user; `text` is its text.
    """

    expression: Any
    relation: int | None
    text: str


@dataclass(frozen=True, eq=False)
class Value:
    """A scalar functional of a phase: an expression at its start or end, or integrated over it.

    `kind` is "start", "end" or "integral"; `symbol` stands for it in objective and constraints.
    """

    symbol: Any
    phase: int
    kind: str
    expression: Any


@dataclass(frozen=True, eq=False)
class Constraint:
    """lower <= expression <= upper: a path constraint if the expression varies in time, else a single constraint."""

    name: str
    expression: Any
    lower: float
    upper: float
    phases: tuple[int, ...]  # of a path constraint; empty for a single one
    variable: str | None  # name of the bounded scalar; None for an expression
    scale: float  # the program divides the expression by this magnitude
    where: tuple[Span, ...] = ()
