"""Which values are made of rounding errors: 1/3 + 1/3 - 2/3 is 6e-17, and no pivot.

A running error bound to first order: every operation passes on the errors of its operands by its partial derivatives
and adds its own, of the size of its result (N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002,
section 3.3). Bounds are in units of the rounding error of one operation.

Such bounds are of the worst case: over a hundred bodies in a row they grow without limit, though the values stay right
to fourteen digits. So what comes out the same in single precision is believed before any bound is asked for: a
rounding error would be 1e9 times as large there, or vanish.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from acausal.flatten.pool import LEAVES, Pool
from acausal.language.expressions.external import Call
from acausal.numeric.evaluate import PARTIALS, Samples, operation

CERTAIN = 1e-10
"""What is smaller than this, measured by its error bound, has less than six digits that are not rounding errors."""

AGREES = 0.1
"""Largest relative difference between values in double and in single precision that are the same."""


def agrees(pool: Pool, node: int, values: dict[int, Any], rough: dict[int, Any]) -> bool:
    """Whether a node has the same value everywhere when it is computed in single precision.

    `values` holds it and every node below it; `rough` is filled with the values in single precision.
    """

    def value(here: int, op: str, operands: list[int]) -> Any:
        if _ends(op):
            return np.asarray(values[here]).astype(np.float32)[()]
        return operation(op)(*[rough[c] for c in operands])

    with np.errstate(all="ignore"):
        _fill(pool, node, rough, _ends, value)
        found = np.asarray(rough[node])
        exact = np.asarray(values[node], dtype=float)
        return found.dtype == np.float32 and bool((np.abs(found - exact) < AGREES * np.abs(exact)).all())


def _ends(op: str) -> bool:
    """Whether an operation is taken as it is in double precision: a leaf, or a call of a function from outside."""
    return op in LEAVES or isinstance(op, Call)


def is_certain(pool: Pool, node: int, values: dict[int, Any], bounds: dict[int, Any]) -> Samples:
    """Where a node is larger than rounding errors can be.

    `values` holds it and every node below it; `bounds` is filled with the bounds of these nodes, each computed once as
    long as the values are the same.
    """

    def value(here: int, op: str, operands: list[int]) -> Any:
        return _bound(op, operands, values[here], values, bounds)

    with np.errstate(all="ignore"):
        _fill(pool, node, bounds, LEAVES.__contains__, value)
        return np.asarray(np.abs(values[node]) > CERTAIN * bounds[node])


def _fill(
    pool: Pool,
    node: int,
    done: dict[int, Any],
    ends: Callable[[str], bool],
    value: Callable[[int, str, list[int]], Any],
) -> None:
    """Fill `done` with the value of a node and of all below it, each after its operands; what `ends` needs none."""
    stack = [node]
    while stack:
        here = stack[-1]
        if here not in done:
            op, *operands = pool.nodes[here]
            missing = [] if ends(op) else [c for c in operands if c not in done]
            if missing:
                stack.extend(missing)
                continue
            done[here] = value(here, op, operands)
        stack.pop()


def _bound(op: str, operands: list[int], y: Any, values: dict[int, Any], bounds: dict[int, Any]) -> Any:
    """Error bound of one operation whose operands have theirs."""
    if op in LEAVES:
        return np.abs(y)
    if op == "where":
        return np.where(values[operands[0]], bounds[operands[1]], bounds[operands[2]])
    if op not in PARTIALS:
        return np.abs(np.asarray(y, dtype=float))
    total = np.abs(y) if op != "neg" else 0.0
    for slope, operand in zip(PARTIALS[op](y, *[values[c] for c in operands]), operands, strict=True):
        total = total + np.abs(slope) * bounds[operand]
    return total
