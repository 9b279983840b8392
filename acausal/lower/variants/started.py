"""Variants of a compiled model with other start values, or with some inputs as functions of time.

For other start values only the start problem is built again. An input over time is data, not part of the model: over
each stretch of a run it is a polynomial whose coefficients are modes, like those of delayed signals. Other data change
the coefficients only, so that nothing is compiled again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from weakref import WeakKeyDictionary

from acausal.analyse.start import start_problem
from acausal.errors import UsageError, listed_names, nearest
from acausal.flatten.flat import FlatStart, suffixes
from acausal.flatten.parameters import entries
from acausal.flatten.reduced import ReducedSystem
from acausal.language.declarations.declaration import Declaration
from acausal.lower.cache.cache import replaced
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner

_Values = tuple[tuple[int, float], ...]
_MOST_VARIANTS = 4
_CACHE: WeakKeyDictionary[CompiledModel, OrderedDict[_Values, CompiledModel]] = WeakKeyDictionary()


def with_starts(compiled: CompiledModel, given: Mapping[str, object]) -> CompiledModel:
    """The model with these start values (by path, in SI or as text with unit), as if they were declared `fixed`.

    They replace declared starts of the same variable under any of its names; all other declared starts remain, and must
    be consistent with them.

    Raises UsageError: AC046 for a path that is not a variable of the model, or that depends on parameters alone; AC023
    for a value that is not a number.
    """
    if not given:
        return compiled
    key = tuple(_values(compiled, given).items())
    variants = _CACHE.setdefault(compiled, OrderedDict())
    variant = variants.pop(key, None)
    if variant is None:
        structure = compiled.solution.structure
        flat = structure.reduced.flat
        reset_variables = {_variable(structure.reduced, scalar) for scalar, _ in key}
        starts = {
            s: v for s, v in flat.starts.items() if _variable(structure.reduced, s) not in reset_variables - {None}
        }
        for scalar, number in key:
            starts[scalar] = FlatStart(flat.pool.const(number), True, None, flat.scalar_name(scalar))
        reduced = replaced(structure.reduced, flat=replaced(flat, starts=starts))
        solution = replaced(compiled.solution, structure=replaced(structure, reduced=reduced))
        variant = replace(compiled, solution=solution, start=start_problem(solution))
    variants[key] = variant
    if len(variants) > _MOST_VARIANTS:
        variants.popitem(last=False)
    return variant


def discrete_starts(compiled: CompiledModel, given: Mapping[str, object]) -> dict[str, float]:
    """Those of the start values that belong to discrete variables, by scalar name."""
    flat = compiled.flat
    values = {flat.scalar_name(scalar): (flat.declaration(scalar), v) for scalar, v in _values(compiled, given).items()}
    return {name: v for name, (declared, v) in values.items() if declared.discrete}


def _values(compiled: CompiledModel, given: Mapping[str, object]) -> dict[int, float]:
    """Start values by scalar."""
    if not isinstance(given, Mapping):
        raise UsageError("AC046", f"start is a {type(given).__name__}", help="a dictionary: start={'mass.s': 0.1}")
    listed_names("start", given)
    reduced = compiled.solution.structure.reduced
    variables: dict[str, tuple[tuple[int, ...], int, Declaration]] = {}
    for v in compiled.flat.variables:
        shape = v.declaration.shape
        variables[v.path] = shape, v.first, v.declaration
        if shape:
            variables |= {v.path + e: ((), v.first + k, v.declaration) for k, e in enumerate(suffixes(shape))}
    start_values: dict[int, float] = {}
    for path, value in given.items():
        if path not in variables:
            raise _unknown(compiled, path, variables)
        shape, first, declared = variables[path]
        for k, number in enumerate(entries(path, shape, value, declared.unit)):
            scalar = first + k
            image = reduced.image[scalar]
            if scalar in reduced.left_out or not reduced.pool.variables_in(image):
                raise UsageError(
                    "AC046",
                    f"{path} has no start value: it follows from parameters, or was left out of the model",
                    help="set the parameters it follows from" if scalar not in reduced.left_out else None,
                )
            if number != number or abs(number) == float("inf"):
                raise UsageError("AC046", f"start of {path} = {number} is not finite")
            if declared.boolean and number not in (0.0, 1.0):
                raise UsageError("AC046", f"{path} is boolean, its start {number:g} is not", help="give 0 or 1")
            if declared.integer and number != round(number):
                raise UsageError("AC046", f"{path} is an integer, its start {number:g} is not")
            if scalar in start_values and start_values[scalar] != number:
                raise UsageError("AC046", f"{path} is given two start values: {start_values[scalar]:g} and {number:g}")
            start_values[scalar] = number
    inputs = set(compiled.flat.inputs) & set(start_values)
    if inputs:
        name = compiled.flat.scalar_name(min(inputs))
        raise UsageError("AC046", f"{name} is an input, not a start value", help=f"inputs={{'{name}': ...}}")
    return start_values


def _variable(reduced: ReducedSystem, scalar: int) -> int | None:
    """The reduced variable that a scalar equals up to its sign; None if it is another expression."""
    nodes = reduced.pool.nodes
    op, *rest = nodes[reduced.image[scalar]]
    if op == "neg":
        op, *rest = nodes[rest[0]]
    return int(rest[0]) if op == "var" else None


def _unknown(compiled: CompiledModel, path: str, variables: Mapping[str, object]) -> UsageError:
    parameters = {*compiled.parameters, *(p.path for p in compiled.flat.parameters)}
    suggestions = nearest(path, [*compiled.states, *variables])
    return UsageError(
        "AC046",
        f"{path} is a parameter, not a start value" if path in parameters else f"there is no variable '{path}'",
        evidence=[f"did you mean {', '.join(suggestions)}?"] if suggestions and path not in parameters else [],
        help=f"parameters={{'{path}': ...}}, or --set {path}=..." if path in parameters else None,
    )


def with_driven(compiled: CompiledModel, places: tuple[int, ...]) -> CompiledModel:
    """The model whose inputs at these indices of u are functions of time; cached by model and indices."""
    return _driven(compiled, places) if places else compiled


@once_per_owner
def _driven(compiled: CompiledModel, places: tuple[int, ...]) -> CompiledModel:
    lowered = lower(compiled.solution, places)
    return replace(lowered, selection=compiled.selection, timings=dict(compiled.timings))
