"""Phases: the arguments of sines, cosines and tangents in guards, which have to be sampled several times in a period.

States are resolved by the steps of a solver, but not what a guard makes of them: `sin(w*t) > 0.9` turns any number of
times while all states rest or grow evenly. Polynomials through mesh points that are a period apart look smooth.
"""

from __future__ import annotations

from collections.abc import Iterable
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.flatten.pool import Pool
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import NarrowFunction
from acausal.simulate.events.guards import Moment
from acausal.simulate.solvers.segment import Piece, Segment

# The largest change of a phase between two mesh points [rad]. With 32 points in each period, the parabolas through them
# show a peak that exceeds its threshold by 2e-5 of its height; with eight, 4 of 50 were lost that exceed it by 1e-3.
LARGEST_ADVANCE = np.pi / 16
# The fraction of the largest distance of mesh points that is aimed at, and the shortest interval that is divided, in
# distances of instants that coincide.
_WITHIN, _FEW = 0.7, 16.0
_PERIODIC = frozenset(("sin", "cos", "tan"))
_MADE: WeakKeyDictionary[CompiledModel, NarrowFunction | None] = WeakKeyDictionary()


def phases(compiled: CompiledModel) -> NarrowFunction | None:
    """The phases of the guards of a model [rad], a function of (t, x, z, u, p, m); None if there are none that vary."""
    if compiled not in _MADE:
        _MADE[compiled] = _made(compiled)
    return _MADE[compiled]


def _made(compiled: CompiledModel) -> NarrowFunction | None:
    symbols = Symbols(compiled)
    builder = symbols.defined(compiled)
    relations = set(compiled.state_events.relations)
    rates = compiled.solution.structure.rates(compiled.state_variables)
    # what rates depend on is resolved by the error control of the solver
    resolved = _behind(builder.pool, compiled, [*rates, *compiled.solution.residuals], relations)
    nodes = _behind(builder.pool, compiled, relations, set()) - resolved
    found = list(
        dict.fromkeys(builder.pool.nodes[n][1] for n in sorted(nodes) if builder.pool.nodes[n][0] in _PERIODIC)
    )
    if not found:
        return None
    column = ca.densify(builder.column(builder.replaced(found)))
    varies = [k for k in range(column.numel()) if ca.depends_on(column[k], ca.vertcat(*symbols.inputs[:3]))]
    return NarrowFunction("phases", symbols.inputs, column[varies]) if varies else None


def _behind(pool: Pool, compiled: CompiledModel, roots: Iterable[int], barriers: set[int]) -> set[int]:
    """Nodes on which these roots depend, through definitions, but not through `barriers`."""
    definitions, pending, seen = dict(compiled.solution.definitions), list(roots), set[int]()
    while pending:
        fresh = set(pool.reachable(pending, barriers)) - seen
        seen |= fresh
        variables = (pool.nodes[n][1] for n in fresh if pool.nodes[n][0] == "var")
        behind = {definitions[v] for v in variables if v in definitions}
        pending = list(behind - seen - barriers)
    return seen


def first_swing(
    moment: Moment, segment: Segment, times: Vector, piece: Piece, rows: NDArray[np.int64], until: int, shortest: float
) -> tuple[int | None, float]:
    """The first of some intervals in which a phase advances too far, or None, and a better distance of mesh points [s].

    `times`: The start of the segment and n mesh points, shape (n + 1,), which are the `rows` of a piece, shape (n,).
    `until`, `shortest`: The first `until` intervals count, unless they are nearly as short as `shortest` [s].
    """
    problem = moment.regime.problem
    function = phases(problem.compiled)
    if function is None or not until:
        return None, np.inf
    x, z = (np.column_stack([v, w[:, rows[:until]]]) for v, w in ((segment.x, piece.x), (segment.z, piece.z)))
    values = function.many(times[: until + 1, None], x.T, z.T, problem.u, problem.p, moment.m)
    advance, widths = np.abs(np.diff(values, axis=0)).max(axis=1) / LARGEST_ADVANCE, np.diff(times[: until + 1])
    swung = np.flatnonzero((advance > 1.0) & (widths > _FEW * shortest))
    if not len(swung):
        return None, np.inf
    k = int(swung[0])
    return k, _WITHIN * float(widths[k] / advance[k])
