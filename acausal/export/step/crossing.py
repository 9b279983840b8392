"""Test whether solutions of algebraic equations may meet within a step, so that Newton's method may switch solutions.

Where solutions meet, the determinant of the Jacobian of the equations is zero. In a step across such a point, the
tangents of the determinant at both ends, along the solution, reach zero within the step. This holds whether the
determinant changes sign there, touches zero, or the step has switched to another solution
(`acausal.simulate.record.meeting.branches` distinguishes these for a run). A determinant that comes near zero and rises
again within one step looks the same, and a step may switch solutions there, too. Where the determinant jumps at a kink,
it may have the same sign on both sides although the solution has switched. Therefore `Method.step` also tests whether
Newton's method, started from the tangent of either end, leads to the solution at the other end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from acausal.lower.diagonal_blocks import nonlinear_blocks

# A determinant may be zero in a step if its tangent falls to this fraction of its value or below within the step.
_LEFT = 0.05


def determinants(rates: Any) -> Any:
    """Function `(t, x, z, *held) -> (signs, sizes)`: signs and logarithms of determinants of nonlinear blocks.

    These are the blocks of algebraic equations that may have several solutions. `rates`: SX function
    `(t, x, z, *held) -> (ode, alg, ...)`.
    """
    arguments = _arguments(rates)
    slope = ca.jacobian(rates(*arguments)[1], arguments[2])
    found = [_determinant(slope[rows, columns]) for rows, columns in nonlinear_blocks(slope, arguments[2])]
    results = [ca.vertcat(ca.SX(0, 1), *(d[k] for d in found)) for k in range(2)]
    return ca.Function("determinants", arguments, results, rates.name_in(), ["signs", "sizes"])


def along_solution(rates: Any) -> Any:
    """Function `(t, x, z, *held) -> (signs, rates of the sizes [1/s], rates of z)`, see `determinants`."""
    arguments = _arguments(rates)
    ode, alg = rates(*arguments)[:2]
    signs, sizes = determinants(rates)(*arguments)
    z_rates: Any = ca.SX(0, 1)
    if signs.numel():
        tx, tx_rates = ca.vertcat(*arguments[:2]), ca.vertcat(1, ca.densify(ode))
        z_rates = -ca.solve(ca.jacobian(alg, arguments[2]), ca.densify(ca.jtimes(alg, tx, tx_rates)))
        sizes = ca.jtimes(sizes, ca.vertcat(tx, arguments[2]), ca.vertcat(tx_rates, z_rates))
    return ca.Function("along_solution", arguments, [ca.densify(v) for v in (signs, sizes, z_rates)])


def _arguments(rates: Any) -> list[Any]:
    return [ca.SX.sym(rates.name_in(k), rates.numel_in(k)) for k in range(rates.n_in())]


def _determinant(matrix: Any) -> tuple[Any, Any]:
    """Sign of the determinant of a square matrix (or consistently its opposite), and logarithm of its magnitude.

    Householder reflections have determinant -1, and the pivots of the QR factorisation are positive; a column that
    needs no reflection has factor zero (CasADi's sparse QR, after T. A. Davis, Direct Methods for Sparse Linear
    Systems, SIAM 2006, chapter 5). The permutations of the factorisation do not depend on values, and are left out.
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
    """1 if a determinant may be zero within a step of length `h`, from `along_solution` at both ends of the step."""
    (first, falls, _), (last, rises, _) = before, behind
    to_zero = ca.logic_and(1 + h * falls <= _LEFT, 1 - h * rises <= _LEFT)
    return ca.sum1(ca.logic_or(first * last <= 0, to_zero)) > 0
