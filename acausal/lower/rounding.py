"""Which values are made of rounding errors: 1/3 + 1/3 - 2/3 is 6e-17, and no pivot.

A running error bound to first order: every operation passes on the errors of its operands by its partial derivatives
and adds its own, of the size of its result (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002,
section 3.3). Bounds are in units of the rounding error of one operation.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from acausal.flatten.pool import LEAVES, Pool
from acausal.lower.evaluate import PARTIALS, Samples

CERTAIN = 1e-10
"""What is smaller than this, measured by its error bound, has less than six digits that are not rounding errors."""


def is_certain(pool: Pool, node: int, values: dict[int, Any]) -> Samples | bool:
    """Where a node is larger than rounding errors can be; `values` holds it and every node below it that is a sum.

    A product of parameters and variables is as exact as these are: only sums can cancel.
    """
    nodes = pool.nodes
    bounds: dict[int, Any] = {}
    below = pool.reachable([node])
    if not any(nodes[n][0] in ("add", "sub") for n in below):
        return True
    with np.errstate(all="ignore"):
        for number in below:
            op, *operands = nodes[number]
            y = values[number]
            if op in LEAVES:
                bounds[number] = np.abs(y)
            elif op == "where":
                bounds[number] = np.where(values[operands[0]], bounds[operands[1]], bounds[operands[2]])
            elif op in PARTIALS:
                slopes = PARTIALS[op](y, *[values[c] for c in operands])
                passed = [np.abs(s) * bounds[c] for s, c in zip(slopes, operands, strict=True)]
                bounds[number] = sum(passed, np.abs(y) if op != "neg" else 0.0)
            else:
                bounds[number] = np.abs(np.asarray(y, dtype=float))
        return np.asarray(np.abs(values[node]) > CERTAIN * bounds[node])
