"""Record of a run: descriptions of signals, events, and the table of all values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from acausal.errors import Span

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Signal:
    """One scalar variable or parameter of a model, and the column that stores it.

    Parameters
    ----------
    name
        Path in the model; elements of arrays carry their index, `body.r_0[2]`, `R[0,1]`.
    unit, doc
        Unit as declared, and the one-line meaning.
    column
        Column of the matrix of trajectories; None for a signal that is constant over the run.
    sign
        +1 or -1: aliases share a column, the value is `sign` times the column.
    value
        Value of a constant signal.
    parameter
        Whether it is a parameter rather than a variable that happens to be constant.
    """

    name: str
    unit: str = ""
    doc: str = ""
    column: int | None = None
    sign: int = 1
    value: float = 0.0
    parameter: bool = False


@dataclass(frozen=True)
class Event:
    """An event: its time [s], the condition as text with its place in the source, and the variables it changed."""

    time: float
    condition: str
    where: Span | None = None
    component: str = ""
    changed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Table:
    """All values of a run, as files store them.

    Parameters
    ----------
    time
        Shape (n,), non-decreasing; two equal neighbours mark an event.
    trajectories
        Shape (n, k); `Signal.column` counts its columns.
    """

    model: str
    time: Array
    trajectories: Array
    signals: Mapping[str, Signal]
    events: tuple[Event, ...] = ()
    stats: Mapping[str, object] = field(default_factory=dict)


def events_at_repeated_times(time: Array) -> tuple[Event, ...]:
    """Events of a file that does not record them: times, shape (n,), that are stored twice."""
    return tuple(Event(float(t), "") for t in np.unique(time[1:][np.diff(time) == 0]))
