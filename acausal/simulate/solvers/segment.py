"""What a solver is asked, within which tolerances, and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acausal.arrays import Vector


@dataclass(frozen=True, eq=False)
class Segment:
    """One stretch: from `start` to the last of `times` (ascending, all after `start`).

    `x` (all states), `z` are consistent at the start; `p` are the modes of the time events. `step_budget` is the number
    of steps between two output times after which a solver gives up; None: as many as a long run may need. `first` is
    the first step, 0 to have it estimated. With `partial`, the rows before a failure are a result (see `Piece`);
    without any row it is a RuntimeError as always.

    `shares` says that the times are these shares of the whole: one of a few grids, whose integrators are kept.
    Integrals that act on nothing are left as they are at the start. IDAS begins without derivatives, and wants a
    `first` step in which the states change by less than their tolerance.
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
    shares: Vector | None = None

    @property
    def length(self) -> float:
        """From the start to the last of the times [s]."""
        return float(self.times[-1]) - self.start

    @property
    def most_steps(self) -> int:
        """Steps between two output times; with few of these, as many as a run with many would be allowed."""
        return self.step_budget or max(20_000, 400_000 // len(self.times))


@dataclass(frozen=True, eq=False)
class Piece:
    """Values at `segment.times`: `x` of shape (nx, n), `z` of shape (nz, n), and the solver's counters.

    Of a `partial` segment perhaps only the first of them: `stopped` says then in the solver's words why.
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
    """A relative tolerance, and `factor` times as much in nominal magnitudes as the absolute one."""

    relative: float
    factor: float = 1e-3

    @property
    def absolute(self) -> float:
        """The absolute tolerance, in nominal magnitudes."""
        return self.relative * self.factor

    def scaled(self, share: float, least: float = 0.0) -> Tolerances:
        """So many times both, and the relative one at least `least`."""
        return replace(self, relative=max(share * self.relative, least))

    def of(self, values: ArrayLike, nominal: ArrayLike = 1.0) -> NDArray[np.float64]:
        """What values of this size may be off, shape that of the values; `nominal` where they are not scaled."""
        return np.asarray(self.relative * np.abs(values) + self.absolute * np.asarray(nominal))
