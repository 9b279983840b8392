"""Equations that determine a force on one side only: a string that becomes taut while a run goes on.

`minimum(force, l - r) == 0` says force = 0 while the string is slack. From l = r on it holds positions, which are
states, and nothing determines the force: a constraint that comes and goes, without a branch that the structure could
show (AC213). Solvers end there, with an infinite force or without convergence. It is recognised by numbers: the
equation has no slope by the unknown where that is large on one side, and one where it is large on the other, and what
is left of it on the one side is a condition on the states that holds just then. Smooth forms of the same, as that of
A. Fischer (A special Newton-type optimization method, Optimization 24 (1992) 269-284), are alike.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel

_MOST = 500  # unknowns of the models that are looked at
_LARGE = 1e6  # of an unknown, by its nominal magnitude and its value
_FLAT = 1e-6  # no slope on the one side, by that on the other
_REACHED = 1e-2  # how far the condition on the states is off, by what moves it


class OneSided(NamedTuple):
    """An unknown that nothing determines from here on, the flat equation, and the states that this would hold."""

    unknown: str
    equation: int
    states: tuple[str, ...]


def one_sided(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> OneSided | None:
    """The first equation that stops, or begins, to determine its unknown at this point; None where none does."""
    structure = compiled.solution.structure
    reduced = structure.reduced
    rows = [e for block in structure.blocks for e in block.rows]
    unknowns = [v for block in structure.blocks for v in block.columns]
    if not 0 < len(unknowns) <= _MOST:
        return None
    s, y = Symbols(compiled), ca.SX.sym("y", len(unknowns))
    builder = s.defined(compiled)
    values = builder.column([reduced.pool.var(v) for v in unknowns])
    open_ = s.builder(compiled)
    open_.define([], compiled.rewritten)
    open_.know(unknowns, y)
    residuals = open_.column([open_.replaced(structure.residuals[e]) for e in rows])
    at = (t, x, z, u, p, m)
    here = np.nan_to_num(
        np.array(ca.Function("y", s.inputs, [ca.densify(values)])(*at)).ravel(), posinf=0.0, neginf=0.0
    )
    of = ca.Function("of", [*s.inputs, y], [residuals, ca.jacobian(residuals, y), ca.jacobian(residuals, s.x)])

    def looked(at_y: Vector) -> tuple[Vector, Any, Any]:
        r, by_y, by_x = of(*at, at_y)
        return np.array(r).ravel(), abs(by_y.sparse()).tocsr(), abs(by_x.sparse()).tocsr()

    size = _LARGE * (compiled.nominal(unknowns) + np.abs(here))
    n = compiled.n_dynamic
    could = np.abs(x[:n]) + compiled.nominal_x[:n]
    first = 0
    for block in structure.blocks:
        own = slice(first, first + len(block.columns))  # as many rows as columns
        first = own.stop
        for j in range(own.start, own.stop):
            ends = []
            for side in (1.0, -1.0):
                far = here.copy()
                far[j] = side * size[j]
                ends.append(looked(far))
            for (r, by_y, by_x), (_, opposite, _) in (ends, ends[::-1]):
                usual = opposite[own, j].toarray().ravel()
                slopes = by_y[own, own].max(axis=1).toarray().ravel()
                held = by_x[own, :n]
                moves = held @ could
                flat = (usual > 0.0) & (usual < np.inf) & (slopes <= _FLAT * usual) & (moves > 0.0)
                for k in np.flatnonzero(flat & (np.abs(r[own]) <= _REACHED * moves)).tolist():
                    names = tuple(compiled.states[i] for i in sorted(held[k].indices.tolist()) if held[k, i] != 0.0)
                    return OneSided(reduced.name(unknowns[j]), structure.flat_equation(rows[own.start + k]), names)
    return None
