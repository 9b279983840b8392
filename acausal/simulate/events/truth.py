"""Relations of variables as they hold at a point."""

from __future__ import annotations

import numpy as np

from acausal.arrays import Vector
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.kept import kept


def truths(compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """Each relation, 0 or 1; algebraic variables and other relations are those of `z` and `m`."""
    (distance,) = kept(compiled).distances(t, x, z, u, p, m)
    nodes = compiled.solution.structure.reduced.pool.nodes
    reaches = np.array([nodes[n][0] in ("le", "ge") for n in compiled.state_events.relations], dtype=bool)
    return np.asarray((distance > 0) | ((distance == 0) & reaches), dtype=float)
