"""Exported steps, taken one after the other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from acausal.export.step.source import StepFunction

Array = npt.NDArray[np.float64]


def walk(
    step: StepFunction,
    count: int,
    u: npt.ArrayLike = (),
    start: Mapping[str, float] | None = None,
    p: Mapping[str, float] | None = None,
) -> dict[str, Array]:
    """All entries of x and y after each of the steps, shape (count,), by name.

    `u` are the inputs of all steps, or of each in a row; `start` and `p` replace values of the start and parameters.
    """
    x, parameters = np.array(step.x.start), np.array(step.p.start, dtype=float)
    for name, value in (start or {}).items():
        x[step.x.position(name)] = value
    for name, value in (p or {}).items():
        parameters[step.p.position(name)] = value
    rows = []
    for row in np.broadcast_to(np.asarray(u, dtype=float), (count, len(step.u))):
        x, y = (np.asarray(v).ravel() for v in step.function(x, row, parameters))
        rows.append(np.concatenate([x, y]))
    return dict(zip((*step.x.names, *step.y.names), np.array(rows).T, strict=True))
