"""Finds the equation that has no finite value at a point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from acausal.arrays import Vector
from acausal.flatten.flat import FlatEquation
from acausal.flatten.pool import LEAVES
from acausal.flatten.reduced import ReducedSystem
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values
from acausal.simulate.equations.function_cache import functions_of

Leaves = Mapping[str, Callable[[int], Any]]

_TOO_FEW_STEPS = (
    "Newton's method inside the equations takes more steps for it than were counted for the parameters with which the "
    "model was compiled: compile it with those of the run"
)
UNDEFINED = "a division by zero, or a root or logarithm of a negative number"
_WORDS = {
    "div": "it divides by `{}`, which is",
    "log": "it takes the logarithm of `{}`, which is",
    "sqrt": "it takes the square root of `{}`, which is",
    "asin": "it takes the arcsine of `{}`, which is",
    "acos": "it takes the arccosine of `{}`, which is",
    "exp": "it takes the exponential of `{}`, which is",
    "sinh": "it takes the hyperbolic sine of `{}`, which is",
    "cosh": "it takes the hyperbolic cosine of `{}`, which is",
    "pow": "it raises `{}`, which is",
}
_SIMPLE = ("var", "par", "const", "time", "neg")


class Undefined(NamedTuple):
    """A variable without a finite value, and the equation from which it is computed.

    `inside`: `name = value` of the variables and parameters in that equation.
    `reason`: The operation that has no finite value; None if there is no single one.
    `parameter`: The path of the parameter that causes it, or None.
    """

    variable: str
    equation: FlatEquation
    inside: tuple[str, ...]
    reason: str | None = None
    parameter: str | None = None


def first_undefined(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> Undefined | None:
    """The first variable, in evaluation order, that has no finite value; None if all are finite."""
    if functions_of(compiled).are_finite(t, x, z, u, p, m):
        return None
    solution = compiled.solution
    reduced = solution.structure.reduced
    known = dict(zip(compiled.state_variables, x, strict=True))
    known.update(zip(solution.algebraic, z, strict=True))
    known.update(zip(reduced.inputs, u, strict=True))
    leaves: Leaves = {"var": known.__getitem__, "par": p.__getitem__, "time": lambda _: t}
    rows = {v: b.rows for b in solution.structure.blocks for v in b.columns}
    for variable, node in solution.definitions:
        value = float(np.ravel(values(reduced.pool, [node], leaves)[node])[0])
        known[variable] = value
        if not np.isfinite(value):
            equation = reduced.flat.equations[solution.structure.flat_equation(rows[variable][0])]
            is_searched = any(m.variable == variable for m in solution.monotone)
            why = (_TOO_FEW_STEPS, None) if is_searched else _reason(reduced, node, leaves)
            return Undefined(reduced.name(variable), equation, _inside(reduced, node, leaves), *why)
    return _constant(compiled, p)


def _inside(reduced: ReducedSystem, node: int, leaves: Leaves) -> tuple[str, ...]:
    """`name = value` of the variables and parameters below a node, variables first."""
    found = {reduced.pool.nodes[n] for n in reduced.pool.reachable([node])}
    known = len(
        reduced.flat.parameter_names
    )  # then comes the rate of stabilisation, which is no parameter of the model
    leaf = ((op, k) for op, *rest in found if op in ("var", "par") for k in rest)
    held = sorted((op != "var", k, op) for op, k in leaf if op == "var" or k < known)
    return tuple(f"{reduced.leaf_name(op, k)} = {float(leaves[op](k)):g}" for _, k, op in held)


def _reason(reduced: ReducedSystem, node: int, leaves: Leaves) -> tuple[str | None, str | None]:
    """Describe the first operation whose value is not finite although its operands are; and its parameter, if any."""
    pool = reduced.pool
    known = values(pool, [node], leaves)

    def is_finite(n: int) -> bool:
        return bool(np.isfinite(np.ravel(known[n])[0]))

    while True:
        op, *operands = pool.nodes[node]
        if op == "where" and is_finite(operands[0]):
            operands = [operands[1 if np.ravel(known[operands[0]])[0] else 2]]
        unknown = [] if op in LEAVES else [n for n in operands if not is_finite(n)]
        if not unknown:
            break
        node = unknown[0]
    if op == "par" and not is_finite(node):
        name = reduced.leaf_name(op, operands[0])
        return f"{name} is {float(np.ravel(known[node])[0]):g}", name
    words = _WORDS.get(op)
    if words is None or is_finite(node):
        return None, None
    operand = operands[1 if op == "div" else 0]
    shown = reduced.text(operand, 60)
    value = float(np.ravel(known[operand])[0])
    tail = f", to the power of {float(np.ravel(known[operands[1]])[0]):g}" if op == "pow" else ""
    is_parameter = pool.nodes[operand][0] == "par"
    return f"{words.format(shown)} {value:g}{tail}", shown if is_parameter else None


def _constant(compiled: CompiledModel, p: Vector) -> Undefined | None:
    """The first variable that is computed from parameters alone and has no finite value."""
    reduced = compiled.solution.structure.reduced
    pool = reduced.pool
    computed = {
        node: scalar
        for scalar, node in enumerate(reduced.image)
        if scalar not in reduced.left_out and pool.nodes[node][0] not in _SIMPLE and not pool.variables_in(node)
    }
    known = values(pool, list(computed), {"par": p.__getitem__, "time": lambda _: 0.0})
    for node, scalar in computed.items():
        if not np.isfinite(np.ravel(known[node])[0]):
            flat = reduced.flat
            holds = (e for e in flat.equations if scalar in flat.pool.variables_in(e.left, e.right))
            equation = next(holds, flat.equations[0])
            leaves: Leaves = {"par": p.__getitem__, "time": lambda _: 0.0}
            inside, why = _inside(reduced, node, leaves), _reason(reduced, node, leaves)
            return Undefined(flat.scalar_name(scalar), equation, inside, *why)
    return None
