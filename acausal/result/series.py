"""A measured or computed signal over time, for `simulate(inputs=...)`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from acausal.arrays import Vector
from acausal.errors import UsageError, nearest
from acausal.result.csvfile import Sheet, read_sheet
from acausal.result.files import read
from acausal.result.result import Result
from acausal.result.seconds import seconds

INTERPOLATIONS = ("linear", "hold", "smooth")


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """Values of one signal at discrete times, and how they are interpolated.

    Attributes
    ----------
    time, value
        Times [s], or durations, ascending, and values, both of shape (n,), n >= 2. Two equal times are a jump: the
        values before and after it.
    interpolation
        "linear"; "hold": each value lasts to the next time; "smooth": a cubic spline with two continuous
        derivatives between jumps.
    unit
        Unit of the values; "" means that of the input they drive.
    name
        Origin of the values, for messages.

    Raises
    ------
    UsageError
        AC044 for different lengths, times that do not ascend, and values that are not finite.
    """

    time: ArrayLike
    value: ArrayLike
    interpolation: str = "linear"
    unit: str = ""
    name: str = "the series"

    def __post_init__(self) -> None:
        try:
            time, value = np.array(seconds(self.time)), np.array(self.value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise UsageError("AC044", f"{self.name} does not consist of numbers: {error}") from None
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "value", value)
        if self.interpolation not in INTERPOLATIONS:
            fact = f"there is no interpolation '{self.interpolation}'"
            raise UsageError("AC044", fact, help=f"interpolations: {', '.join(INTERPOLATIONS)}")
        if time.ndim != 1 or time.shape != value.shape or len(time) < 2:
            raise UsageError(
                "AC044",
                f"{self.name} has times of shape {time.shape} and values of shape {value.shape}",
                help="give as many values as times, and at least two",
            )
        for k in np.flatnonzero(~(np.isfinite(time) & np.isfinite(value)))[:1].tolist():
            raise UsageError(
                "AC044",
                f"{self.name}, row {k + 1}: {value[k]} at t = {time[k]} s is not finite",
                help="leave out rows without a value; in data for a fit leave such cells empty",
            )
        back = np.flatnonzero(np.diff(time) < 0.0)
        triple = np.flatnonzero(time[2:] == time[:-2])
        for k in [*back[:1].tolist(), *triple[:1].tolist()]:
            raise UsageError(
                "AC044",
                f"{self.name}, row {k + 2}: t = {float(time[k + 1])} s follows t = {float(time[k])} s",
                help="times ascend; two equal times are a jump, three are not",
            )

    @property
    def times(self) -> Vector:
        """The times [s] as an array of shape (n,)."""
        return np.asarray(self.time)

    @property
    def values(self) -> Vector:
        """The values as an array of shape (n,)."""
        return np.asarray(self.value)


def read_series(file: str | Path, column: str | None = None, interpolation: str = "linear") -> TimeSeries:
    """One column of a CSV file, or one signal of a result (`.mat`, `.npz`, `.parquet`).

    The layout of CSV files is described in `acausal.result.csvfile`.

    Raises UsageError: AC014 for a file that cannot be read, AC045 for one without such a column, or with a cell that is
    not a number.

    `column`: name of the column, with or without its unit; not needed for a file with one column besides the time.
    """
    path = Path(file)
    if path.suffix.lower() != ".csv":
        return _from_result(path, column, interpolation)
    sheet = read_sheet(path)
    k = _column_index(sheet, column)
    values = sheet.numbers(sheet.rows(), (sheet.clock, k))
    time = sheet.seconds(values[:, 0])
    return TimeSeries(time, values[:, 1], interpolation, sheet.units[k], f"{path}, column {sheet.header[k]}")


def read_all(file: str | Path) -> dict[str, TimeSeries]:
    """Every column of a CSV file, by name; each column skips its own empty cells.

    Raises UsageError: AC014 for a file that cannot be read, AC045 for a cell that is not a number, or a column with
    less than two numbers.
    """
    path = Path(file)
    sheet = read_sheet(path)
    rows = sheet.rows()
    series: dict[str, TimeSeries] = {}
    for k, name in enumerate(sheet.names):
        if k == sheet.clock:
            continue
        if name in series:
            raise UsageError("AC045", f"{path} has two columns '{name}'", help="give each its own name")
        rows_with_value = [(line, row) for line, row in rows if len(row) > k and row[k]]
        if len(rows_with_value) < 2:
            raise UsageError(
                "AC045", f"{path}: column {sheet.header[k]} has {len(rows_with_value)} numbers", help="leave it out"
            )
        values = sheet.numbers(rows_with_value, (sheet.clock, k))
        time = sheet.seconds(values[:, 0])
        series[name] = TimeSeries(time, values[:, 1], "linear", sheet.units[k], f"{path}, column {sheet.header[k]}")
    return series


def _column_index(sheet: Sheet, column: str | None) -> int:
    """Index of the named column, or of the only one besides the time."""
    path, header, names = sheet.path, sheet.header, sheet.names
    others = [k for k in range(len(names)) if k != sheet.clock]
    if column is None and len(others) == 1:
        return others[0]
    fitting = [k for k in others if column in (names[k], header[k])]
    if len(fitting) == 1:
        return fitting[0]
    fact = (
        f"{path} has {len(others)} columns besides the time" if column is None else f"{path} has no column '{column}'"
    )
    if len(fitting) > 1:
        fact = f"{path} has {len(fitting)} columns '{column}'"
    close = nearest(column, [names[k] for k in others]) if column is not None else []
    raise UsageError(
        "AC045",
        fact,
        evidence=[f"did you mean {', '.join(close)}?"] if close else [f"its columns: {', '.join(header[:8])}"],
        help=f"{path}:{names[others[0]]}" if others else "add a column besides that of times",
    )


def _from_result(path: Path, column: str | None, interpolation: str) -> TimeSeries:
    result = Result(**vars(read(path)))
    if column is None:
        raise UsageError(
            "AC045", f"{path} contains {len(result.names)} signals", help=f"name one: {path}:{result.names[0]}"
        )
    return TimeSeries(result.time, result[column], interpolation, result.unit(column), f"{path}, signal {column}")
