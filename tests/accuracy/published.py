"""Comparison of a result with one of the published examples, as their README prescribes it."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from acausal import Result

_ELEMENT = re.compile(r"\[(\d+)\]")
Array = npt.NDArray[np.float64]


def read(example: Path, file: str = "converged.csv") -> tuple[Array, dict[str, Array]]:
    """Times and signals of a file of an example, about fifty rows of it."""
    with (example / file).open() as lines:
        names, *rows = csv.reader(lines)
    rows = rows[:: max(1, len(rows) // 50)] + rows[-1:]
    table = np.array([[float(cell) for cell in row] for row in rows])
    return table[:, 0], {name: table[:, k] for k, name in enumerate(names) if k}


def our_name(name: str, renamed: Mapping[str, str]) -> str:
    """A Modelica path as a path here: elements count from 0; `renamed` maps leading parts of paths."""
    name = _ELEMENT.sub(lambda m: f"[{int(m[1]) - 1}]", name)
    for theirs, ours in renamed.items():
        if name == theirs or name.startswith((theirs + ".", theirs + "[")):
            return ours + name[len(theirs) :]
    return name


def worst_error(
    result: Result,
    example: Path,
    renamed: Mapping[str, str] | None = None,
    file: str = "converged.csv",
    constant: float = 1e-9,
) -> tuple[float, str]:
    """Largest deviation over the range of its signal, and that signal; constant signals must agree to `constant`."""
    times, signals = read(example, file)
    worst, guilty = 0.0, ""
    for name, expected in signals.items():
        got = np.asarray(result.at(times, our_name(name, renamed or {})))
        deviation = float(np.abs(got - expected).max())
        extent = float(np.ptp(expected))
        size = max(1.0, float(np.abs(expected).max()))
        error = deviation / extent if extent > 1e-9 * size else (0.0 if deviation <= constant * size else np.inf)
        if error > worst:
            worst, guilty = error, name
    return worst, guilty
