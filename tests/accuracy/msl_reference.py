"""Runs of the worked examples of the Modelica Standard Library, compared with the data about them.

`converged.csv` of each folder holds an independent solution to 9 digits or more; the error measure and its limit are
those of the data's README. `reference.csv` is the published run, with the error of the tool that made it: 2e-3 is what
the library asks for.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import acausal
from acausal import Component
from acausal.lower.compiled import CompiledModel

Array = NDArray[np.float64]
_ELEMENT = re.compile(r"\[(\d+)\]")


def met(
    model: Component | CompiledModel,
    folder: Path,
    limit: float = 1e-5,
    *,
    renamed: Mapping[str, str] | None = None,
    file: str = "converged.csv",
    without: Collection[str] = (),
    constant: float = 1e-9,
    tolerance: float = 1e-8,
    solver: str | None = None,
) -> acausal.Result:
    """The run of an example, whose errors must be below the limit; see `errors`."""
    result, found = errors(model, folder, renamed, file, constant, tolerance, solver)
    kept = {name: error for name, error in found.items() if name not in without}
    assert max(kept.values()) <= limit, kept
    return result


def errors(
    model: Component | CompiledModel,
    folder: Path,
    renamed: Mapping[str, str] | None = None,
    file: str = "converged.csv",
    constant: float = 1e-9,
    tolerance: float = 1e-8,
    solver: str | None = None,
) -> tuple[acausal.Result, dict[str, float]]:
    """The run of an example, and the largest difference of each signal over its range.

    That of a constant one is scaled so that `constant` relative becomes 1e-5. Rows that share their time with a
    neighbour are an event and are left out. The times are multiples of the interval of the data, so that the result
    needs no interpolation. `renamed` maps leading parts of Modelica's paths; elements count from 0 here.
    """
    with (folder / file).open(newline="") as lines:
        names, *rows = csv.reader(lines)
    data = np.array(rows, dtype=float)
    time = data[:, 0]
    published: dict[str, Any] = json.loads((folder / "meta.json").read_text())["reference"] or {}
    interval = published.get("output_interval", time[1] - time[0])
    result = acausal.simulate(
        model, stop_time=float(time[-1]), tolerance=tolerance, output_interval=interval, solver=solver
    )
    events = time[1:][np.diff(time) == 0.0]
    smooth = np.all(np.abs(time[:, None] - events[None, :]) > interval, axis=1)
    found = {}
    for name, expected in zip(names[1:], data[smooth, 1:].T, strict=True):
        difference = float(np.max(np.abs(result.at(time[smooth], _own(name, renamed or {})) - expected)))
        size = max(1.0, float(np.max(np.abs(expected))))
        extent = float(np.ptp(expected))
        found[name] = difference / extent if extent >= 1e-9 * size else 1e-5 * difference / (constant * size)
    return result, found


def _own(name: str, renamed: Mapping[str, str]) -> str:
    name = _ELEMENT.sub(lambda m: f"[{int(m[1]) - 1}]", name)
    for theirs, ours in renamed.items():
        if name == theirs or name.startswith((theirs + ".", theirs + "[")):
            return ours + name[len(theirs) :]
    return name
