"""Checks and units of the numbers in laws of contact and friction."""

from __future__ import annotations

import math

from acausal import Expr, quantity
from acausal.errors import DeclarationError

Number = float | Expr
"""A number, or an expression of parameters, which can only be checked when the model runs."""


def check(law: object, *, positive: str = "", least: str = "", share: str = "") -> None:
    """Raise AC178 for numbers outside the range of a law; each argument lists names separated by blanks.

    Those in `positive` must be greater than 0, in `least` at least 0, in `share` greater than 0 and at most 1.
    """
    wanted = [(n, "greater than 0") for n in positive.split()]
    wanted += [(n, "at least 0") for n in least.split()]
    wanted += [(n, "greater than 0 and at most 1") for n in share.split()]
    for name, words in wanted:
        value = getattr(law, name)
        if isinstance(value, Expr):
            continue
        is_low = value < 0.0 or (value == 0.0 and words != "at least 0")
        if is_low or not math.isfinite(value) or (value > 1.0 and words.endswith("most 1")):
            raise DeclarationError(
                "AC178",
                f"{type(law).__name__}: {name} = {value:g} is not {words}",
                help=f"change it: {type(law).__name__}({name}=...)",
            )


def with_units(law: object, **units: str) -> None:
    """Turn the numbers of a law into quantities, with a unit for each name; expressions already have units."""
    for name, unit in units.items():
        value = getattr(law, name)
        if not isinstance(value, Expr):
            object.__setattr__(law, name, quantity(value, unit))
