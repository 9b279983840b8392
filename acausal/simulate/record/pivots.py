"""Pivots watched in the run: what was eliminated by dividing must not be divided by zero where the run comes to.

Closed loops of joints have no pivots that are safe by their form. Those that kept their sign at the sample points were
taken; where one changes its sign in a run, the equations are only undefined at that instant, but a solver is lucky to
step over it. The equations are then solved anew with points of the run among the samples, and the run begins again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.analyse.blocks.pivots import keeps_sign
from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compile import refined
from acausal.lower.compiled import CompiledModel
from acausal.numeric.samples import Visited

if TYPE_CHECKING:
    from acausal.simulate.record.record import Recorder
    from acausal.simulate.solvers.segment import Segment

Rows = tuple[Vector, Vector, Vector, Vector]

_MOST = 40  # points of runs among the samples
_EACH = 8  # points taken of one run beside those where a pivot is smallest
_AHEAD = (0.0, 1e-4, 1e-3, 1e-2, 5e-2)  # looked beyond the point where a run failed, by the time since its start
# The function of a model's pivots; None without any.
_known: WeakKeyDictionary[CompiledModel, Any] = WeakKeyDictionary()


def may_lose_pivots(compiled: CompiledModel) -> bool:
    """Whether some pivot of a closed loop was chosen for its values at the sample points."""
    is_loop = bool(compiled.solution.structure.invariants) and compiled.selection is None
    return is_loop and _pivots(compiled) is not None


def without_lost_pivots(recorder: Recorder, stopped: Segment | None) -> CompiledModel | None:
    """The model with other pivots where some of its own were lost in a run; None where all were kept.

    `stopped` begins where a run came to that failed.
    """
    if not may_lose_pivots(recorder.compiled) or not recorder.count:
        return None
    rows, lost = _lost(recorder, stopped)
    return refined(recorder.compiled, _visited(recorder, rows, lost)) if len(lost) else None


def loses_pivots(recorder: Recorder, stopped: Segment) -> bool:
    """Whether some pivot is lost up to where a run came to, or on the way on from there."""
    return bool(len(_lost(recorder, stopped)[1]))


def _lost(recorder: Recorder, stopped: Segment | None) -> tuple[Rows, Vector]:
    """Rows of a run, and the values there of the pivots that are lost, shape (pivots, rows)."""
    rows = recorder.rows() if stopped is None else _extended(recorder, stopped)
    found = _values(_pivots(recorder.compiled), recorder, rows)
    return rows, found[[k for k in range(len(found)) if not keeps_sign(found[k])]]


def _pivots(compiled: CompiledModel) -> Any:
    """`(t, x, z, u, p, m) -> pivots` that vary and that the model's own equations do not divide by."""
    if compiled not in _known:
        solution = compiled.solution
        pool = solution.structure.reduced.pool
        own = _divisors(pool, solution.structure.reduced.residuals)
        definitions = [d for d in solution.definitions if d[0] in solution.needed]
        taken = _divisors(pool, [*(n for _, n in definitions), *solution.residuals])
        nodes = sorted(n for n in taken - own if pool.variables_in(n))
        s = Symbols(compiled)
        builder = s.builder(compiled)
        builder.define(definitions, compiled.rewritten)
        column = ca.vertcat(*builder.lower(builder.replaced(nodes))) if nodes else None
        _known[compiled] = None if column is None else ca.Function("pivots", s.inputs, [ca.densify(column)])
    return _known[compiled]


def _divisors(pool: Any, roots: Any) -> set[int]:
    return {pool.nodes[n][2] for n in pool.reachable(roots) if pool.nodes[n][0] == "div"}


def _values(function: Any, recorder: Recorder, rows: Rows) -> Vector:
    """Pivots at all rows, shape (pivots, rows)."""
    times, x, z, m = rows
    n = len(times)
    wide = [np.tile(v[:, None], (1, n)) for v in (recorder.u, recorder.p)]
    return np.array(function.map(n)(times[None, :], x, z, *wide, m), dtype=float)


def _extended(recorder: Recorder, stopped: Segment) -> Rows:
    """The rows of a run that failed, where it came to, and a few on the way on from there."""
    times, x, z, m = recorder.rows()
    rate = recorder.compiled.rhs(stopped.start, stopped.x, stopped.z, recorder.u, recorder.p, stopped.p)[0]
    ahead = np.array(_AHEAD) * max(stopped.start - times[0], 1e-3)
    on = stopped.x[:, None] + np.nan_to_num(np.array(rate), posinf=0.0, neginf=0.0) * ahead
    wide = (np.tile(part[:, None], (1, len(ahead))) for part in (stopped.z, stopped.p))
    more = (stopped.start + ahead, on, *wide)
    return tuple(np.concatenate([a, b], axis=-1) for a, b in zip((times, x, z, m), more, strict=True))  # type: ignore[return-value]


def _visited(recorder: Recorder, rows: Rows, lost: Vector) -> Visited:
    """Rows where lost pivots are nearest to zero, on both sides of it, and some of all others."""
    n = len(rows[0])
    chosen = set(np.linspace(0, n - 1, min(n, _EACH)).astype(int).tolist())
    for found in lost:
        for side in (np.flatnonzero(found > 0), np.flatnonzero(found < 0)):
            near = side[np.argsort(np.abs(found[side]))[:2]]
            chosen |= set(near.tolist())
    places = sorted(chosen)[:_MOST]
    times, x, z, m = (part[..., places] for part in rows)
    seen = recorder.observe(times, x, z, m)
    compiled = recorder.compiled
    reduced = compiled.solution.structure.reduced
    values = {
        reduced.name(reduced.pool.nodes[node][1]): np.asarray(seen[:, k])
        for k, node in enumerate(compiled.columns)
        if reduced.pool.nodes[node][0] == "var"
    }
    before = compiled.solution.structure.points.visited
    if before is not None:
        kept = max(0, _MOST - len(times))
        times = np.concatenate([before.times[:kept], times])
        values = {k: np.concatenate([before.values[k][:kept], v]) for k, v in values.items() if k in before.values}
    return Visited(times, values)
