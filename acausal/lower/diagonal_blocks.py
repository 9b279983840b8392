"""Diagonal blocks of algebraic equations: those with several solutions, and those that may become singular.

A linear block has exactly one solution where its determinant is not zero; only blocks that are nonlinear in their own
unknowns have several.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import casadi as ca

Place = tuple[list[int], list[int]]
"""Rows and columns of a block."""


def nonlinear_blocks(slope: Any, unknowns: Any) -> list[Place]:
    """(Rows, columns) of each diagonal block of `slope` that depends on the block's own `unknowns`.

    `slope` is the Jacobian of the equations by the unknowns, SX of shape (n, n), as `casadi.jacobian` returns it.
    """
    return [block for block, depends in _blocks(slope, unknowns) if depends.intersection(block[1])]


def varying_linear_blocks(slope: Any, unknowns: Any, others: Any) -> list[Place]:
    """(Rows, columns) of each block that depends on `others`, or on unknowns of other blocks, but not on its own."""
    found = _blocks(slope, ca.vertcat(unknowns, others))
    return [block for block, depends in found if depends and not depends.intersection(block[1])]


def _blocks(slope: Any, symbols: Any) -> Iterator[tuple[Place, set[int]]]:
    """The diagonal blocks, and the indices of the symbols on which each depends."""
    pattern = slope.sparsity()
    _, equations, columns, first, *_ = pattern.btf()
    slope_dependence = ca.jacobian_sparsity(slope.nz[:], symbols).T  # columns are entries of the slope
    first_of_column, depends = slope_dependence.colind(), slope_dependence.row()
    for a, b in pairwise(first):
        block = list(equations[a:b]), list(columns[a:b])
        _, entries = pattern.sub(*block, False)
        yield block, {d for k in entries for d in depends[first_of_column[k] : first_of_column[k + 1]]}
