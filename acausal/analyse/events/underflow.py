"""Exponentials and high powers near underflow, replaced by constants."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from acausal.flatten.pool import Pool

_LARGE = 8.0
_LEAST = -300.0


def without_underflow(pool: Pool, roots: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Images of exponentials and high even powers that are constant where they are below 1e-130; added to `done` too.

    A factorisation takes squares, and divides by squares close to underflow (1e-155 squared), so that a run stopped
    with AC400 far from any burst.
    """
    found: dict[int, int] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if number in done or op not in ("exp", "pow"):
            continue
        exponent = pool.nodes[operands[-1]]
        if op == "exp":
            pool.rewrite(operands, pool.var, done)
            cut = pool.make("exp", pool.make("max", done[operands[0]], pool.const(_LEAST)))
        elif exponent[0] == "const" and exponent[1] >= _LARGE and exponent[1] % 2.0 == 0.0:
            pool.rewrite(operands, pool.var, done)
            least = pool.const(float(np.exp(_LEAST / exponent[1])))
            cut = pool.make("pow", pool.make("max", pool.make("fabs", done[operands[0]]), least), operands[1])
        else:
            continue
        found[number] = done[number] = cut
    return found
