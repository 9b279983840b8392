"""The numbers that laws of contact and friction are made of: their checks and their units."""

from __future__ import annotations

import math

from acausal import Expr, quantity
from acausal.errors import DeclarationError

Number = float | Expr
"""A number, or an expression of parameters, which is checked when the model runs."""


def check(law: object, *, positive: str = "", least: str = "", share: str = "") -> None:
    """Refuse numbers outside the range of a law (AC178); names are separated by blanks.

    `positive` ones are greater than 0, `least` ones at least 0, a `share` is greater than 0 and at most 1.
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
                help=f"give it another value: {type(law).__name__}({name}=...)",
            )


def with_units(law: object, **units: str) -> None:
    """Turn the numbers of a law into quantities, one unit for each name; expressions have theirs."""
    for name, unit in units.items():
        value = getattr(law, name)
        if not isinstance(value, Expr):
            object.__setattr__(law, name, quantity(value, unit))
