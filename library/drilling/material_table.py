"""Work materials from a user's own table."""

from __future__ import annotations

import os
import re
from pathlib import Path

from acausal.errors import AcausalError, UnitError, UsageError, nearest
from acausal.library.drilling.materials import Material
from acausal.library.drilling.table_cells import Cell, Row, read_rows
from acausal.units import convert

_NAMES = {
    "name": ("name", "material"),
    "k_c11": ("k_c11", "k_c1.1", "kc11", "kc1.1"),
    "z": ("z", "m_c", "mc"),
    "source": ("source", "reference"),
}
_LEAST, _MOST = 1e6, 1e11
"""Plausible range of specific cutting forces [Pa]; metals have 350 to 6000 N/mm2."""

_EXAMPLE = "name, k_c11 [N/mm2], z, source"


def load_materials(path: str | os.PathLike[str]) -> dict[str, Material]:
    """Read the materials of a `.csv` or `.toml` file, by name.

    The columns of a CSV file are `name`, `k_c11`, `z` and `source`, in any order; the unit of k_c11 is given in the
    first line, `k_c11 [N/mm2]`, or in each cell, `2240 N/mm2`. With `;` between the cells, numbers may have decimal
    commas. A TOML file has one table per material with the same keys, and k_c11 is a string with its unit:

        [34CrMo4]
        k_c11 = "2240 N/mm2"
        z = 0.21
        source = "..."

    A specific cutting force of unknown origin is worthless, so every material needs a source; units are never guessed.

    Raises
    ------
    UsageError
        AC070 the file cannot be read; AC071 a column is missing or unknown; AC072 a value cannot be read, has the wrong
        dimension or is out of range; AC073 no source; AC074 no unit; AC075 duplicate name. All but AC070 state file,
        line and column.
    """
    file = Path(path)
    rows = read_rows(file)
    if not rows:
        raise UsageError("AC070", f"{file} has no materials", help=f"columns: {_EXAMPLE}")
    found: dict[str, Material] = {}
    first: dict[str, Cell] = {}
    for row in rows:
        material, cell = _material(row)
        if material.name in found:
            raise _error(
                "AC075",
                cell,
                f"'{material.name}' occurs twice",
                evidence=f"first at {first[material.name].place}",
                help="give the two materials different names, for example with their heat treatment",
            )
        found[material.name], first[material.name] = material, cell
    return found


def _material(row: Row) -> tuple[Material, Cell]:
    cells: dict[str, tuple[Cell, str]] = {}
    for column, cell in row.items():
        if not column:
            continue
        title, unit = _title(column)
        known = next((key for key, names in _NAMES.items() if title in names), None)
        if known is None:
            close = nearest(title, [name for names in _NAMES.values() for name in names], 1)
            guess = f"; did you mean '{close[0]}'?" if close else ""
            raise _error("AC071", cell, f"'{title}' is not a column of a table of materials{guess}", help=_EXAMPLE)
        cells[known] = (cell, unit)
    for key in _NAMES:
        if key not in cells and key != "source":
            raise _error("AC071", row[""], f"'{key}' is missing", help=f"columns: {_EXAMPLE}")
    name = cells["name"][0]
    if not name.text:
        raise _error("AC072", name, "the name is empty")
    k_c11 = _number(*cells["k_c11"], "Pa")
    z = _number(*cells["z"], "1")
    if not _LEAST <= k_c11 <= _MOST:
        raise _error(
            "AC072",
            cells["k_c11"][0],
            f"k_c11 of '{name.text}' is {k_c11:g} Pa",
            help="1 to 100 000 N/mm2, from foams to the hardest alloys: is the unit right?",
        )
    if not 0.0 <= z < 1.0:
        raise _error("AC072", cells["z"][0], f"z of '{name.text}' is {z:g}", help="from 0 to less than 1")
    source = cells.get("source")
    if source is None or not source[0].text.strip():
        raise _error(
            "AC073",
            source[0] if source else row[""],
            f"'{name.text}' has no source",
            cause="a specific cutting force of unknown origin cannot be judged",
            help='name the publication or the measurement: source = "own measurement, 2026-03-01"',
        )
    return Material(name=name.text, k_c11=k_c11, z=z, source=source[0].text), name


def _title(column: str) -> tuple[str, str]:
    """Name and unit of a column: `k_c11 [N/mm2]`."""
    title, _, rest = column.partition("[" if column.endswith("]") else "(" if column.endswith(")") else "\0")
    return title.strip(), rest[:-1].strip()


def _number(cell: Cell, unit: str, target: str) -> float:
    text = cell.text
    if re.fullmatch(r"[+-]?\d+,\d+.*", text):
        text = text.replace(",", ".", 1)
    bare = re.fullmatch(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", text) is not None
    if bare and not unit and target != "1":
        raise _error(
            "AC074",
            cell,
            f"{text} has no unit",
            help=f'write "{text} N/mm2", or the unit of the whole column in the first line: k_c11 [N/mm2]',
        )
    try:
        return convert(f"{text} {unit}" if bare else text, target)
    except UnitError as error:
        raise _error(
            "AC072", cell, error.fact, evidence="; ".join(error.evidence) or None, help=error.help or None
        ) from error


def _error(
    code: str, cell: Cell, fact: str, *, evidence: str | None = None, cause: str | None = None, help: str | None = None
) -> AcausalError:
    shown = (evidence,) if evidence else ()
    return UsageError(code, f"{cell.place}: {fact}", where=(cell.span,), evidence=shown, cause=cause, help=help)
