"""Names of the leaves of pool expressions, as in the source of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acausal.units import divide, format_dimension, parse

if TYPE_CHECKING:
    from acausal.flatten.flat import FlatSystem
    from acausal.flatten.reduced import ReducedSystem
    from acausal.flatten.text import NameOf


def flat_names(flat: FlatSystem) -> NameOf:
    """Names in the flat system's pool."""
    return lambda op, k: flat.parameter_names[k] if op == "par" else flat.scalar_name(k)


def unit_of(reduced: ReducedSystem, variable: int) -> str:
    """Declared unit of a reduced variable, or the derived one of a derivative that the compiler has introduced."""
    if variable < len(reduced.scalar) and reduced.scalar[variable] not in reduced.flat.pool.integral_of:
        return reduced.flat.declaration(reduced.scalar[variable]).unit
    below = unit_of(reduced, reduced.pool.integral_of[variable])
    return format_dimension(divide(parse(below).dimension, parse("s").dimension)) if below else ""
