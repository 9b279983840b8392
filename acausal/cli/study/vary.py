"""`--vary PATH=VALUES`: ranges, lists and distributions, with units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from acausal.cli.arguments.inputs import declarations
from acausal.cli.arguments.settings import number_in
from acausal.errors import UsageError
from acausal.language.component import Component
from acausal.language.declarations.declaration import Declaration

_FORMS = "PATH=LOW:HIGH:COUNT, PATH=log:LOW:HIGH:COUNT, PATH=A,B,C or PATH=normal:MEAN:DEVIATION"
_INDEX = re.compile(r"\[[\d, ]+\]$")
_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def variations_of(model: Component, texts: Sequence[str] | None) -> dict[str, Any]:
    """What to vary by path in SI, as `acausal.sweep` takes it.

    Raises
    ------
    UsageError
        AC009 for texts that are none of these, AC060 for ranges that make no sense, AC150 to AC152 for units.
    """
    declared = declarations(model)
    found: dict[str, Any] = {}
    for text in texts or ():
        name, sign, values = (part.strip() for part in text.partition("="))
        if not sign or not name or not values:
            raise _unreadable(text)
        if name in found:
            raise UsageError("AC009", f"--vary {name} is given twice")
        found[name] = _variation(text, values, declared.get(_INDEX.sub("", name)))
    if not found:
        raise UsageError("AC060", "nothing is varied", help=f"--vary {_FORMS}")
    return found


def _variation(text: str, values: str, declared: Declaration | None) -> Any:
    from acausal.study.sweep.vary import Range  # loads NumPy

    def number(part: str) -> float:
        return number_in("--vary", text, part.strip(), declared)

    kind, _, rest = values.partition(":")
    if kind == "normal":
        from scipy.stats import norm

        parts = rest.split(":")
        if len(parts) != 2:
            raise _unreadable(text)
        return norm(number(parts[0]), _difference(number, parts[1]))
    is_log = kind == "log"
    parts = (rest if is_log else values).split(":")
    if len(parts) in (2, 3):
        if len(parts) == 3 and not parts[2].strip().isdecimal():
            raise _unreadable(text)
        return Range(number(parts[0]), number(parts[1]), int(parts[2]) if len(parts) == 3 else None, is_log)
    if len(parts) > 3 or is_log:
        raise _unreadable(text)
    return [number(part) for part in values.split(",")]


def _difference(number: Any, text: str) -> float:
    """A difference in SI: of degrees Celsius it is not the temperature."""
    match = _NUMBER.match(text)
    return float(number(text) - number("0" + text[match.end() :])) if match else float(number(text))


def _unreadable(text: str) -> UsageError:
    return UsageError("AC009", f"--vary {text}: no variation", help=f"write {_FORMS}")
