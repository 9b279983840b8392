"""Reader for CSV and TOML tables that keeps the position of each cell for error messages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acausal.errors import Span, UsageError


@dataclass(frozen=True)
class Cell:
    """Text of a value and its position: `line` counts from 1, `column` from 0."""

    text: str
    file: str
    line: int
    column: int

    @property
    def place(self) -> str:
        """File, line and column, both counted from 1."""
        return f"{self.file}, line {self.line}, column {self.column + 1}"

    @property
    def span(self) -> Span:
        """The position as a span, which messages print with the line of the file."""
        return Span(self.file, self.line, self.column, self.column + len(self.text.encode()))


Row = dict[str, Cell]
"""Cells by the name of their column or key; the empty name holds the start of the row."""


def read_rows(path: Path) -> list[Row]:
    """The rows of a table in a `.csv` or `.toml` file.

    Raises
    ------
    UsageError
        AC070 if the file cannot be read or is not a table.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UsageError("AC070", f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise UsageError(
            "AC070",
            f"cannot read {path} as text",
            evidence=[f"byte {error.start} is not UTF-8"],
            help="save it as UTF-8",
        ) from error
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return list(_csv(text, str(path)))
    if suffix == ".toml":
        return list(_toml(text, str(path)))
    raise UsageError("AC070", f"a table cannot be read from {path}", help="use a file with the suffix .csv or .toml")


def _csv(text: str, file: str) -> Iterator[Row]:
    """Rows below the header line; `#` begins a comment, and `;` is the separator if the header contains it."""
    header: list[Cell] = []
    separator = ","
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if not header:
            separator = ";" if ";" in line else ","
            header = _split(line, separator, file, number)
            continue
        cells = _split(line, separator, file, number)
        if len(cells) != len(header):
            raise UsageError(
                "AC070",
                f"{cells[-1].place}: the row has {len(cells)} cells, but the first line names {len(header)} columns",
                where=(cells[-1].span,),
                evidence=[f"columns: {', '.join(c.text for c in header)}"],
                help=f'put a cell that contains "{separator}" in quotation marks',
            )
        row = {name.text: cell for name, cell in zip(header, cells, strict=True)}
        row[""] = Cell(line.strip(), file, number, 0)
        yield row
    if not header:
        raise UsageError("AC070", f"{file} is empty", help="name the columns in the first line")


def _split(line: str, separator: str, file: str, number: int) -> list[Cell]:
    """Cells of one line, quoted or not, without surrounding blanks."""
    cells = []
    at = 0
    while True:
        quoted = re.compile(r'\s*"((?:[^"]|"")*)"\s*').match(line, at)
        if quoted and quoted.end() in (len(line), line.find(separator, quoted.end())):
            cells.append(Cell(quoted[1].replace('""', '"'), file, number, quoted.start(1)))
            end = quoted.end()
        else:
            end = line.find(separator, at)
            end = len(line) if end < 0 else end
            raw = line[at:end]
            cells.append(Cell(raw.strip(), file, number, at + len(raw) - len(raw.lstrip())))
        if end >= len(line):
            return cells
        at = end + 1


def _toml(text: str, file: str) -> Iterator[Row]:
    """All tables of the file that hold values: `[[material]]` with a `name`, or one table per name, `[C45]`."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        where = (Span(file, int(found[1]), int(found[2]) - 1),) if found else ()
        place = f"{file}, line {found[1]}, column {found[2]}" if found else file
        raise UsageError("AC070", f"{place}: {str(error).split(' (at')[0]}", where=where) from error
    places = list(_places(text))
    for header, values in _tables(content, ()):
        # An inline table has no header of its own; its position is then the file.
        k = next((k for k, place in enumerate(places) if place[0] == header), None)
        line, keys = (1, dict[str, tuple[int, int]]()) if k is None else places.pop(k)[1:]
        row = {
            key: Cell(value if isinstance(value, str) else str(value), file, *keys.get(key, (line, 0)))
            for key, value in values.items()
        }
        row[""] = Cell(header, file, line, 0)
        row.setdefault("name", Cell(header.rsplit(".", 1)[-1], file, line, 0))
        yield row


def _tables(content: dict[str, Any], path: tuple[str, ...]) -> Iterator[tuple[str, dict[str, Any]]]:
    for key, value in content.items():
        here = (*path, key)
        if isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            yield from ((".".join(here), v) for v in value)
        elif isinstance(value, dict):
            if any(not isinstance(v, dict) for v in value.values()):
                yield ".".join(here), value
            else:
                yield from _tables(value, here)


def _places(text: str) -> Iterator[tuple[str, int, dict[str, tuple[int, int]]]]:
    """Header, line of the header, and line and column of the value of each key, in the order of the file."""
    name, line, keys = "", 1, dict[str, tuple[int, int]]()
    for number, content in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]\]?", content):
            yield name, line, keys
            name, line, keys = header[1].replace('"', ""), number, {}
        elif entry := re.match(r'\s*"?([\w.]+?)"?\s*=\s*"?', content):
            keys[entry[1]] = (number, entry.end())
    yield name, line, keys
