"""Tables of numbers as text: results written by acausal, and measurements of other programs.

The first row holds names, with a unit in brackets where values have one: `time [ms], force [kN]`; or a second row
holds the units. The time is the column `time` or `t`. Separators are comma, semicolon and tab; with the latter two a
comma may be the decimal sign. Lines that begin with # are skipped.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from acausal.errors import AcausalError, UnitError, UsageError
from acausal.result.seconds import seconds
from acausal.result.signals import Array, Signal, Table, events_at_repeated_times
from acausal.units import parse

_DELIMITERS = ",;\t"


@dataclass(frozen=True)
class Sheet:
    """The text of a file, split into header and rows."""

    path: Path
    header: tuple[str, ...]  # the cells of the first row, unchanged
    # `names`, `units`: of every column; "" for a column without a unit.
    names: tuple[str, ...]
    units: tuple[str, ...]
    clock: int  # index of the column of times
    lines: tuple[tuple[int, str], ...]  # (line number, text) of every row of numbers
    # `delimiter`, `decimal`: the character between cells, and the decimal sign.
    delimiter: str
    decimal: str

    def rows(self) -> list[tuple[int, list[str]]]:
        """(Line number, cells) of every row, with a point as decimal sign.

        Raises UsageError: AC045 for a row with more values than there are names. They are not left out, because a
        decimal comma makes two values of one.
        """
        table = csv.reader((line for _, line in self.lines), delimiter=self.delimiter)
        cells = [[cell.strip().replace(self.decimal, ".") for cell in row] for row in table]
        rows = list(zip((k for k, _ in self.lines), cells, strict=False))
        for line, row in rows:
            if any(row[len(self.names) :]):
                raise UsageError(
                    "AC045",
                    f"{self.path}:{line}: {len(self.names)} names and {len(row)} columns",
                    help="where numbers have decimal commas, separate them by semicolons or tabs",
                )
        return rows

    def numbers(self, rows: Sequence[tuple[int, list[str]]], columns: Sequence[int]) -> Array:
        """Columns of these rows as numbers, without conversion of units; shape (len(rows), len(columns)).

        Raises UsageError: AC045, with the line, for a cell that is not a number.
        """
        values = np.empty((len(rows), len(columns)))
        for i, (line, row) in enumerate(rows):
            for j, k in enumerate(columns):
                try:
                    values[i, j] = float(row[k])
                except (ValueError, IndexError):
                    what = repr(row[k]) if k < len(row) else "missing"
                    raise UsageError(
                        "AC045",
                        f"{self.path}:{line}: {self.header[k]} is {what}, not a number",
                        help="leave out rows without a value; units belong in the first row: force [N]",
                    ) from None
        return values

    def seconds(self, times: Array) -> Array:
        """Values of the column of times, shape (n,), converted to seconds."""
        try:
            return seconds(times, self.units[self.clock])
        except UnitError as error:
            raise UsageError(error.code, f"{self.path}: {error.fact}", help=error.help) from None


def read_sheet(path: Path) -> Sheet:
    """Read a file, and split its header.

    Raises UsageError: AC014 for a file that cannot be read, AC045 for one without two rows, or without a column of
    times.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        help_ = "save the file as UTF-8" if isinstance(error, UnicodeDecodeError) else None
        raise UsageError("AC014", f"cannot read {path}: {reason}", help=help_) from error
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    if len(lines) < 2:
        raise UsageError("AC045", f"{path} has no row of numbers", help="a row of names, then one row per instant")
    sign = max(_DELIMITERS, key=lines[0][1].count)
    header, second = ([c.strip() for c in row] for row in csv.reader((line for _, line in lines[:2]), delimiter=sign))
    names, units = zip(*map(named, header), strict=True)
    clock = clock_among(names)
    if clock is None:
        raise UsageError(
            "AC045",
            f"{path} has no column of times",
            evidence=[f"its columns: {', '.join(header[:8])}"],
            help="name one `time` or `time [s]`, in the first row",
        )
    header_rows = 1
    if _are_units(second, len(header), clock):
        units, header_rows = tuple(below or beside for below, beside in zip(second, units, strict=True)), 2
    if len(lines) <= header_rows:
        raise UsageError("AC045", f"{path} has no row of numbers", help="a row of names, then one row per instant")
    decimal = _decimal_sign(path, sign, lines[header_rows:])
    return Sheet(path, tuple(header), names, units, clock, tuple(lines[header_rows:]), sign, decimal)


def _decimal_sign(path: Path, delimiter: str, lines: Sequence[tuple[int, str]]) -> str:
    """The decimal sign of the cells; UsageError AC045 if they have both, one of which might separate thousands."""
    if delimiter == ",":
        return "."
    first = {sign: next((k for k, line in lines if sign in line), None) for sign in ".,"}
    if None not in first.values():
        raise UsageError(
            "AC045",
            f"{path} has decimal points, as in line {first['.']}, and commas, as in line {first[',']}",
            help="write numbers without separators of thousands, and with one decimal sign",
        )
    return "," if first["."] is None else "."


def named(text: str) -> tuple[str, str]:
    """Name and unit of a header `force [N]`; "" without a unit. An index as in `x[0]` is part of the name."""
    name, bracket, rest = text.partition(" [")
    return (name.strip(), rest.rstrip("] ").strip()) if bracket and rest.rstrip().endswith("]") else (text.strip(), "")


def clock_among(names: Sequence[str]) -> int | None:
    """Index of the column of times: `time` in any case, else `t`. A column `T` is a temperature."""
    lower = [name.lower() for name in names]
    return lower.index("time") if "time" in lower else names.index("t") if "t" in names else None


def _are_units(cells: Sequence[str], count: int, clock: int) -> bool:
    """Whether a row consists of units: no cell is a number except the unit 1, and that of times is a unit of time."""
    if len(cells) != count or any(_is_number(cell) for cell in cells if cell != "1"):
        return False
    try:
        return parse(cells[clock].strip("[]")).dimension == parse("s").dimension
    except AcausalError:
        return False


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def read_csv(path: Path) -> Table:
    """Read a table of numbers over time, written by acausal or by another program.

    Raises UsageError: AC014 and AC045, as `read_sheet` and `Sheet.numbers`.
    """
    sheet = read_sheet(path)
    if len(set(sheet.names)) < len(sheet.names):
        twice = next(n for n in sheet.names if sheet.names.count(n) > 1)
        raise UsageError("AC045", f"{path} has two columns '{twice}'", help="give each its own name")
    texts = (line.replace(sheet.decimal, ".") for _, line in sheet.lines)
    data: Array | None = None
    with suppress(ValueError):
        data = np.loadtxt(texts, delimiter=sheet.delimiter, ndmin=2)
    if data is None or data.shape[1] != len(sheet.names):
        # numpy does not report the line of a bad cell: read again cell by cell for an error with the line
        data = sheet.numbers(sheet.rows(), range(len(sheet.names)))
    time = sheet.seconds(data[:, sheet.clock])
    others = [k for k in range(len(sheet.names)) if k != sheet.clock]
    signals = {sheet.names[k]: Signal(sheet.names[k], sheet.units[k], column=i) for i, k in enumerate(others)}
    return Table(path.stem, time, data[:, others], signals, events_at_repeated_times(time))


def write_csv(table: Table, file: BinaryIO, units: bool = False) -> None:
    """Write a row of names, a row of units on request, then one row per time.

    Numbers have the shortest form that reads back as the same double.
    """
    header = io.StringIO()
    writer = csv.writer(header, lineterminator="\n")
    writer.writerow(["time", *table.signals])
    if units:
        writer.writerow(["s", *(s.unit for s in table.signals.values())])
    file.write(header.getvalue().encode())
    n = len(table.time)
    # formatting dominates the cost: format a column once for all its aliases
    formatted: dict[tuple[int, int], list[str]] = {}
    columns = [[repr(t) for t in table.time.tolist()]]
    for signal in table.signals.values():
        if signal.column is None:
            columns.append([repr(float(signal.value))] * n)
            continue
        key = signal.column, signal.sign
        if key not in formatted:
            values = table.trajectories[:, signal.column] * signal.sign + 0.0
            formatted[key] = list(map(repr, values.tolist()))
        columns.append(formatted[key])
    file.writelines((",".join(row) + "\n").encode() for row in zip(*columns, strict=True))
