"""What an optimal-control problem is made of, as data: phases, constraints, and values at single instants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from acausal.errors import Span


@dataclass(frozen=True)
class Mesh:
    """Intervals of one phase."""

    fractions: tuple[float, ...]  # lengths of the intervals as shares of the phase; their sum is 1

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
    """One phase as it was declared."""

    name: str
    # `shortest`, `longest`, `expected`: limits of its duration, and the one that the guess has [s].
    shortest: float
    longest: float
    expected: float
    mesh: Mesh
    # Number of the guard that is zero at its end; None for an end that is free or fixed in time only.
    switch: int | None = None


@dataclass(frozen=True, eq=False)
class Guard:
    """An expression that passes zero, from below, where a phase ends.

    `relation` is its number among the relations of the model, None for an expression of the user's own; `text` is how
    it was written.
    """

    expression: Any
    relation: int | None
    text: str


@dataclass(frozen=True, eq=False)
class Value:
    """A number that belongs to a phase: an expression at its start or end, or integrated over it.

    `kind` is "start", "end" or "integral"; `symbol` stands for it in objective and constraints.
    """

    symbol: Any
    phase: int
    kind: str
    expression: Any


@dataclass(frozen=True, eq=False)
class Constraint:
    """lower <= expression <= upper: along phases where it holds quantities that vary, else once."""

    name: str
    expression: Any
    lower: float
    upper: float
    phases: tuple[int, ...]  # where a path constraint holds; empty for a constraint on numbers
    variable: str | None  # name of the scalar that is bounded; None for an expression
    scale: float  # magnitude that the expression is divided by in the program
    where: tuple[Span, ...] = ()
