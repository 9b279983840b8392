"""Checks of the pivots in a run: variables were eliminated by a division, whose divisor must not vanish in the run.

Closed loops of joints have no pivots that are safe by their form. Pivots were chosen that kept their sign at the sample
points. Where one changes its sign in a run, the equations are undefined only at that instant, but few solvers can step
over it. The equations are then solved again with points of the run among the samples, and the run is repeated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from acausal.analyse.blocks.pivots import keeps_sign
from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compile import refined
from acausal.lower.compiled import CompiledModel
from acausal.numeric.samples import Visited
from acausal.recent import once_per_owner

if TYPE_CHECKING:
    from acausal.simulate.record.record import Recorder
    from acausal.simulate.solvers.segment import Segment

Rows = tuple[Vector, Vector, Vector, Vector]

_MOST_POINTS = 40  # of runs among the samples
_POINTS_OF_RUN = 8  # taken from one run, in addition to those where a pivot is smallest
_AHEAD_FRACTIONS = (
    0.0,
    1e-4,
    1e-3,
    1e-2,
    5e-2,
)  # points examined after a failure, relative to the time since the start


def may_lose_pivots(compiled: CompiledModel) -> bool:
    """Whether some pivot of a closed loop was chosen for its values at the sample points."""
    is_loop = bool(compiled.solution.structure.invariants) and compiled.selection is None
    return is_loop and _pivots(compiled) is not None


def without_lost_pivots(recorder: Recorder, stopped: Segment | None) -> CompiledModel | None:
    """Return the model with other pivots if a pivot changed its sign in a run; None if all kept theirs.

    `stopped` begins at the point that a failed run reached; None for a completed run.
    """
    if not may_lose_pivots(recorder.compiled) or not recorder.count:
        return None
    rows, lost = _lost(recorder, stopped)
    return refined(recorder.compiled, _visited(recorder, rows, lost)) if len(lost) else None


def loses_pivots(recorder: Recorder, stopped: Segment) -> bool:
    """Whether a pivot changes its sign up to the point that a failed run reached, or shortly after it."""
    return bool(len(_lost(recorder, stopped)[1]))


def _lost(recorder: Recorder, stopped: Segment | None) -> tuple[Rows, Vector]:
    """Rows of a run, and the values there of the pivots that change their sign, shape (pivots, rows)."""
    rows = recorder.rows() if stopped is None else _extended(recorder, stopped)
    values = _values(_pivots(recorder.compiled), recorder, rows)
    return rows, values[[k for k in range(len(values)) if not keeps_sign(values[k])]]


@once_per_owner
def _pivots(compiled: CompiledModel) -> Any:
    """`(t, x, z, u, p, m) -> pivots`: divisors that vary, and not those of the stated equations; or None."""
    solution = compiled.solution
    pool = solution.structure.reduced.pool
    stated = _divisors(pool, solution.structure.reduced.residuals)
    definitions = [d for d in solution.definitions if d[0] in solution.needed]
    taken = _divisors(pool, [*(n for _, n in definitions), *solution.residuals])
    nodes = sorted(n for n in taken - stated if pool.variables_in(n))
    if not nodes:
        return None
    s = Symbols(compiled)
    builder = s.builder(compiled)
    builder.define(definitions, compiled.rewritten)
    column = ca.vertcat(*builder.lower(builder.replaced(nodes)))
    return ca.Function("pivots", s.inputs, [ca.densify(column)])


def _divisors(pool: Any, roots: Any) -> set[int]:
    return {pool.nodes[n][2] for n in pool.reachable(roots) if pool.nodes[n][0] == "div"}


def _values(function: Any, recorder: Recorder, rows: Rows) -> Vector:
    """Pivots at all rows, shape (pivots, rows)."""
    times, x, z, m = rows
    n = len(times)
    wide = [np.tile(v[:, None], (1, n)) for v in (recorder.u, recorder.p)]
    return np.array(function.map(n)(times[None, :], x, z, *wide, m), dtype=float)


def _extended(recorder: Recorder, stopped: Segment) -> Rows:
    """The rows of a failed run, and a few points after the one that it reached, along the rates."""
    times, x, z, m = recorder.rows()
    rate = recorder.compiled.rhs(stopped.start, stopped.x, stopped.z, recorder.u, recorder.p, stopped.p)[0]
    ahead = np.array(_AHEAD_FRACTIONS) * max(stopped.start - times[0], 1e-3)
    x_ahead = stopped.x[:, None] + np.nan_to_num(np.array(rate), posinf=0.0, neginf=0.0) * ahead
    wide = (np.tile(part[:, None], (1, len(ahead))) for part in (stopped.z, stopped.p))
    ahead_rows = (stopped.start + ahead, x_ahead, *wide)
    return tuple(np.concatenate([a, b], axis=-1) for a, b in zip((times, x, z, m), ahead_rows, strict=True))  # type: ignore[return-value]


def _visited(recorder: Recorder, rows: Rows, lost: Vector) -> Visited:
    """Sample points: rows where lost pivots are nearest to zero, on both sides of it, and some other rows."""
    n = len(rows[0])
    chosen = set(np.linspace(0, n - 1, min(n, _POINTS_OF_RUN)).astype(int).tolist())
    for pivot in lost:
        for side in (np.flatnonzero(pivot > 0), np.flatnonzero(pivot < 0)):
            nearest = side[np.argsort(np.abs(pivot[side]))[:2]]
            chosen |= set(nearest.tolist())
    indices = sorted(chosen)[:_MOST_POINTS]
    times, x, z, m = (part[..., indices] for part in rows)
    trajectories = recorder.observe(times, x, z, m)
    compiled = recorder.compiled
    reduced = compiled.solution.structure.reduced
    values = {
        reduced.name(reduced.pool.nodes[node][1]): np.asarray(trajectories[:, k])
        for k, node in enumerate(compiled.columns)
        if reduced.pool.nodes[node][0] == "var"
    }
    before = compiled.solution.structure.points.visited
    if before is not None:
        kept = max(0, _MOST_POINTS - len(times))
        times = np.concatenate([before.times[:kept], times])
        values = {k: np.concatenate([before.values[k][:kept], v]) for k, v in values.items() if k in before.values}
    return Visited(times, values)
