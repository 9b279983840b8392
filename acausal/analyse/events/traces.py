"""What is left of a burst far from it: exponentials and high powers that are almost no numbers, cut off."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from acausal.flatten.pool import Pool

_LARGE = 8.0
_LEAST = -300.0


def without_traces(pool: Pool, roots: Iterable[int], done: dict[int, int]) -> dict[int, int]:
    """Exponentials and high even powers, constant where they are below 1e-130; their images are added to `done`.

    A factorisation takes squares, and divides by one that is almost too small to be a number (1e-155 squared): a run
    stopped with AC400 far from any burst.
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
