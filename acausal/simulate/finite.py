"""Which equation has no finite value at a point."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from acausal.flatten.flat import FlatEquation
from acausal.lower.compiled import CompiledModel
from acausal.lower.evaluate import values

Vector = np.ndarray[Any, np.dtype[np.float64]]

_MOST_CHECKED = 3000
_SIMPLE = ("var", "par", "const", "time", "neg")


class Undefined(NamedTuple):
    """A variable without a finite value, the equation it is solved from, and `name = value` of what is in that."""

    variable: str
    equation: FlatEquation
    inside: tuple[str, ...]


def first_undefined(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> Undefined | None:
    """The first variable, in solving order, that has no finite value; None where all have one.

    In large models only the rates are looked at: the function of all variables costs more than the run.
    """
    ode, alg = (np.array(v).ravel() for v in compiled.rhs(t, x, z, u, p, m))
    is_finite = bool(np.isfinite(ode).all() and np.isfinite(alg).all())
    solution = compiled.solution
    if is_finite and len(solution.definitions) > _MOST_CHECKED:
        return None
    if is_finite and np.isfinite(np.array(compiled.observe(t, x, z, u, p, m))).all():
        return _constant(compiled, p)
    reduced = solution.structure.reduced
    known = dict(zip(compiled.state_variables, x, strict=True))
    known.update(zip(solution.algebraic, z, strict=True))
    known.update(zip(reduced.inputs, u, strict=True))
    leaves = {"var": known.__getitem__, "par": p.__getitem__, "time": lambda _: t}
    rows = {v: b.rows for b in solution.structure.blocks for v in b.columns}
    for variable, node in solution.definitions:
        value = float(np.ravel(values(reduced.pool, [node], leaves)[node])[0])
        known[variable] = value
        if not np.isfinite(value):
            equation = reduced.flat.equations[solution.structure.flat_equation(rows[variable][0])]
            inside = [f"{reduced.name(v)} = {known[v]:g}" for v in sorted(reduced.pool.variables_in(node))]
            return Undefined(reduced.name(variable), equation, tuple(inside))
    return None


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
            return Undefined(flat.scalar_name(scalar), equation, ())
    return None
