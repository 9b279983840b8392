"""Outcomes of a sweep in an SQLite file or in memory; outcomes of finished chunks survive a kill of the process.

Each chunk is one transaction. Numbers are little-endian doubles and the definition is JSON, so that reading a file
never executes code. Each row ends with a digest of its other columns, because SQLite does not notice damaged values.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import UsageError
from acausal.result.signals import Signal
from acausal.study.sweep.member import Outcome

_FORMAT = "acausal sweep 2"
# Without BEGIN each table would be a transaction, and a kill between them would leave a file that is no sweep.
_TABLES = """
BEGIN;
CREATE TABLE definition (format TEXT, content TEXT, member_values BLOB, grid BLOB, digest BLOB);
CREATE TABLE members (
  member INTEGER PRIMARY KEY, code TEXT, message TEXT, notes TEXT, stop REAL, seconds REAL, events INTEGER,
  final BLOB, grid_rows BLOB, digest BLOB
);
"""


@dataclass(frozen=True, eq=False)
class Definition:
    """Definition of a sweep: sweeps with equal definitions have equal members."""

    model: str
    # The k varied parameters, and their values in SI units, shape (n, k).
    parameters: tuple[Signal, ...]
    values: Vector
    # The s stored signals, and the times of their rows, shape (r,) [s].
    signals: tuple[Signal, ...]
    grid: Vector
    setting: dict[str, str]  # options of the runs and fingerprint of the model, as text

    @property
    def content(self) -> dict[str, Any]:
        """The definition without its arrays, for JSON."""
        described = ("name", "unit", "doc")
        return {
            "model": self.model,
            "parameters": [{k: asdict(s)[k] for k in described} for s in self.parameters],
            "signals": [{k: asdict(s)[k] for k in described} for s in self.signals],
            "setting": self.setting,
        }

    def difference(self, other: Definition) -> list[str]:
        """Texts of the differences from another definition."""
        found = []
        if [s.name for s in self.parameters] != [s.name for s in other.parameters]:
            found.append("varied parameters")
        elif not np.array_equal(self.values, other.values):
            found.append("values of the members")
        if [s.name for s in self.signals] != [s.name for s in other.signals]:
            found.append("stored signals")
        if not np.array_equal(self.grid, other.grid):
            found.append("times of the rows")
        names = {**self.setting, **other.setting}
        return found + [name for name in names if self.setting.get(name) != other.setting.get(name)]


class Store:
    """Outcomes by member; with `file` None they are stored in memory.

    Raises
    ------
    UsageError
        AC012 if the file cannot be written, AC062 if it is not a sweep.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file
        with _sqlite_errors(file):
            self._database = sqlite3.connect(":memory:" if file is None else file, check_same_thread=False)

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def begin(self, definition: Definition) -> None:
        """Create the tables of a new sweep."""
        with _sqlite_errors(self.file), self._database:
            self._database.executescript(_TABLES)
            row = _FORMAT, json.dumps(definition.content), _bytes(definition.values), _bytes(definition.grid)
            self._database.execute("INSERT INTO definition VALUES (?, ?, ?, ?, ?)", (*row, _digest(row)))

    def definition(self) -> Definition:
        """The definition of the sweep in the file."""
        with _sqlite_errors(self.file):
            form, *_ = row = self._database.execute("SELECT * FROM definition").fetchone()
            if form != _FORMAT:
                raise sqlite3.DatabaseError(f"its format is '{form}'")
            _, content, values, grid = self._intact(row, "its definition")
            known = json.loads(content)
        parameters, signals = (tuple(Signal(**s) for s in known[k]) for k in ("parameters", "signals"))
        table = _numbers(values).reshape(-1, len(parameters))
        return Definition(known["model"], parameters, table, signals, _numbers(grid), known["setting"])

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Store outcomes; they are on disk when this returns."""
        rows = [
            (
                o.member,
                o.code,
                o.message,
                json.dumps(o.notes),
                _without_nan(o.stop),
                _without_nan(o.seconds),
                o.events,
                _bytes(o.final),
                _bytes(o.rows),
            )
            for o in outcomes
        ]
        with _sqlite_errors(self.file), self._database:
            statement = "INSERT OR REPLACE INTO members VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
            self._database.executemany(statement, [(*row, _digest(row)) for row in rows])

    def done(self) -> set[int]:
        """Numbers of the stored members whose values are intact."""
        with _sqlite_errors(self.file):
            return {row[0] for row in self._database.execute("SELECT * FROM members") if row[-1] == _digest(row[:-1])}

    def _intact(self, row: Sequence[Any], what: str) -> Sequence[Any]:
        """The columns of a row before its digest; AC062 if they are not those that were written."""
        if row[-1] != _digest(row[:-1]):
            raise UsageError(
                "AC062",
                f"{self.file} is damaged: {what} differs from what was written",
                help="resume=True runs damaged members again; otherwise give another file",
            )
        return row[:-1]

    def outcomes(self, definition: Definition) -> Iterator[Outcome]:
        """All stored outcomes, by member."""
        columns = len(definition.signals)
        with (
            _sqlite_errors(self.file),
            closing(self._database.execute("SELECT * FROM members ORDER BY member")) as found,
        ):
            for row in found:
                member, code, message, notes, stop, seconds, events, final, rows = self._intact(row, f"member {row[0]}")
                table = _numbers(rows).reshape(-1, columns)
                yield Outcome(
                    member,
                    code,
                    message,
                    tuple(json.loads(notes)),
                    np.nan if stop is None else stop,
                    np.nan if seconds is None else seconds,
                    events,
                    _numbers(final),
                    table,
                )


def _digest(row: Sequence[Any]) -> bytes:
    """Digest of the columns of a row: numbers, texts and bytes."""
    parts = [value if isinstance(value, bytes) else repr(value).encode() for value in row]
    return hashlib.sha256(b"".join(len(part).to_bytes(8, "little") + part for part in parts)).digest()


def _without_nan(value: float) -> float | None:
    """The value, or None for nan, which SQLite does not have."""
    return None if np.isnan(value) else float(value)


def _bytes(values: Vector) -> bytes:
    """Values of any shape as little-endian doubles."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _numbers(data: bytes) -> Vector:
    """Little-endian doubles as a vector, shape (n,)."""
    return np.frombuffer(data, dtype="<f8").astype(float)


@contextmanager
def _sqlite_errors(file: Path | None) -> Iterator[None]:
    """Convert errors of SQLite to UsageError: AC012 or AC062."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise UsageError("AC012", f"cannot read or write {file}: {error}") from error
    except (sqlite3.DatabaseError, TypeError, ValueError, KeyError) as error:
        raise UsageError("AC062", f"{file} contains no sweep", evidence=[str(error)]) from error
