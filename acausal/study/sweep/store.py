"""The members of a sweep that are done, in an SQLite file (or in memory): what was counted as done survives a kill.

Each chunk is one transaction. Numbers are little-endian doubles, the definition is JSON: nothing in the file is code.
"""

from __future__ import annotations

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

_FORMAT = "acausal sweep 1"
_TABLES = """
CREATE TABLE definition (format TEXT, content TEXT, member_values BLOB, grid BLOB);
CREATE TABLE members (
  member INTEGER PRIMARY KEY, code TEXT, message TEXT, notes TEXT, stop REAL, seconds REAL, events INTEGER,
  final BLOB, grid_rows BLOB
);
"""


@dataclass(frozen=True, eq=False)
class Definition:
    """What a sweep is: two sweeps with the same definition have the same members."""

    model: str
    # `parameters`, `values`: the k parameters that are varied, and their values, shape (n, k), in SI.
    parameters: tuple[Signal, ...]
    values: Vector
    # `signals`, `grid`: the s signals that are kept, and the times of their rows, shape (r,). [s]
    signals: tuple[Signal, ...]
    grid: Vector
    setting: dict[str, str]  # options of the runs, and what the model is, as text

    @property
    def content(self) -> dict[str, Any]:
        """All but the arrays, for JSON."""
        described = ("name", "unit", "doc")
        return {
            "model": self.model,
            "parameters": [{k: asdict(s)[k] for k in described} for s in self.parameters],
            "signals": [{k: asdict(s)[k] for k in described} for s in self.signals],
            "setting": self.setting,
        }

    def difference(self, other: Definition) -> list[str]:
        """What another sweep has otherwise, in words."""
        found = []
        if [s.name for s in self.parameters] != [s.name for s in other.parameters]:
            found.append("parameters that are varied")
        elif not np.array_equal(self.values, other.values):
            found.append("values of the members")
        if [s.name for s in self.signals] != [s.name for s in other.signals]:
            found.append("signals that are kept")
        if not np.array_equal(self.grid, other.grid):
            found.append("times of the rows")
        names = {**self.setting, **other.setting}
        return found + [name for name in names if self.setting.get(name) != other.setting.get(name)]


class Store:
    """Outcomes by member; `file` None keeps them in memory.

    Raises
    ------
    UsageError
        AC012 when the file cannot be written, AC062 when it is no sweep.
    """

    def __init__(self, file: Path | None) -> None:
        self.file = file
        with _explained(file):
            self._base = sqlite3.connect(":memory:" if file is None else file, check_same_thread=False)

    def close(self) -> None:
        """Release the file."""
        self._base.close()

    def begin(self, definition: Definition) -> None:
        """Make the tables of a new sweep."""
        with _explained(self.file), self._base:
            self._base.executescript(_TABLES)
            row = _FORMAT, json.dumps(definition.content), _bytes(definition.values), _bytes(definition.grid)
            self._base.execute("INSERT INTO definition VALUES (?, ?, ?, ?)", row)

    def definition(self) -> Definition:
        """What the sweep in the file is."""
        with _explained(self.file):
            form, content, values, grid = self._base.execute("SELECT * FROM definition").fetchone()
            if form != _FORMAT:
                raise sqlite3.DatabaseError(f"its format is '{form}'")
            known = json.loads(content)
        parameters, signals = (tuple(Signal(**s) for s in known[k]) for k in ("parameters", "signals"))
        table = _numbers(values).reshape(-1, len(parameters))
        return Definition(known["model"], parameters, table, signals, _numbers(grid), known["setting"])

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Keep outcomes: they are on disk when this returns."""
        rows = [
            (
                o.member,
                o.code,
                o.message,
                json.dumps(o.notes),
                o.stop,
                o.seconds,
                o.events,
                _bytes(o.final),
                _bytes(o.rows),
            )
            for o in outcomes
        ]
        with _explained(self.file), self._base:
            self._base.executemany("INSERT OR REPLACE INTO members VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)

    def done(self) -> set[int]:
        """Members that are there."""
        with _explained(self.file):
            return {row[0] for row in self._base.execute("SELECT member FROM members")}

    def outcomes(self, definition: Definition) -> Iterator[Outcome]:
        """All that are there, in order."""
        columns = len(definition.signals)
        with _explained(self.file), closing(self._base.execute("SELECT * FROM members ORDER BY member")) as found:
            for member, code, message, notes, stop, seconds, events, final, rows in found:
                table = _numbers(rows).reshape(-1, columns)
                yield Outcome(
                    member,
                    code,
                    message,
                    tuple(json.loads(notes)),
                    np.nan if stop is None else stop,  # SQLite has no nan
                    np.nan if seconds is None else seconds,
                    events,
                    _numbers(final),
                    table,
                )


def _bytes(values: Vector) -> bytes:
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _numbers(data: bytes) -> Vector:
    return np.frombuffer(data, dtype="<f8").astype(float)


@contextmanager
def _explained(file: Path | None) -> Iterator[None]:
    """Errors of SQLite as messages."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise UsageError("AC012", f"cannot read or write {file}: {error}") from error
    except (sqlite3.DatabaseError, TypeError, ValueError, KeyError) as error:
        raise UsageError("AC062", f"{file} holds no sweep", evidence=[str(error)]) from error
