"""Results as Parquet: one column per signal; units and descriptions are metadata of fields, and `attrs` for pandas."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from acausal.errors import UsageError
from acausal.result.csvfile import clock_among, named
from acausal.result.seconds import seconds
from acausal.result.signals import Array, Signal, Table, events_at_repeated_times

# Where pandas keeps `DataFrame.attrs`.
_ATTRS = b"PANDAS_ATTRS"


def write_parquet(table: Table, file: BinaryIO) -> None:
    """Write every signal as a column of doubles, compressed."""
    pyarrow, parquet = _pyarrow()
    n = len(table.time)
    units = {name: s.unit for name, s in table.signals.items()}
    fields = [pyarrow.field("time", pyarrow.float64(), metadata={"unit": "s", "doc": "Time"})]
    columns = [table.time]
    for s in table.signals.values():
        fields.append(pyarrow.field(s.name, pyarrow.float64(), metadata={"unit": s.unit, "doc": s.doc}))
        varies = s.column is not None
        columns.append(table.trajectories[:, s.column] * s.sign + 0.0 if varies else np.full(n, s.value))
    file_metadata = {"model": table.model, _ATTRS: json.dumps({"model": table.model, "units": units})}
    arrays = [pyarrow.array(c) for c in columns]
    arrow_table = pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields, metadata=file_metadata))
    parquet.write_table(arrow_table, file, write_page_checksum=True)


def read_parquet(path: Path) -> Table:
    """Read a table with a column `time` or `t`, from any program; units come from metadata or names `force [kN]`.

    Raises UsageError: AC015 without pyarrow.
    Raises ValueError for a table without times, or with empty cells.
    """
    _, parquet = _pyarrow()
    table = parquet.read_table(path, page_checksum_verification=True)
    file_metadata: Mapping[bytes, bytes] = table.schema.metadata or {}
    attrs = json.loads(file_metadata.get(_ATTRS, b"{}"))
    units = attrs.get("units", {}) if isinstance(attrs, dict) else {}
    headers = [named(name) for name in table.column_names]
    clock = clock_among([name for name, _ in headers])
    if clock is None:
        raise ValueError(f"no column of times among {', '.join(table.column_names[:8])}: name one `time` or `time [s]`")
    time = np.empty(0)
    signals: dict[str, Signal] = {}
    columns: list[Any] = []
    for k, (label, (name, unit_in_name)) in enumerate(zip(table.column_names, headers, strict=True)):
        column = table.column(k)
        if column.null_count:
            raise ValueError(f"column '{label}' has {column.null_count} empty cells: leave out rows without a value")
        metadata = table.schema.field(k).metadata or {}
        unit = unit_in_name or metadata.get(b"unit", b"").decode() or str(units.get(label, ""))
        if k == clock:
            time = _times(column, unit)
            continue
        values = np.asarray(column.to_numpy(), dtype=float)
        if name in signals:
            raise ValueError(f"two columns are named '{name}'")
        signals[name] = Signal(name, unit, metadata.get(b"doc", b"").decode(), len(columns))
        columns.append(values)
    model = file_metadata.get(b"model", path.stem.encode()).decode()
    matrix = np.column_stack(columns) if columns else np.empty((len(time), 0))
    return Table(model, time, matrix, signals, events_at_repeated_times(time))


def _times(column: Any, unit: str) -> Array:
    try:
        return seconds(column.to_numpy(), unit)
    except TypeError as error:
        raise ValueError(f"its times are invalid: {error}") from None


def _pyarrow() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise UsageError(
            "AC015", "a .parquet file needs the package pyarrow, which is not installed", help="pip install pyarrow"
        ) from error
