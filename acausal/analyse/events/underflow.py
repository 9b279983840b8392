"""Exponentials and high powers near underflow, replaced by constants."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from acausal.flatten.pool import Pool

_LOWEST_EXPONENT = 8.0
_LOWEST_LOGARITHM = -300.0


def without_underflow(pool: Pool, roots: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Images of exponentials and high even powers that are constant where they are below 1e-130; `done` receives them.

    A factorisation squares entries and divides by the squares. Where these underflow (1e-155 squared), a run would stop
    with AC400, far from any burst.
    """
    images: dict[int, int] = {}
    for number in pool.reachable(roots):
        op, *operands = pool.nodes[number]
        if number in done or op not in ("exp", "pow"):
            continue
        exponent = pool.nodes[operands[-1]]
        if op == "exp":
            pool.rewrite(operands, pool.var, done)
            bounded = pool.make("exp", pool.make("max", done[operands[0]], pool.const(_LOWEST_LOGARITHM)))
        elif exponent[0] == "const" and exponent[1] >= _LOWEST_EXPONENT and exponent[1] % 2.0 == 0.0:
            pool.rewrite(operands, pool.var, done)
            least = pool.const(float(np.exp(_LOWEST_LOGARITHM / exponent[1])))
            bounded = pool.make("pow", pool.make("max", pool.make("fabs", done[operands[0]]), least), operands[1])
        else:
            continue
        images[number] = done[number] = bounded
    return images
