"""File format of a `CasadiModel`: functions and description, readable without the source of the model.

A zip archive of two members:

- `functions.casadi`: the functions serialised by CasADi's StringSerializer, in the order of their names in the
  description, including rootfinders with their derivatives. Only CasADi reads them, of the same or a newer version
  (docs/casadi.md).
- `metadata.json`: format and version numbers, name, start time, notes, names of the functions, and for each of x, z, u,
  p, y (and m, with events) the list of its entries with name, unit, doc, start, nominal, min, max; null stands for no
  limit (and for an unknown start); a checksum of all of this and of the functions.

CasADi's format can name shared libraries and compilers, which CasADi loads and runs while reading. Such files are
refused before CasADi reads them (`docs/security.md`).
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import struct
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from acausal.errors import ExportError, UsageError
from acausal.lower.casadi_model import EVENT_FUNCTIONS, FUNCTIONS, CasadiEvents, CasadiModel, Port, Ports
from acausal.result.files import atomic, check_suffix

FORMAT = "acausal casadi model"
VERSION = 4
SUFFIXES = (".casadi",)
_VECTORS = ("x", "z", "u", "p", "y")
# Every member of the archive has this date, so that equal models give equal files.
_DATE = (1980, 1, 1, 0, 0, 0)


def save_casadi(model: CasadiModel, path: str | Path) -> None:
    """Write a model to a file; if writing fails, no partial file remains.

    Raises
    ------
    UsageError
        AC012 when the file cannot be written, AC013 for another suffix than `.casadi`.
    """
    check_suffix(Path(path), SUFFIXES, "suffix of CasADi files")
    serializer = ca.StringSerializer()
    for function in model.functions.values():
        serializer.pack(function)
    functions, described = serializer.encode(), _described(model)
    described["checksum"] = _checksum(described, functions)
    members = {"metadata.json": json.dumps(described, indent=1), "functions.casadi": functions}
    with atomic(Path(path)) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), text, zipfile.ZIP_DEFLATED)


def load_casadi(path: str | Path) -> CasadiModel:
    """Read a model written by `CasadiModel.save`; the class of the model is not needed.

    Raises
    ------
    UsageError
        AC014 when the file cannot be opened.
    ExportError
        AC601 for a file of another kind or a damaged one, AC602 for another format version or a newer version of
        CasADi, AC609 for a file that would run foreign code.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            described = json.loads(archive.read("metadata.json"))
            functions = archive.read("functions.casadi").decode()
        if described.get("format") != FORMAT:
            raise ValueError(f"its format is {described.get('format')!r}")
    except OSError as error:
        raise UsageError("AC014", f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:
        # zipfile, zlib and json raise a dozen classes of errors for invalid data
        raise ExportError(
            "AC601",
            f"{path} is not a saved CasADi model",
            evidence=[str(error)],
            help="write one with compiled.casadi().save(path)",
        ) from error
    version, casadi = described.get("version"), str(described.get("casadi", "?"))
    if not isinstance(version, int) or version > VERSION:
        raise _too_new(path, f"format {version}", f"format {VERSION}")
    if version < VERSION:
        raise ExportError(
            "AC602",
            f"{path} was written with format {version}, which contains less than format {VERSION} of this installation",
            help="save it again from the model: compiled.casadi().save(path)",
        )
    if _numbers(casadi) > _numbers(ca.CasadiMeta.version()):
        raise _too_new(path, f"CasADi {casadi}", f"CasADi {ca.CasadiMeta.version()}")
    if described.get("checksum") != _checksum(described, functions):
        raise ExportError("AC601", f"{path} is damaged", evidence=["its checksum does not match its contents"])
    try:
        foreign = _foreign_code(functions)
    except ValueError as error:
        raise ExportError("AC601", f"{path} is damaged", evidence=[str(error)]) from error
    if foreign:
        raise ExportError(
            "AC609",
            f"{path} would run code from outside the file",
            evidence=[f"it names {', '.join(foreign)}"],
            help="save it again without external functions and without jit",
        )
    return _restored(path, described, functions)


def _checksum(described: dict[str, Any], functions: str) -> str:
    rest = {k: v for k, v in described.items() if k != "checksum"}
    return hashlib.sha256(f"{json.dumps(rest, sort_keys=True)}\0{functions}".encode()).hexdigest()


# Classes of CasADi that load libraries or start compilers, and the options that name these.
_FOREIGN = (
    *("External", "GenericExternal", "DllLibrary", "ImporterInternal", "Importer", "ShellCompiler", "ClangCompiler"),
    *(
        "dll",
        "clang",
        "compiler",
        "compiler_setup",
        "compiler_flags",
        "linker",
        "linker_setup",
        "linker_flags",
        "flags",
    ),
)


def _foreign_code(text: str) -> list[str]:
    """The strings in a serialised CasADi stream that name code outside of it.

    The stream stores each string after its length. A string with a path separator counts as well, because CasADi looks
    up plugins as libraries by name, and a path would lead to an arbitrary one.
    """
    # two letters encode a byte, the low half first
    halves = np.frombuffer(text.encode("ascii"), dtype=np.uint8) - np.uint8(ord("a"))
    if len(halves) % 2 or (halves > 15).any():
        raise ValueError("not CasADi's encoding")
    stream = (halves[::2] | (halves[1::2] << 4)).tobytes()
    found = [word for word in _FOREIGN if struct.pack("<i", len(word)) + word.encode() in stream]
    for start in re.finditer(rb"(?=(.)(.)\x00\x00[ -~]{3})", stream, re.DOTALL):
        length = start[1][0] + 256 * start[2][0]
        word = stream[start.start() + 4 : start.start() + 4 + length]
        if (
            3 < length == len(word)
            and word.isascii()
            and word.decode().isprintable()
            and (b"/" in word or b"\\" in word)
        ):
            found.append(repr(word.decode()))
    return found


def _described(model: CasadiModel) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "casadi": ca.CasadiMeta.version(),
        "name": model.name,
        "start_time": model.start_time,
        "notes": list(model.notes),
        "functions": list(model.functions),
        **({"m": [_to_json(port) for port in model.events.m]} if model.events else {}),
        **{v: [_to_json(port) for port in getattr(model, v)] for v in _VECTORS},
    }


def _to_json(port: Port) -> dict[str, Any]:
    # JSON has neither infinity nor nan
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(port).items()}


def _from_json(record: dict[str, Any]) -> Port:
    absent = {"start": math.nan, "min": -math.inf, "max": math.inf}
    complete: dict[str, Any] = {k: absent[k] if v is None else v for k, v in record.items()}
    return Port(**complete)


def _restored(path: Path, described: dict[str, Any], text: str) -> CasadiModel:
    try:
        deserializer = ca.StringDeserializer(text)
        functions = {name: deserializer.unpack() for name in described["functions"]}
        vectors = {v: Ports(map(_from_json, described[v])) for v in _VECTORS}
        events = None
        if "m" in described:
            reacting = {name: functions[f"events.{name}"] for name in EVENT_FUNCTIONS}
            events = CasadiEvents(**reacting, m=Ports(map(_from_json, described["m"])))
        return CasadiModel(
            name=described["name"],
            **{name: functions[name] for name in FUNCTIONS},
            **vectors,
            events=events,
            start_time=described["start_time"],
            notes=tuple(described["notes"]),
        )
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ExportError(
            "AC601", f"{path} is damaged", evidence=[str(error).strip().splitlines()[-1] if str(error) else ""]
        ) from error


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("+")[0].split(".") if part.isdigit())


def _too_new(path: Path, written: str, here: str) -> ExportError:
    return ExportError(
        "AC602",
        f"{path} was written with {written}, which this installation ({here}) cannot read",
        help="upgrade here, or save it again there with an older version",
    )
