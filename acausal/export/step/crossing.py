"""Whether solutions of algebraic equations may meet within a step, so that its Newton's method may have changed over.

Where they meet the determinant of the equations' slope is zero. From both ends of a step over such a point its tangent
along the solution leads to zero within the step, whether it changes its sign there, touches zero, or the step has
turned off into another solution (`acausal.simulate.record.meeting.branches` tells these apart for a run). A
determinant that comes near zero and rises again within one step looks the same, and a step may change over there, too.
Where it jumps at a kink, a solution that turns off has one sign on both sides: there Newton's method is asked where it
leads from the tangents of both ends (`Method.step`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.nonlinear_blocks import nonlinear_blocks

# What a tangent may leave of a determinant, by its value, where it counts as zero.
_LEFT = 0.05


def determinants(rates: Any) -> Any:
    """Function `(t, x, z, *held) -> (signs, sizes)` of blocks that may have several solutions; sizes are logarithms.

    `rates`: `(t, x, z, *held) -> (ode, alg, ...)`, SX.
    """
    here = _arguments(rates)
    slope = ca.jacobian(rates(*here)[1], here[2])
    found = [_determinant(slope[rows, columns]) for rows, columns in nonlinear_blocks(slope, here[2])]
    both = [ca.vertcat(ca.SX(0, 1), *(d[k] for d in found)) for k in range(2)]
    return ca.Function("determinants", here, both, rates.name_in(), ["signs", "sizes"])


def along_solution(rates: Any) -> Any:
    """Function `(t, x, z, *held) -> (signs, rates of the sizes [1/s], rates of z)`, see `determinants`."""
    here = _arguments(rates)
    ode, alg = rates(*here)[:2]
    signs, sizes = determinants(rates)(*here)
    follow: Any = ca.SX(0, 1)
    if signs.numel():
        known, forward = ca.vertcat(*here[:2]), ca.vertcat(1, ca.densify(ode))
        follow = -ca.solve(ca.jacobian(alg, here[2]), ca.densify(ca.jtimes(alg, known, forward)))
        sizes = ca.jtimes(sizes, ca.vertcat(known, here[2]), ca.vertcat(forward, follow))
    return ca.Function("along_solution", here, [ca.densify(v) for v in (signs, sizes, follow)])


def _arguments(rates: Any) -> list[Any]:
    return [ca.SX.sym(rates.name_in(k), rates.numel_in(k)) for k in range(rates.n_in())]


def _determinant(matrix: Any) -> tuple[Any, Any]:
    """The sign of the determinant of a square matrix, or always its opposite, and the logarithm of its magnitude.

    Householder's reflections have determinant -1, and pivots of their QR factorisation are positive; where a column
    needs none, its factor is zero (CasADi's sparse QR, after T. A. Davis, Direct Methods for Sparse Linear Systems,
    SIAM 2006, chapter 5).
    """
    if matrix.shape[0] <= 3:
        whole = ca.det(ca.densify(matrix))
        return ca.sign(whole), ca.log(ca.fabs(whole))
    _, triangle, factors, *_ = ca.qr_sparse(matrix)
    sign: Any = ca.SX(1)
    for pivot, factor in zip(ca.vertsplit(ca.diag(triangle)), ca.vertsplit(ca.densify(factors)), strict=True):
        sign *= ca.sign(pivot) * ca.if_else(factor == 0, 1, -1)
    return sign, ca.sum1(ca.log(ca.diag(triangle)))


def meets(h: Any, before: Sequence[Any], behind: Sequence[Any]) -> Any:
    """1 where a determinant may be zero within a step of length `h`, from `along_solution` at both its ends."""
    (first, falls, _), (last, rises, _) = before, behind
    to_zero = ca.logic_and(1 + h * falls <= _LEFT, 1 - h * rises <= _LEFT)
    return ca.sum1(ca.logic_or(first * last <= 0, to_zero)) > 0
