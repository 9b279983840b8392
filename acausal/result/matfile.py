"""Result files of Dymola and OpenModelica: MATLAB level 4, `Atrajectory` version 1.1.

Six matrices in this order: `Aclass`, `name`, `description`, `dataInfo`, `data_1` (constants, at the first and the
last time), `data_2` (trajectories). In the layout `binTrans`, written here, they are transposed, so that `data_2`
grows by one record per time. Column i of `dataInfo` belongs to name i:

1. the block, 1 or 2; 0 for time, which is the first row of every block;
2. the row in the block from 1, negative for a negated alias;
3. 0: linear interpolation;
4. -1: not defined outside the run.

The description of time ends in a checksum of the file, so that damage is detected; files of other programs have none.

Sources: Dymola User Manual 2, section "Data in trajectory files"; `simulation_result_mat.cpp` of OpenModelica.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from acausal.result.signals import Signal, Table, events_at_repeated_times

_UNIT = re.compile(r"(?P<doc>.*?) ?\[(?P<unit>[^][|]*)(?:\|[^][]*)?\]", re.DOTALL)

_DIGITS = 16
_CHECKSUM = re.compile(rb"(Time, checksum )([0-9a-f]{16})")
# Fragments of a damaged checksum; other programs write "Time in [s]" or "Simulation time" here.
_DAMAGED_CHECKSUM = re.compile(r"Time, ch|ecksum|sum [0-9a-f]{4}|[0-9a-f]{8} \[s\]")

# Type codes of level 4, little-endian: 1000 * order + 10 * precision + kind (0 numbers, 1 text).
_DOUBLE, _INT32, _TEXT = 0, 20, 51


def write_mat(table: Table, file: BinaryIO) -> None:
    """Write a table in the layout `binTrans`, numbers in double precision."""
    # scipy.io.savemat(format="4") encodes text as ASCII and would refuse a degree sign in a description.
    names, descriptions = ["time"], [f"Time, checksum {'0' * _DIGITS} [s]"]
    info, constants = [(0, 1, 0, -1)], [table.time[[0, -1]]]
    for name, signal in table.signals.items():
        names.append(name)
        # a description that ends with a bracket needs a unit after it, because its end would be read as a unit
        unit = signal.unit or ("1" if signal.doc.endswith("]") else "")
        descriptions.append(f"{signal.doc} [{unit}]".lstrip() if unit else signal.doc)
        if signal.column is None:
            constants.append(np.full(2, signal.value))
            info.append((1, len(constants), 0, -1))
        else:
            # Row 1 is time.
            info.append((2, signal.sign * (signal.column + 2), 0, -1))
    digest = hashlib.sha256()

    def add(name: str, code: int, transposed: NDArray[Any]) -> None:
        for part in _matrix(name, code, transposed):
            digest.update(part)
            file.write(part)

    # OpenModelica's reader requires 4 x 11 characters here, so the third line cannot hold the model's name.
    add("Aclass", _TEXT, _characters(["Atrajectory", "1.1", "", "binTrans"]).T)
    add("name", _TEXT, _characters(names))
    # position of the checksum: after the matrix header of 20 bytes, its zero-terminated name, and the preceding text
    position = file.tell() + 20 + len("description") + 1 + len("Time, checksum ")
    add("description", _TEXT, _characters(descriptions))
    add("dataInfo", _INT32, np.array(info, dtype="<i4"))
    add("data_1", _DOUBLE, np.array(constants, dtype="<f8").T)
    add("data_2", _DOUBLE, np.column_stack([table.time, table.trajectories]).astype("<f8"))
    file.seek(position)
    file.write(digest.hexdigest()[:_DIGITS].encode())
    file.seek(0, os.SEEK_END)


def _matrix(name: str, code: int, transposed: NDArray[Any]) -> tuple[bytes, bytes]:
    """Header and data of one matrix, given transposed, because the format is column-major and numpy row-major."""
    columns, rows = transposed.shape
    label = name.encode("ascii") + b"\0"
    head = np.array([code, rows, columns, 0, len(label)], dtype="<i4").tobytes() + label
    return head, np.ascontiguousarray(transposed).tobytes()


def _characters(texts: Sequence[str]) -> NDArray[np.uint8]:
    """Texts as UTF-8 bytes padded with zeros, shape (len(texts), width)."""
    encoded = [text.encode() for text in texts]
    width = max(1, *map(len, encoded))
    return np.frombuffer(b"".join(text.ljust(width, b"\0") for text in encoded), dtype=np.uint8).reshape(-1, width)


def read_mat(path: Path) -> Table:
    """Read a result of acausal, Dymola or OpenModelica, in either layout of version 1.1.

    Raises ValueError when the file is no such result.
    """
    from scipy.io import loadmat

    raw = path.read_bytes()
    signed = _CHECKSUM.search(raw)
    if (
        signed
        and hashlib.sha256(_CHECKSUM.sub(rb"\g<1>" + b"0" * _DIGITS, raw, count=1)).hexdigest()[:_DIGITS].encode()
        != signed[2]
    ):
        raise ValueError("its checksum does not match its contents: the file is damaged")
    content = loadmat(io.BytesIO(raw), chars_as_strings=False)
    if "Aclass" not in content:
        raise ValueError("no matrix Aclass: this is not a result of Dymola, OpenModelica or acausal")
    head = _texts(content["Aclass"])
    if len(head) < 4 or head[1] != "1.1" or head[3] not in ("binTrans", "binNormal"):
        raise ValueError(f"trajectory format {' '.join(head[1:])}; version 1.1 binTrans or binNormal is read")
    if head[3] == "binTrans":
        content = {k: v.T for k, v in content.items() if isinstance(v, np.ndarray)} | {"Aclass": content["Aclass"]}
    names, descriptions = _texts(content["name"]), _texts(content["description"])
    if not signed and _DAMAGED_CHECKSUM.search(descriptions[0] if descriptions else ""):
        raise ValueError("its checksum cannot be read: the file is damaged")
    data = np.asarray(content["data_2"], dtype=float)
    constants = np.asarray(content["data_1"], dtype=float)[0]
    places = np.asarray(content["dataInfo"])[:, :2]
    _check_places(places, len(constants), data.shape[1])
    signals: dict[str, Signal] = {}
    for name, description, (block, place) in zip(names, descriptions, places.tolist(), strict=True):
        row, sign = abs(place) - 1, 1 if place > 0 else -1
        # Row 0 of any block is the abscissa, called time or Time.
        if row == 0:
            continue
        match = _UNIT.fullmatch(description)
        doc, unit = (match["doc"], match["unit"]) if match else (description, "")
        if block == 1:
            signals[name] = Signal(name, unit, doc, None, 1, sign * float(constants[row]), parameter=True)
        else:
            signals[name] = Signal(name, unit, doc, row - 1, sign)
    return Table(path.stem, data[:, 0], data[:, 1:], signals, events_at_repeated_times(data[:, 0]))


def _check_places(places: NDArray[Any], constants: int, columns: int) -> None:
    """Raise ValueError for a signal outside its block: numpy would silently use a negative index from the end."""
    blocks, rows = places[:, 0], np.abs(places[:, 1])
    if not (np.isin(blocks, (0, 1, 2)) & (places == np.floor(places)).all(axis=1)).all():
        raise ValueError("dataInfo names a block that does not exist")
    wrong = (rows < 1) | (rows > np.where(blocks == 1, constants, columns))
    if wrong.any():
        raise ValueError(f"dataInfo names row {int(rows[wrong][0])} of a block that ends before it")


def _texts(characters: NDArray[np.str_]) -> list[str]:
    """Texts from rows of characters; scipy returns each byte as one Latin-1 character."""
    rows = ("".join(row) for row in characters.tolist())
    return [row.encode("latin-1", "replace").decode("utf-8", "replace").rstrip("\0 ") for row in rows]
