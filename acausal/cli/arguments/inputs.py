"""`--input` and `--start` by path: numbers with units, and signals in files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from acausal.cli.arguments.settings import number_in
from acausal.errors import UsageError, meant
from acausal.flatten.instances.instances import placed
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration

_FILE = re.compile(r"(?P<file>.+?\.(?:[A-Za-z]{3}|parquet))(?::(?P<column>.+))?")
_PLAIN = re.compile(r"[-+]?[\d.]+([eE][-+]?\d+)?")
_INDEX = re.compile(r"\[[\d, ]+\]$")


def inputs_of(model: Component, texts: Sequence[str] | None, interpolation: str) -> dict[str, Any]:
    """Constants and series by name, from texts NAME=VALUE and NAME=FILE:COLUMN.

    Raises UsageError: AC009 for other texts and repeated names, AC014 and AC045 for files, AC150 to AC152 for units.
    """
    # imported here, because both load numpy
    from acausal.result.files import WRITERS
    from acausal.result.series import INTERPOLATIONS, read_series

    if interpolation not in INTERPOLATIONS:
        raise UsageError(
            "AC009", f"--interpolation {interpolation}: no such interpolation", help=", ".join(INTERPOLATIONS)
        )
    declared = declarations(model) if texts else {}
    found: dict[str, Any] = {}
    for name, value in _assignments("--input", texts):
        file = _FILE.fullmatch(value)
        if file is not None and f".{file['file'].rpartition('.')[2].lower()}" in WRITERS:
            found[name] = read_series(file["file"], file["column"], interpolation)
        else:
            found[name] = _number("--input", name, value, declared)
    return found


def numbers_of(flag: str, model: Component, texts: Sequence[str] | None) -> dict[str, float]:
    """Numbers by path in SI, from texts PATH=VALUE of the option `flag`, with units or without."""
    declared = declarations(model) if texts else {}
    return {name: _number(flag, name, value, declared) for name, value in _assignments(flag, texts)}


def _number(flag: str, name: str, value: str, declared: Mapping[str, Declaration]) -> float:
    """A number, converted to the declared unit; a plain number for an unknown name is checked later."""
    declaration = declared.get(_INDEX.sub("", name))
    if declaration is None and not _PLAIN.fullmatch(value):
        raise UsageError(
            "AC010",
            f"{flag} {name}={value}: the model declares no '{name}'",
            evidence=meant(name, list(declared)),
        )
    return number_in(flag, f"{name}={value}", value, declaration)


def _assignments(flag: str, texts: Sequence[str] | None) -> list[tuple[str, str]]:
    found: dict[str, str] = {}
    for text in texts or ():
        name, sign, value = (part.strip() for part in text.partition("="))
        if not sign or not name or not value:
            raise UsageError("AC009", f"{flag} {text}: write NAME=VALUE")
        if name in found:
            raise UsageError("AC009", f"{flag} {name} is given twice: {found[name]} and {value}")
        found[name] = value
    return list(found.items())


def declarations(model: Component) -> Mapping[str, Declaration]:
    """Declarations by path."""
    return {i.prefix + name: d for i in placed(model)[0] for name, d in i.component._declarations.items()}


def declared_as(declarations: Mapping[str, Declaration], path: str) -> Declaration | None:
    """The declaration of a variable or parameter, or of the array that an element `w[1]` belongs to."""
    return declarations.get(_INDEX.sub("", path))
