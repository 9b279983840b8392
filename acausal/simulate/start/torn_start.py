"""A start of the whole DAE from that of the torn one, whose blocks are small enough for Newton's method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from acausal.analyse.blocks.solve import solve
from acausal.arrays import Vector
from acausal.errors import AcausalError
from acausal.lower.compile import lower
from acausal.lower.compiled import CompiledModel

Starter = Callable[[CompiledModel, float, Vector, Vector, Vector], tuple[Vector, Vector]]
"""`(compiled, t, p, u, m) -> (x, z)`: the start problem; raises InitializationError."""


def torn_start(
    compiled: CompiledModel, t: float, p: Vector, u: Vector, m: Vector, start: Starter
) -> tuple[Vector, Vector] | None:
    """States and algebraic variables as the torn form of the same model starts; None where there is no such help."""
    solution = compiled.solution
    if all(block.kind != "dae" for block in solution.blocks):
        return None
    try:
        torn = lower(solve(solution.structure))
        if _relations(torn) != _relations(compiled):
            return None
        x, z = start(torn, t, p, u, m)
    except AcausalError:
        return None
    pool = solution.structure.reduced.pool
    values = np.array(torn.observe(t, x, z, u, p, m)).ravel()
    known = dict(zip(torn.columns, values, strict=True))
    found = [known.get(pool.var(v), np.nan) for v in (*compiled.state_variables, *solution.algebraic)]
    if not np.isfinite(found).all():
        return None
    return np.array(found[: len(x)]), np.array(found[len(x) :])


def _relations(compiled: CompiledModel) -> tuple[object, ...]:
    events = compiled.state_events
    return compiled.time_events.relations, events.samples, events.memories, events.flags, events.relations
