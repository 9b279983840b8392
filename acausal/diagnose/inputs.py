"""Inputs that nothing drives."""

from __future__ import annotations

from acausal.diagnose.words import component_of, listed, made_at, short, stated_at
from acausal.errors import StructureError
from acausal.flatten.flat import FlatSystem, FlatVariable
from acausal.language.declarations.declaration import Kind


def open_inputs(flat: FlatSystem) -> StructureError | None:
    """AC209 when an input of a component has neither connection nor binding, nor an equation of the owner."""
    inputs = [v for v in flat.variables if v.declaration.kind is Kind.INPUT and "." in v.path]
    if not inputs:
        return None
    driven = {v.first for v in flat.variables if v.declaration.kind is Kind.OUTPUT} | set(flat.inputs)
    readers: dict[int, set[str]] = {}
    for v in inputs:
        readers.setdefault(v.first, set()).add(component_of(flat, v.path))
    candidates = [v for v in inputs if v.first not in driven and not _bound_above(flat, v)]
    if candidates:
        wanted = {v.first for v in candidates}
        for e in flat.equations:
            for scalar in wanted & flat.pool.variables_in(e.left, e.right):
                if isinstance(e.source, str) or e.component not in readers[scalar]:
                    driven.add(scalar)
    found = [v for v in candidates if v.first not in driven]
    return _open(flat, found) if found else None


def _bound_above(flat: FlatSystem, variable: FlatVariable) -> bool:
    """True when the input is handed down from an input of the model itself."""
    return any(
        v.first == variable.first and v.declaration.kind is Kind.INPUT and "." not in v.path for v in flat.variables
    )


def _open(flat: FlatSystem, found: list[FlatVariable]) -> StructureError:
    first = found[0]
    path = component_of(flat, first.path)
    cls = flat.components[path].cls
    name = first.path.rpartition(".")[2]
    unit = f" [{first.declaration.unit}]" if first.declaration.unit else ""
    declared = ", ".join(short(s) for s in stated_at(cls))
    evidence = [f"{first.path}{unit}   {first.declaration.doc}   ({cls.__name__}, {declared})"]
    if len(found) > 1:
        evidence.append(f"not connected either: {listed(v.path for v in found[1:])}")
    cause, advice = first.declaration.hint or None, None
    return StructureError(
        "AC209",
        f"{flat.name}: input {first.path} is not connected",
        where=made_at(flat, path),
        evidence=evidence,
        cause=cause or "an input gets its value from outside the component; nothing gives it one",
        help=advice or f"connect it to an output, or bind it where it is made: {cls.__name__}({name}=...)",
    )
