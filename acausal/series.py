"""A measured or computed signal over time, as `simulate(inputs=...)` takes it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acausal.errors import UsageError, nearest
from acausal.units import in_si

Vector = NDArray[np.float64]
INTERPOLATIONS = ("linear", "hold", "smooth")
_DELIMITERS = ",;\t"


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """Values of one signal at instants.

    Attributes
    ----------
    time, value
        Seconds, ascending, and values; shape (n,), n >= 2. Two equal times are a jump: the value before and after it.
    interpolation
        "linear"; "hold": each value lasts to the next instant; "smooth": a cubic spline with two continuous
        derivatives between jumps.
    unit
        Unit of the values; "" means the one of the input they are given to.
    name
        Where they come from, for messages.

    Raises
    ------
    UsageError
        AC044 for values that are no series: other lengths, times that go back, what is not finite.
    """

    time: ArrayLike
    value: ArrayLike
    interpolation: str = "linear"
    unit: str = ""
    name: str = "the series"

    def __post_init__(self) -> None:
        try:
            time, value = (np.array(v, dtype=np.float64) for v in (self.time, self.value))
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
                help="as many values as times, two at least",
            )
        for k in np.flatnonzero(~(np.isfinite(time) & np.isfinite(value)))[:1].tolist():
            raise UsageError("AC044", f"{self.name}, row {k + 1}: {value[k]} at t = {time[k]} s is not finite")
        back = np.flatnonzero(np.diff(time) < 0.0)
        triple = np.flatnonzero(time[2:] == time[:-2])
        for k in [*back[:1].tolist(), *triple[:1].tolist()]:
            raise UsageError(
                "AC044",
                f"{self.name}, row {k + 2}: t = {time[k + 1]:.17g} s follows t = {time[k]:.17g} s",
                help="times ascend; two equal times are a jump, three are not",
            )

    @property
    def times(self) -> Vector:
        """The instants as an array."""
        return np.asarray(self.time)

    @property
    def values(self) -> Vector:
        """The values as an array."""
        return np.asarray(self.value)


def read_series(file: str | Path, column: str | None = None, interpolation: str = "linear") -> TimeSeries:
    """One column of a CSV file, or one signal of a result (`.mat`, `.npz`).

    The first row of a CSV file holds names, with a unit in brackets where values have one: `time [s], force [kN]`.
    The time is the column `time` or `t`. Separators are comma, semicolon and tab; with the latter two a comma may be
    the decimal sign. Lines that begin with # are left out.

    Parameters
    ----------
    column
        Name of the column, with or without its unit; not needed for a file with one column besides the time.

    Raises
    ------
    UsageError
        AC014 for a file that cannot be read, AC045 for one without such a column, or with a row that is no number.
    """
    path = Path(file)
    if path.suffix.lower() != ".csv":
        return _of_result(path, column, interpolation)
    header, rows = _rows(path)
    split = [_named(text) for text in header]
    names = [name for name, _ in split]
    clock = _clock(path, header, names)
    place = _place(path, header, names, clock, column)
    values = np.array(_numbers(path, rows, (clock, place), header), dtype=np.float64).reshape(-1, 2)
    time = _as_si(values[:, 0], split[clock][1] or "s")
    return TimeSeries(time, values[:, 1], interpolation, split[place][1], f"{path}, column {header[place]}")


def read_all(file: str | Path) -> dict[str, TimeSeries]:
    """Every column of a CSV file, as `read_series` reads one; empty cells are left out, each column has its own rows.

    Raises
    ------
    UsageError
        AC014 for a file that cannot be read, AC045 for a row that is no number, or a column with less than two.
    """
    path = Path(file)
    header, rows = _rows(path)
    split = [_named(text) for text in header]
    names = [name for name, _ in split]
    clock = _clock(path, header, names)
    found: dict[str, TimeSeries] = {}
    for k, (name, unit) in enumerate(split):
        if k == clock:
            continue
        if name in found:
            raise UsageError("AC045", f"{path} has two columns '{name}'", help="give each a name of its own")
        filled = [(line, row) for line, row in rows if len(row) > k and row[k]]
        if len(filled) < 2:
            raise UsageError("AC045", f"{path}: column {header[k]} has {len(filled)} numbers", help="leave it out")
        values = np.array(_numbers(path, filled, (clock, k), header), dtype=np.float64).reshape(-1, 2)
        time = _as_si(values[:, 0], split[clock][1] or "s")
        found[name] = TimeSeries(time, values[:, 1], "linear", unit, f"{path}, column {header[k]}")
    return found


def _clock(path: Path, header: Sequence[str], names: Sequence[str]) -> int:
    """Place of the column of times."""
    found = next((k for wanted in ("time", "t") for k, n in enumerate(names) if n.lower() == wanted), None)
    if found is None:
        raise UsageError(
            "AC045",
            f"{path} has no column of times",
            evidence=[f"its columns: {', '.join(header[:8])}"],
            help="name one `time` or `time [s]`, in the first row",
        )
    return found


def _as_si(values: Vector, unit: str) -> Vector:
    offset = in_si(0.0, unit)
    return np.asarray(values * (in_si(1.0, unit) - offset) + offset)


def _rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError("AC014", f"cannot read {path}: {reason}") from error
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if len(lines) < 3:
        raise UsageError("AC045", f"{path} has no two rows of numbers", help="a row of names, then one row per instant")
    sign = max(_DELIMITERS, key=lines[0][1].count)
    found = csv.reader((line for _, line in lines), delimiter=sign)
    table = [[cell.strip() for cell in row] for row in found]
    decimal = sign != "," and not any("." in cell for cell in table[1])
    rows = [[c.replace(",", ".") for c in row] for row in table[1:]] if decimal else table[1:]
    return table[0], list(zip((k for k, _ in lines[1:]), rows, strict=False))


def _named(text: str) -> tuple[str, str]:
    """Name and unit of a header `force [N]`; an index as in `x[0]` is part of the name."""
    name, bracket, rest = text.partition(" [")
    return (name.strip(), rest.rstrip("] ").strip()) if bracket and rest.rstrip().endswith("]") else (text.strip(), "")


def _place(path: Path, header: Sequence[str], names: Sequence[str], clock: int, column: str | None) -> int:
    others = [k for k in range(len(names)) if k != clock]
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
        help=f"{path}:{names[others[0]]}" if others else "a column of times alone is no signal",
    )


def _numbers(
    path: Path, rows: Sequence[tuple[int, list[str]]], places: Sequence[int], header: Sequence[str]
) -> list[float]:
    found = []
    for line, row in rows:
        for k in places:
            try:
                found.append(float(row[k]))
            except (ValueError, IndexError):
                what = repr(row[k]) if k < len(row) else "missing"
                raise UsageError(
                    "AC045",
                    f"{path}:{line}: {header[k]} is {what}, no number",
                    help="leave out rows without a value; units belong into the first row: force [N]",
                ) from None
    return found


def _of_result(path: Path, column: str | None, interpolation: str) -> TimeSeries:
    from acausal.files import read
    from acausal.result import Result

    result = Result(**vars(read(path)))
    if column is None:
        raise UsageError(
            "AC045", f"{path} holds {len(result.names)} signals", help=f"name one: {path}:{result.names[0]}"
        )
    return TimeSeries(result.time, result[column], interpolation, result.unit(column), f"{path}, signal {column}")
