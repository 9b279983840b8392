"""Reader and error measure of the worked examples of the Modelica Standard Library.

`converged.csv` of each folder holds an independent solution to 9 digits or more; the error measure and its limit are
those of the data's README.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import acausal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Example:
    """Converged solution of one example: times [s] without those at jumps, and signals by name.

    The times are multiples of `interval` [s], so that a result with this output interval needs no interpolation.
    """

    stop_time: float
    interval: float
    time: Array
    signals: dict[str, Array]


def read_example(folder: Path, file_name: str = "converged.csv") -> Example:
    """Read one file; rows that share their time with a neighbour are an event and are left out.

    `reference.csv` is the published one, with the error of the tool that made it: 2e-3 is what the library asks for.
    """
    with (folder / file_name).open(newline="") as file:
        names, *rows = csv.reader(file)
    data = np.array(rows, dtype=float)
    time = data[:, 0]
    interval = json.loads((folder / "meta.json").read_text())["reference"]["output_interval"]
    events = time[1:][np.diff(time) == 0.0]
    smooth = np.all(np.abs(time[:, None] - events[None, :]) > interval, axis=1)
    columns = {name: data[smooth, k] for k, name in enumerate(names) if k > 0}
    return Example(float(time[-1]), interval, time[smooth], columns)


def error_of(result: acausal.Result, example: Example, spelling: dict[str, str] | None = None) -> dict[str, float]:
    """Largest difference over the range of each signal; for a constant one scaled so that 1e-9 relative becomes 1e-5.

    `spelling` maps names of the data to those of the result where they differ.
    """
    errors = {}
    for name, expected in example.signals.items():
        difference = float(np.max(np.abs(result.at(example.time, (spelling or {}).get(name, name)) - expected)))
        size = max(1.0, float(np.max(np.abs(expected))))
        extent = float(np.ptp(expected))
        errors[name] = difference / extent if extent >= 1e-9 * size else 1e-5 * difference / (1e-9 * size)
    return errors
