"""Result files: `.mat` (Dymola, OpenModelica), `.csv`, `.npz`, `.parquet`, chosen by suffix.

| file | names | values | units, docs | events | stats |
|---|---|---|---|---|---|
| .mat | yes | exact, aliases share columns | yes | times only | no |
| .csv | yes | exact, every signal a column | units, if wanted | times only | no |
| .npz | yes | exact | yes | yes | yes |
| .parquet | yes | exact, every signal a column | yes | times only | no |
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from acausal.errors import Span, UsageError
from acausal.result.csvfile import read_csv, write_csv
from acausal.result.matfile import read_mat, write_mat
from acausal.result.parquetfile import read_parquet, write_parquet
from acausal.result.signals import Array, Event, Signal, Table


def write(table: Table, path: Path, units: bool = False) -> None:
    """Write a table in the format of the suffix, completely or not at all; `units` adds a row of units to a `.csv`.

    Raises UsageError: AC012 when the file cannot be written, AC013 for an unknown suffix.
    """
    writer = WRITERS[check_suffix(path, WRITERS, "result format")]
    with atomic(path) as file:
        if units and writer is write_csv:
            write_csv(table, file, units=True)
        else:
            writer(table, file)


def read(path: Path) -> Table:
    """Read a table in the format of the suffix.

    Raises
    ------
    UsageError
        AC013 for an unknown suffix, AC014 when the file is missing or is not a result, AC015 for a missing package.
    """
    reader = READERS[check_suffix(path, READERS, "result format")]
    try:
        table = reader(path)
        _check_times(table.time)
        return table
    except OSError as error:
        raise UsageError("AC014", f"cannot read {path}: {error.strerror or error}") from error
    except UsageError as error:
        if error.code != "AC045":
            raise
        evidence = [error.fact, *error.evidence]
        raise UsageError("AC014", f"cannot read {path} as a result", evidence=evidence, help=error.help) from error
    except Exception as error:
        # scipy, numpy and zipfile raise a dozen unrelated classes of errors for invalid data
        raise UsageError("AC014", f"cannot read {path} as a result", evidence=[str(error) or "empty file"]) from error


def _check_times(time: Array) -> None:
    """Raise ValueError for times that decrease or are not finite."""
    broken = np.flatnonzero(~np.isfinite(time))
    if broken.size:
        raise ValueError(f"the time of row {broken[0] + 1} is {time[broken[0]]:g}")
    back = np.flatnonzero(np.diff(time) < 0.0)
    if back.size:
        k = int(back[0])
        raise ValueError(
            f"row {k + 2} goes back in time, from {time[k]:g} s to {time[k + 1]:g} s: sort the rows by time"
        )


def check_suffix(path: Path, accepted: Collection[str], what: str) -> str:
    """The suffix of a path in lower case; UsageError AC013 when it is not among the `accepted` ones for `what`."""
    suffix = path.suffix.lower()
    if suffix not in accepted:
        raise UsageError(
            "AC013", f"the suffix '{path.suffix}' of {path} is no {what}", help=f"accepted are {', '.join(accepted)}"
        )
    return suffix


class atomic:
    """A binary file that appears under its name when the `with` block ends well, and not at all otherwise.

    Raises
    ------
    UsageError
        AC012, with the path and the system's reason, also for an error of the system inside the block.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # Replace the target of a symbolic link, not the link.
        self._target = Path(os.path.realpath(path))
        self._part = self._target.with_name(f".{self._target.name}.{os.getpid()}.part")

    def __enter__(self) -> BinaryIO:
        try:
            if self._target.is_dir():
                raise IsADirectoryError(0, "it is a directory")
            # os.replace needs only a writable folder; respect the protection of the file itself, too
            if self._target.exists() and not os.access(self._target, os.W_OK):
                raise PermissionError(0, "the file is write-protected")
            self._file = self._part.open("xb")
        except OSError as error:
            raise self._unwritable(error) from error
        return self._file

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        try:
            self._file.close()
            if kind is None:
                os.replace(self._part, self._target)
        except OSError as late:
            kind, error = OSError, late
        if kind is not None:
            self._part.unlink(missing_ok=True)
            if isinstance(error, OSError):
                raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> UsageError:
        return UsageError("AC012", f"cannot write {self.path}: {error.strerror or error}")


def write_npz(table: Table, file: BinaryIO) -> None:
    """numpy arrays `time`, `trajectories`, `names`, `units`, `docs` and a JSON text `rest`."""
    signals = list(table.signals.values())
    rest = {
        "model": table.model,
        "signals": [[s.column, s.sign, s.value, s.parameter] for s in signals],
        "events": [asdict(event) for event in table.events],
        "stats": dict(table.stats),
    }
    np.savez(
        file,
        time=table.time,
        trajectories=table.trajectories,
        names=np.array([s.name for s in signals], dtype=str),
        units=np.array([s.unit for s in signals], dtype=str),
        docs=np.array([s.doc for s in signals], dtype=str),
        rest=np.array(json.dumps(rest, default=_plain)),
    )


def read_npz(path: Path) -> Table:
    """Read what `write_npz` wrote."""
    # open the file here: if numpy opens a broken archive itself, it leaves it open
    with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
        rest = json.loads(str(content["rest"]))
        texts = zip(content["names"].tolist(), content["units"].tolist(), content["docs"].tolist(), strict=True)
        signals = {text[0]: Signal(*text, *data) for text, data in zip(texts, rest["signals"], strict=True)}
        return Table(
            rest["model"],
            content["time"],
            content["trajectories"],
            signals,
            tuple(_event(event) for event in rest["events"]),
            rest["stats"],
        )


def _event(record: Mapping[str, Any]) -> Event:
    where = Span(**record["where"]) if record["where"] else None
    return Event(record["time"], record["condition"], where, record["component"], tuple(record["changed"]))


def _plain(value: object) -> object:
    """Values of stats that JSON cannot encode: numpy's as lists and numbers, mappings, anything else as text."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return dict(value) if isinstance(value, Mapping) else str(value)


WRITERS: dict[str, Callable[[Table, BinaryIO], None]] = {
    ".mat": write_mat,
    ".csv": write_csv,
    ".npz": write_npz,
    ".parquet": write_parquet,
}
READERS: dict[str, Callable[[Path], Table]] = {
    ".mat": read_mat,
    ".csv": read_csv,
    ".npz": read_npz,
    ".parquet": read_parquet,
}
