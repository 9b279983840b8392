"""The probable cause of a singular model: finders in the order in which causes explain each other."""

from __future__ import annotations

from acausal.diagnose.components import unbalanced_component
from acausal.diagnose.cut_forces import constrained_loop
from acausal.diagnose.null_space.combinations import (
    dependent_equations,
    empty_equation,
    open_motion,
    special_defaults,
    special_values,
)
from acausal.diagnose.null_space.pencil import pencil
from acausal.diagnose.null_space.references import flow_twice, potential_twice, without_reference
from acausal.diagnose.words import component_of, label, line, listed, made_at, short, stated_at
from acausal.errors import StructureError
from acausal.flatten.flat import FlatEquation, FlatSystem, FlatVariable, span_of
from acausal.language.declarations.declaration import Kind


def probable(flat: FlatSystem, *, by_structure: bool = False) -> StructureError | None:
    """The error that names the cause, or None if none of the known causes applies.

    It is called only for models that are known to be singular, so that regular models pay nothing.

    `by_structure` means that the structure alone proves that the model is singular. The smallest set of equations that
    proves it then says more than null vectors do, except for a single equation without unknowns.
    """
    error = open_inputs(flat)
    if error is None and (by_structure or len(flat.equations) != flat.n_scalars - len(flat.inputs)):
        error = unbalanced_component(flat)
    if error is not None:
        return error
    numbers = pencil(flat)
    last = empty_equation if by_structure else dependent_equations
    for finder in (
        constrained_loop,
        potential_twice,
        special_values,
        without_reference,
        flow_twice,
        special_defaults,
        open_motion,
        last,
    ):
        error = finder(numbers)
        if error is not None:
            return error
    return None


def contradiction(flat: FlatSystem, equation: FlatEquation, value: float) -> StructureError:
    """The error for an equation that reads `value == 0` after all known values are inserted: the cause, or AC205."""
    error = probable(flat)
    if error is not None:
        return error
    return StructureError(
        "AC205",
        f"{flat.name}: an equation of {label(flat, equation.component)} contradicts the others",
        where=span_of(equation) or made_at(flat, equation.component),
        evidence=[line(flat, equation), f"with all known values inserted, it reads 0 == {-value:g}"],
        cause="two components prescribe the same quantity with different values",
        help="remove one of the prescriptions, or put something compliant between them",
    )


def open_inputs(flat: FlatSystem) -> StructureError | None:
    """AC209 if an input of a component has neither a connection, nor a binding, nor an equation of the owner."""
    inputs = [v for v in flat.variables if v.declaration.kind is Kind.INPUT and "." in v.path]
    if not inputs:
        return None
    driven = {v.first for v in flat.variables if v.declaration.kind is Kind.OUTPUT} | set(flat.inputs)
    readers: dict[int, set[str]] = {}
    for v in inputs:
        readers.setdefault(v.first, set()).add(component_of(flat, v.path))
    candidates = [v for v in inputs if v.first not in driven and not _bound_above(flat, v)]
    if candidates:
        open_scalars = {v.first for v in candidates}
        for e in flat.equations:
            for scalar in open_scalars & flat.pool.variables_in(e.left, e.right):
                if isinstance(e.source, str) or e.component not in readers[scalar]:
                    driven.add(scalar)
    unconnected = [v for v in candidates if v.first not in driven]
    return _open(flat, unconnected) if unconnected else None


def _bound_above(flat: FlatSystem, variable: FlatVariable) -> bool:
    """True if the input is connected to an input of the model itself."""
    return any(
        v.first == variable.first and v.declaration.kind is Kind.INPUT and "." not in v.path for v in flat.variables
    )


def _open(flat: FlatSystem, unconnected: list[FlatVariable]) -> StructureError:
    first = unconnected[0]
    path = component_of(flat, first.path)
    cls = flat.components[path].cls
    name = first.path.rpartition(".")[2]
    unit = f" [{first.declaration.unit}]" if first.declaration.unit else ""
    declared = ", ".join(short(s) for s in stated_at(cls))
    evidence = [f"{first.path}{unit}   {first.declaration.doc}   ({cls.__name__}, {declared})"]
    if len(unconnected) > 1:
        evidence.append(f"not connected either: {listed(v.path for v in unconnected[1:])}")
    cause, advice = first.declaration.hint or None, None
    return StructureError(
        "AC209",
        f"{flat.name}: input {first.path} is not connected",
        where=made_at(flat, path),
        evidence=evidence,
        cause=cause or "an input gets its value from outside of its component, and nothing provides one",
        help=advice or f"connect it to an output, or bind it where it is made: {cls.__name__}({name}=...)",
    )
