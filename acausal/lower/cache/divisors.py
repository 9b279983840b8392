"""Divisors that consist of parameters, which may shrink to rounding errors after the pivots have been chosen.

A pivot without variables is chosen for the values with which a model is compiled. With other values it may still be
nonzero, but so small beside the other entries of its row and column that the quotient has no digits: forces from the
torque over an arm that was 0.3 m and is 1e-15 m. Pivots for which that cannot happen are not looked at
(`may_lose_digits`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.build import Builder
from acausal.lower.compiled import CompiledModel
from acausal.numeric.evaluate import values

LOST = 1e-8
"""Ratio of a divisor to its value at compile time below which quotients have lost half of their digits."""


def shrunken_divisor(compiled: CompiledModel, parameters: Sequence[float], ratio: float) -> str:
    """Describe the first nonzero divisor below `ratio` times its value when pivots were chosen; "" if none is."""
    pool, names = compiled.solution.structure.reduced.pool, compiled.parameters
    found = values(pool, compiled.constant_divisors, {"par": parameters.__getitem__, "time": lambda _: 0.0})
    for node, size in compiled.constant_divisors.items():
        if 0.0 < abs(found[node]) < ratio * size:
            used = [names[k] for k in _parameters(compiled, [node])]
            return f"{', '.join(used[:3])}: a divisor has shrunk from {size:.3g} to {abs(found[node]):.3g}"
    return ""


def refusal(compiled: CompiledModel, free: Sequence[int] | None) -> Any:
    """Function `(p) -> 0`, or nan where `shrunken_divisor` refuses p: functions cannot raise an error.

    None if no divisor depends on the `free` entries of p; None for `free` stands for all.
    """
    divisors = compiled.constant_divisors
    if not divisors or (free is not None and _parameters(compiled, [*divisors]).isdisjoint(free)):
        return None
    p = ca.SX.sym("p", len(compiled.parameters))
    builder = Builder(compiled.solution.structure.reduced.pool, ca.SX(0), p, {})
    sizes = [ca.fabs(d) for d in builder.lower(divisors)]
    lost = [ca.logic_and(d > 0, d < LOST * size) for d, size in zip(sizes, divisors.values(), strict=True)]
    return ca.Function("refusal", [p], [ca.if_else(ca.sum1(ca.vertcat(*lost)) > 0, math.nan, 0)], ["p"], ["refused"])


def _parameters(compiled: CompiledModel, nodes: Sequence[int]) -> set[int]:
    """Indices in p of the parameters below `nodes`."""
    pool = compiled.solution.structure.reduced.pool
    return {pool.nodes[n][1] for n in pool.reachable(nodes) if pool.nodes[n][0] == "par"}
