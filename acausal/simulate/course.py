"""What is known of a run before it starts: its time events, the modes between them, samples and output times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel
from acausal.simulate.direct import rows
from acausal.simulate.sampling import due

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Course:
    """The segments of a run, between `n` instants.

    Attributes
    ----------
    instants
        Start, time events and samples, stop [s]; ascending, shape (n,).
    modes
        Modes of the relations of time in each segment, shape (n - 1, relations).
    samples
        Which samples are true at each instant, shape (n, samples).
    times
        Output times of all segments, each up to its end, and `ends`, where those of each segment end.
    """

    instants: Vector
    modes: Vector
    samples: Vector
    times: Vector
    ends: NDArray[np.int64]

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.instants) - 1

    def outputs(self, segment: int) -> Vector:
        """Output times of one segment; the last one is its end."""
        return self.times[self.ends[segment - 1] if segment else 0 : self.ends[segment]]


def plan(compiled: CompiledModel, p: Vector, instants: Vector, grid: Vector) -> Course:
    """The course over `instants`, with outputs on `grid` and at every instant."""
    a, b = instants[:-1], instants[1:]
    margin = 1e-12 * (b - a)
    first = np.searchsorted(grid, a + margin, side="right")
    last = np.maximum(np.searchsorted(grid, b - margin, side="left"), first)
    marks = np.zeros(len(grid) + 1)
    np.add.at(marks, first, 1.0)
    np.add.at(marks, last, -1.0)
    inside = np.cumsum(last - first)
    return Course(
        instants,
        rows(compiled.modes, (0.5 * (a + b)[:, None], p))[:, : compiled.n_timely],
        due(compiled, p, instants),
        np.insert(grid[np.cumsum(marks[:-1]) > 0.0], inside, b),
        inside + np.arange(1, len(b) + 1),
    )


@dataclass(frozen=True)
class Place:
    """How far a run has come: `here` [s], in which segment.

    `entered` says whether the event at the start of that segment has been, `fresh` that nothing has followed it yet.
    """

    segment: int
    here: float
    entered: bool
    fresh: bool
