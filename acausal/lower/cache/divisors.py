"""Divisors that consist of parameters, which may shrink to rounding errors after the pivots have been chosen.

A pivot without variables is chosen for the values with which a model is compiled. With other values it may still be
nonzero, but so small beside the other entries of its row and column that the quotient has no digits: forces from the
torque over an arm that was 0.3 m and is 1e-15 m.
"""

from __future__ import annotations

from collections.abc import Sequence

from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values


def shrunken_divisor(compiled: CompiledModel, parameters: Sequence[float], ratio: float) -> str:
    """Describe the first nonzero divisor below `ratio` times its value when pivots were chosen; "" if none is."""
    pool, names = compiled.solution.structure.reduced.pool, compiled.parameters
    found = values(pool, compiled.constant_divisors, {"par": parameters.__getitem__, "time": lambda _: 0.0})
    for node, size in compiled.constant_divisors.items():
        if 0.0 < abs(found[node]) < ratio * size:
            used = [names[pool.nodes[n][1]] for n in pool.reachable([node]) if pool.nodes[n][0] == "par"]
            return f"{', '.join(used[:3])}: a divisor has shrunk from {size:.3g} to {abs(found[node]):.3g}"
    return ""
