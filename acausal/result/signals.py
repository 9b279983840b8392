"""What a run recorded: the description of every signal, the events, and the table they live in."""

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
    """One scalar variable or parameter of a model, and where its values are.

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
    """A point in time where something jumped: the condition as text, its source, and the variables changed."""

    time: float
    condition: str
    where: Span | None = None
    component: str = ""
    changed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Table:
    """All values of a run, as they go into a file and come out of it.

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


def doubled(time: Array) -> tuple[Event, ...]:
    """Events of a file that does not record them: the times stored twice."""
    return tuple(Event(float(t), "") for t in np.unique(time[1:][np.diff(time) == 0]))
