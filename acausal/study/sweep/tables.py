"""A sweep as one table: Parquet and CSV with a row for each member, NetCDF (xarray) over members and time."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from acausal.errors import UsageError
from acausal.result.files import atomic, check_suffix
from acausal.study.sweep.family import Sweep


def package(name: str) -> Any:
    """A package of the extra `sweep`; UsageError AC015 if it is not installed."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise UsageError(
            "AC015",
            f"this needs the package {name}, which is not installed",
            help=f"pip install {name}; the extra acausal[sweep] has all packages that sweeps can use",
        ) from error


_OUTCOME = ("member", "status", "code", "message", "notes", "stop_time", "events", "seconds")
"""Columns for the outcome of each member, beside those of the model."""


def outcome_names(sweep: Sweep) -> dict[str, str]:
    """Names of the columns of the outcome, such as `events`, or `run.events` if the sweep has a signal of that name."""
    return {name: f"run.{name}" if name in sweep else name for name in _OUTCOME}


def columns(sweep: Sweep) -> dict[str, Any]:
    """Columns of the table without rows over time, each with one entry per member."""
    outcome = {
        "member": np.arange(len(sweep)),
        "status": list(sweep.status),
        "code": list(sweep.codes),
        "message": list(sweep.messages),
        "notes": ["; ".join(notes) for notes in sweep.notes],
        "stop_time": sweep.stop_times,
        "events": sweep.events,
        "seconds": sweep.seconds,
    }
    names = outcome_names(sweep)
    return {
        names["member"]: outcome.pop("member"),
        **{s.name: sweep.values[:, k] for k, s in enumerate(sweep.parameters)},
        **{names[name]: column for name, column in outcome.items()},
        **{s.name: sweep.finals[:, k] for k, s in enumerate(sweep.signals)},
    }


def sweep_frame(sweep: Sweep) -> Any:
    """The table as a `pandas.DataFrame`, by member."""
    return package("pandas").DataFrame(columns(sweep)).set_index(outcome_names(sweep)["member"])


def sweep_dataset(sweep: Sweep) -> Any:
    """The sweep as an `xarray.Dataset`; `NAME.final` are the values at the end of each run, over `member`."""
    xarray = package("xarray")
    about = {s.name: {"units": s.unit, "long_name": s.doc} for s in (*sweep.parameters, *sweep.signals)}
    table, names = columns(sweep), outcome_names(sweep)
    member = names["member"]
    varied = {s.name: (member, table[s.name], about[s.name]) for s in sweep.parameters}
    data: dict[str, Any] = {}
    for k, s in enumerate(sweep.signals):
        if s.name not in varied:
            data[s.name] = ((member, "time"), sweep.rows[:, :, k], about[s.name])
            data[f"{s.name}.final"] = (member, sweep.finals[:, k], about[s.name])
    others = {names[name]: (member, np.asarray(table[names[name]])) for name in _OUTCOME if name != "member"}
    time = ("time", sweep.time, {"units": "s", "long_name": "Time"})
    coordinates = {member: table[member], "time": time, **varied, **others}
    return xarray.Dataset(data, coords=coordinates, attrs={"model": sweep.model})


def write_sweep(sweep: Sweep, path: Path) -> None:
    """Write the table in the format of the suffix, completely or not at all."""
    writer = WRITERS[check_table(path)]
    with atomic(path) as file:
        writer(sweep, file)


def check_table(path: Path) -> str:
    """The suffix of a table file; UsageError AC013 for an unknown one, AC015 for a missing package."""
    suffix = check_suffix(path, WRITERS, "format of a sweep")
    if suffix in _PACKAGES:
        package(_PACKAGES[suffix])
    return suffix


def _csv(sweep: Sweep, file: BinaryIO) -> None:
    table = columns(sweep)
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(table)
    writer.writerows(zip(*(c.tolist() if isinstance(c, np.ndarray) else c for c in table.values()), strict=True))
    file.write(text.getvalue().encode())


def _parquet(sweep: Sweep, file: BinaryIO) -> None:
    """Rows over time are list columns `time` and `NAME(time)`; units and descriptions are metadata."""
    package("pyarrow")
    import pyarrow
    from pyarrow import parquet

    about = {s.name: s for s in (*sweep.parameters, *sweep.signals)}
    fields, arrays = [], []

    def add(name: str, array: Any, meaning: str) -> None:
        signal = about.get(meaning)
        metadata = None if signal is None else {"unit": signal.unit, "doc": signal.doc}
        fields.append(pyarrow.field(name, array.type, metadata=metadata))
        arrays.append(array)

    for name, values in columns(sweep).items():
        add(name, pyarrow.array(values), name)
    n, r = len(sweep), len(sweep.time)
    offsets = pyarrow.array(np.arange(n + 1) * r, type=pyarrow.int64())

    def lists(values: Any) -> Any:
        return pyarrow.LargeListArray.from_arrays(offsets, pyarrow.array(values.ravel()))

    add("time", lists(np.tile(sweep.time, n)), "time")
    for k, s in enumerate(sweep.signals):
        add(f"{s.name}(time)", lists(sweep.rows[:, :, k]), s.name)
    units = {name: s.unit for name, s in about.items()}
    schema = pyarrow.schema(fields, metadata={"model": sweep.model, "units": json.dumps(units)})
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=schema), file, compression="zstd")


def _netcdf(sweep: Sweep, file: BinaryIO) -> None:
    # NetCDF 3, the format of SciPy, has no 64-bit integers
    whole = sweep_dataset(sweep)
    names = outcome_names(sweep)
    for name in (names["member"], names["events"]):
        whole[name] = whole[name].astype(np.int32)
    file.write(bytes(whole.to_netcdf(engine="scipy")))


WRITERS: dict[str, Callable[[Sweep, BinaryIO], None]] = {".parquet": _parquet, ".nc": _netcdf, ".csv": _csv}
_PACKAGES = {".parquet": "pyarrow", ".nc": "xarray"}
