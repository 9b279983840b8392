"""Symbols of components, and positions of their connectors.

`symbols.json` contains SVG in a field of 60 x 40, with connectors at the middle of its sides. Keys are `family.Class`,
or `Class` for all families of the library; a subclass without a symbol has that of its base. Lines have the colour of
the domain (`currentColor`). Classes of the style sheet in `diagram.js`: f filled, b body in the colour of the paper, w
thick line, a thin axes, d dashed, t text.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files

from acausal.language.component import Component

# Sides (W, E, N, S) of connectors that differ from those of their names; keys as above.
SIDES: dict[str, dict[str, str]] = {
    # a source drives the circuit to its right: the current leaves at p and returns at n
    "PartialVoltageSource": {"p": "E", "n": "W"},
    "PartialCurrentSource": {"p": "W", "n": "E"},
    "electrical.Ground": {"p": "N"},
    "HeatCapacitor": {"port": "W"},
    "Feedback": {"u1": "W", "u2": "S"},
    "Clutch": {"f_normalized": "N"},
    "Brake": {"f_normalized": "N"},
    "drilling.PartialDrillingForce": {"frame_a": "W", "frame_w": "E"},
}


def family_of(cls: type) -> str:
    """Library of a class: electrical, ...; "" for a class outside the library."""
    module = cls.__module__
    return module.split(".")[2] if module.startswith("acausal.library.") else ""


@cache
def _symbols() -> dict[str, str]:
    found: dict[str, str] = json.loads(files("acausal.diagram").joinpath("symbols.json").read_text(encoding="utf-8"))
    return found


def symbol_of(component: type[Component]) -> str | None:
    """The symbol of a class, or of its nearest base that has one."""
    for cls in component.__mro__:
        family = family_of(cls)
        found = _symbols().get(f"{family}.{cls.__name__}") or (_symbols().get(cls.__name__) if family else None)
        if found:
            return found
    return None


def sides_of(component: Component) -> dict[str, str]:
    """Sides of connectors by name, as far as `SIDES` has the class."""
    for cls in type(component).__mro__:
        found = SIDES.get(f"{family_of(cls)}.{cls.__name__}") or SIDES.get(cls.__name__)
        if found:
            return found
    return {}
