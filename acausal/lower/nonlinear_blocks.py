"""Blocks of algebraic equations that may have several solutions: those that are nonlinear in their own unknowns."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca


def nonlinear_blocks(slope: Any, unknowns: Any) -> list[tuple[list[int], list[int]]]:
    """(Rows, columns) of each diagonal block of `slope` that depends on the block's own `unknowns`.

    `slope` is the Jacobian of the equations by the unknowns, SX of shape (n, n), as `casadi.jacobian` returns it.
    """
    pattern = slope.sparsity()
    _, equations, columns, first, *_ = pattern.btf()
    slope_dependence = ca.jacobian_sparsity(slope.nz[:], unknowns).T  # columns are entries of the slope
    first_of_column, depends, blocks = slope_dependence.colind(), slope_dependence.row(), []
    for a, b in pairwise(first):
        block = list(equations[a:b]), list(columns[a:b])
        own_unknowns, (_, entries) = set(block[1]), pattern.sub(*block, False)
        if any(own_unknowns.intersection(depends[first_of_column[k] : first_of_column[k + 1]]) for k in entries):
            blocks.append(block)
    return blocks
