"""Sampled trajectory of a run: chosen variables on a fixed grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.lower.compiled import CompiledModel
from acausal.reduce.outputs import fitting
from acausal.result.result import Result
from acausal.simulate.record.record import signals

# Maximum number of variables that replace states in a model without states.
_MOST_VARIABLES = 100
POINTS = 200
"""Points of the grid after the start, as in the published test sets."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Values of shape (n, k) of k variables at n times."""

    times: Vector
    names: tuple[str, ...]
    values: Vector

    def every(self, stride: int) -> Trajectory:
        """Every `stride`-th point from the first on."""
        return Trajectory(self.times[::stride], self.names, self.values[::stride])


def components(compiled: CompiledModel, wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the compared scalars: requested ones, with arrays expanded and `*` as wildcard, or all states.

    Raises UsageError: AC010 for an unknown name, AC040 if there is nothing to compare.
    """
    known = signals(compiled, np.array(compiled.parameter_values, dtype=float))
    if wanted:
        shell = Result(compiled.name, np.zeros(1), np.zeros((1, len(compiled.columns))), known)
        varying = [name for name, signal in known.items() if signal.column is not None]
        names = [fit for name in wanted for fit in fitting(name, varying) or [name]]
        found = [s.name for name in names for s in shell.elements(name)[1]]
    else:
        dynamic = compiled.states[: compiled.n_dynamic] or compiled.states
        moving = {name for name, signal in known.items() if signal.column is not None and not signal.parameter}
        # without states, all varying variables, up to a readable number
        found = [name for name in dynamic if name in moving] or sorted(moving)[:_MOST_VARIABLES]
    if not found:
        raise UsageError(
            "AC040",
            f"{compiled.name} has no states whose errors could be compared",
            help="name variables to compare: --signals A,B",
        )
    return tuple(dict.fromkeys(found))


def sampled(result: Result, names: Sequence[str], points: int, span: float) -> Trajectory:
    """Values after each of `points` equal intervals, which the output grid of the run contains; at an event, after it.

    If the model terminates its run before `span`, the last values are repeated.
    """
    times = float(result.time[0]) + span * np.arange(points + 1) / points
    rows = np.searchsorted(result.time, times + 1e-11 * span, side="right") - 1
    columns = [result.elements(name)[1][0] for name in names]
    values = np.empty((len(times), len(names)))
    for k, signal in enumerate(columns):
        values[:, k] = signal.value if signal.column is None else signal.sign * result.matrix[rows, signal.column]
    return Trajectory(times, tuple(names), values)
