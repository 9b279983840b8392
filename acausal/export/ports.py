"""Ports: descriptions of states, algebraic variables, inputs, parameters and outputs, from their declarations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from acausal.errors import UsageError, listed_names, meant
from acausal.flatten.flat import FlatVariable, suffixes
from acausal.language.declarations.declaration import Declaration, Kind
from acausal.lower.casadi_model import Port, Ports
from acausal.lower.compiled import CompiledModel
from acausal.units import divide, format_dimension, parse


class Output(NamedTuple):
    """A requested scalar variable, under the name by which it was requested (it may have aliases)."""

    name: str
    declaration: Declaration
    scalar: int


def named_outputs(compiled: CompiledModel, names: Sequence[str] | None) -> tuple[Output, ...]:
    """The outputs with these names, arrays entry by entry; None means all variables declared in the model's class.

    Raises UsageError: AC010 for a name that is no variable of the model, AC028 if `compiled` is not a compiled model.
    """
    if not isinstance(compiled, CompiledModel):
        shown = f"the class {compiled.__name__}" if isinstance(compiled, type) else type(compiled).__name__
        raise UsageError("AC028", f"{shown} is no compiled model", help="compile it first: acausal.compile(model)")
    variables = {v.path: v for v in compiled.flat.variables}
    if names is None:
        names = [p for p, v in variables.items() if "." not in p and v.declaration.kind is not Kind.INPUT]
    return tuple(output for name in listed_names("outputs", names) for output in _entries(compiled, variables, name))


def _entries(compiled: CompiledModel, variables: Mapping[str, FlatVariable], name: str) -> list[Output]:
    """The scalars of a variable, or of one of its entries."""
    path = name.rpartition("[")[0]
    v = variables.get(name) or variables.get(path)
    if v is None:
        known = [v.path + s for v in variables.values() for s in ("", *suffixes(v.declaration.shape))]
        raise _unknown(compiled, name, list(dict.fromkeys(known)))
    d = v.declaration
    scalars = [Output(v.path + s, d, v.first + k) for k, s in enumerate(suffixes(d.shape))]
    if v.path == name:
        return scalars
    entry = [output for output in scalars if output.name == name]
    if not entry:
        raise _unknown(compiled, name, [output.name for output in scalars])
    return entry


def _unknown(compiled: CompiledModel, name: str, known: list[str]) -> UsageError:
    parameters = {*compiled.parameters, *(p.path for p in compiled.flat.parameters)}
    return UsageError(
        "AC010",
        f"{compiled.name} has no variable '{name}'",
        evidence=meant(name, known),
        help="it is a parameter: read it from p" if name in parameters else None,
    )


def output_ports(outputs: Sequence[Output], start: Iterable[float]) -> Ports:
    """Ports of outputs, whose values at the start are `start`."""
    return Ports(
        Port(name, d.unit, d.doc, float(value), d.nominal, d.min, d.max)
        for (name, d, _), value in zip(outputs, start, strict=True)
    )


def variable_ports(compiled: CompiledModel, variables: Sequence[int], start: Iterable[float]) -> Ports:
    """Ports of reduced variables, with the intersection of the limits of all their aliases."""
    nominal = compiled.nominal(variables)
    return Ports(
        _variable_port(compiled, v, float(value), float(size))
        for v, value, size in zip(variables, start, nominal, strict=True)
    )


def _variable_port(compiled: CompiledModel, variable: int, start: float, nominal: float) -> Port:
    reduced = compiled.solution.structure.reduced
    flat = reduced.flat
    lower, upper = -math.inf, math.inf
    units, docs = [], []
    for scalar in reduced.aliases.get(variable, ()):
        d = flat.declaration(scalar)
        negative = reduced.pool.nodes[reduced.image[scalar]][0] == "neg"
        lower, upper = max(lower, -d.max if negative else d.min), min(upper, -d.min if negative else d.max)
        units.append(d.unit)
        docs.append(d.doc)
    name = reduced.name(variable)
    unit, doc = _declared(compiled, variable)
    # A signal without a declared unit has the unit of its aliases.
    unit = unit or next((u for u in units if u), "")
    doc = doc or next((d for d in docs if d), "")
    return Port(name, unit, doc, start, nominal, lower, upper)


def _declared(compiled: CompiledModel, variable: int) -> tuple[str, str]:
    """Unit and doc of the declared variable that a reduced one stands for, or of its derivative."""
    reduced = compiled.solution.structure.reduced
    order = 0
    while variable >= len(reduced.scalar):
        variable, order = reduced.pool.integral_of[variable], order + 1
    scalar = reduced.scalar[variable]
    pool = reduced.flat.pool
    while scalar in pool.integral_of:
        scalar, order = pool.integral_of[scalar], order + 1
    declaration = reduced.flat.declaration(scalar)
    if not order:
        return declaration.unit, declaration.doc
    doc = f"{'Second rate' if order > 1 else 'Rate'} of change of {reduced.flat.scalar_name(scalar)}"
    if not declaration.unit:
        return "", doc
    dimension = parse(declaration.unit).dimension
    for _ in range(order):
        dimension = divide(dimension, parse("s").dimension)
    return format_dimension(dimension), doc


def parameter_ports(compiled: CompiledModel) -> Ports:
    """Ports of the free parameters, with their values as start."""
    described = dict(_parameters(compiled))
    # the only parameter without a declaration
    undeclared = Port("stabilisation.rate", "1/s", "Rate at which states are drawn back to constraints", min=0.0)
    return Ports(
        described.get(k) or replace(undeclared, name=name, start=value, nominal=value or 1.0)
        for k, (name, value) in enumerate(zip(compiled.parameters, compiled.parameter_values, strict=True))
    )


def _parameters(compiled: CompiledModel) -> Iterator[tuple[int, Port]]:
    names, values = compiled.parameters, compiled.parameter_values
    for parameter in compiled.flat.parameters:
        # Bound parameters are functions of free ones.
        if parameter.free:
            d = parameter.declaration
            for op, *number in (compiled.flat.pool.nodes[n] for n in parameter.nodes):
                if op != "par":
                    continue  # a frozen entry
                k = number[0]
                yield k, Port(names[k], d.unit, d.doc, values[k], d.nominal, d.min, d.max)
