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

from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols

Vector = np.ndarray[Any, np.dtype[np.float64]]
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
    """The first such equation that turns at this point."""
    structure = compiled.solution.structure
    reduced = structure.reduced
    of_block = {v: [(e, b.columns) for e in b.rows] for b in structure.blocks for v in b.columns}
    rows = dict.fromkeys(e for block in structure.blocks for e in block.rows)
    unknowns = [v for block in structure.blocks for v in block.columns]
    if not 0 < len(unknowns) <= _MOST:
        return None
    s, y = Symbols(compiled), ca.SX.sym("y", len(unknowns))
    builder = s.builder(compiled)
    builder.define(compiled.solution.definitions, compiled.rewritten)
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
        return np.array(r).ravel(), by_y, by_x

    place, row = {v: k for k, v in enumerate(unknowns)}, {e: k for k, e in enumerate(rows)}
    size = _LARGE * (compiled.nominal(unknowns) + np.abs(here))
    n = compiled.n_dynamic
    could = np.abs(x[:n]) + compiled.nominal_x[:n]
    for v in unknowns:
        j = place[v]
        ends = []
        for side in (1.0, -1.0):
            far = here.copy()
            far[j] = side * size[j]
            ends.append(looked(far))
        for (r, by_y, by_x), (_, opposite, _) in (ends, ends[::-1]):
            for e, columns in of_block[v]:
                k = row[e]
                usual = abs(float(opposite[k, j]))
                slopes = [abs(float(by_y[k, place[w]])) for w in columns]
                held = np.array(by_x[k, :n]).ravel()
                if not 0.0 < usual < np.inf or not max(slopes) <= _FLAT * usual or not np.abs(held).max() > 0.0:
                    continue
                if abs(r[k]) <= _REACHED * float(np.abs(held) @ could):
                    names = tuple(compiled.states[i] for i in np.flatnonzero(held).tolist())
                    return OneSided(reduced.name(v), structure.flat_equation(e), names)
    return None
