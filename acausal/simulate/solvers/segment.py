"""The input of a solver (a segment, with tolerances) and its output (a piece of the solution)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acausal.arrays import Vector


@dataclass(frozen=True, eq=False)
class Segment:
    """An interval of time to integrate, from `start` to the last of `times` (ascending, all after `start`) [s].

    Attributes
    ----------
    x, z
        All states and the algebraic variables, consistent at the start.
    p
        Modes of the time events.
    step
        The fixed step [s]; None if the solver chooses its steps, at most `max_step`.
    step_budget
        Steps between two output times after which a solver gives up; None allows as many as a long run may need.
    first
        The first step [s]; 0 to have it estimated.
    partial
        Return the rows before a failure (see `Piece`); a failure before the first row still is a RuntimeError.
    fractions
        The times as fractions of the length, if they are one of a few grids whose integrators are cached. IDAS
        begins without derivatives then: it needs a `first` step in which the states change by less than their
        tolerance.
    bare
        Let quadratures keep their start values: guards do not depend on them, and few of thousands of mesh points are
        outputs.
    """

    start: float
    times: Vector
    x: Vector
    z: Vector
    p: Vector
    tolerances: Tolerances
    step: float | None
    max_step: float | None = None
    step_budget: int | None = None
    first: float = 0.0
    partial: bool = False
    fractions: Vector | None = None
    bare: bool = False

    @property
    def length(self) -> float:
        """Time from the start to the last output [s]."""
        return float(self.times[-1]) - self.start

    @property
    def most_steps(self) -> int:
        """Largest number of steps between two output times, more if there are few of these."""
        return self.step_budget or max(20_000, 400_000 // len(self.times))


@dataclass(frozen=True, eq=False)
class Piece:
    """Values at `segment.times`: `x` of shape (nx, n), `z` of shape (nz, n), and the solver's counters.

    For a `partial` segment these may be only the first of the times; `stopped` is then the solver's message.
    """

    x: Vector
    z: Vector
    counters: dict[str, float]
    stopped: str = ""


def add_counters(total: dict[str, float], more: Mapping[str, float]) -> None:
    """Add the counters of a piece to those of a run."""
    for name, count in more.items():
        total[name] = total.get(name, 0.0) + count


@dataclass(frozen=True)
class Tolerances:
    """A relative tolerance, and an absolute one of `factor` times its value, in nominal magnitudes."""

    relative: float
    factor: float = 1e-3

    @property
    def absolute(self) -> float:
        """The absolute tolerance, in nominal magnitudes."""
        return self.relative * self.factor

    def scaled(self, scale: float, least: float = 0.0) -> Tolerances:
        """Return both tolerances times `scale`, the relative one at least `least`."""
        return replace(self, relative=max(scale * self.relative, least))

    def of(self, values: ArrayLike, nominal: ArrayLike = 1.0) -> NDArray[np.float64]:
        """Allowed errors of values, in their shape; `nominal` are the nominal magnitudes of unscaled values."""
        return np.asarray(self.relative * np.abs(values) + self.absolute * np.asarray(nominal))
