"""First and second derivatives of a nonlinear program, assembled from those of the model functions at its points.

With X the unknowns, Y(X) the results of the functions F at the points and L(X, Y) the Lagrange function,

    dg/dX = g_X + g_Y D,    d2L/dX2 = L_XX + L_XY D + (L_XY D)' + D' L_YY D + M' (sum_i L_Yi d2F_i) M,    D = J M,

where the arguments at the points are M X + b, and J is block diagonal with the Jacobians of F. The second derivatives
of F are generated once, for one point, with L_Y as weights. This is faster than CasADi's derivatives of a mapped
function, which evaluate as many directions at every point as the coloring of the whole program has colors.

Source: partially separable functions, A. Griewank, Ph. L. Toint, in: Nonlinear Optimization 1981, pp. 301-312.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from acausal.optimal_control.program.points import Points, key, symbols_in


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Functions for `nlpsol`: `(x, p) -> (f, grad)`, `(x, p) -> (g, jac)`, `(x, p, lam_f, lam_g) -> triu`."""

    gradient: Any
    jacobian: Any
    hessian: Any


@dataclass(frozen=True, eq=False)
class _Group:
    """A function at n points, and the constant Jacobian of its stacked arguments by the unknowns."""

    points: Points
    input_jacobian: Any

    def only(self, expression: Any) -> _Group:
        """The group restricted to the rows of results that occur in an expression."""
        names = symbols_in(expression)
        kept = [k for k, s in enumerate(self.points.symbols) if key(s) in names]
        rows, symbols = ([group[k] for k in kept] for group in (self.points.rows, self.points.symbols))
        return _Group(replace(self.points, rows=rows, symbols=symbols), self.input_jacobian)

    def jacobian(self) -> tuple[Any, Any]:
        """Results, shape (rows, n), and their Jacobian by the unknowns, shape (rows * n, unknowns), point by point."""
        v, F = self.points.local, self.points.results
        J = ca.jacobian(F, v)
        values, entries = ca.Function("J", [v], [F, _column(J)]).map(self.points.n)(self.points.stacked)
        return values, self._block(J, entries) @ self.input_jacobian

    def hessian(self, factors: Any, first: bool) -> tuple[Any, Any, Any]:
        """(Results, their Jacobian, half Hessian of the results weighted by `factors`); the Hessian is half + half'.

        Results and Jacobian are as of `jacobian` if `first`, else empty. `factors` has shape (rows, n).
        """
        v, F = self.points.local, self.points.results
        weight = ca.SX.sym("weight", F.numel())
        H = ca.triu(ca.hessian(ca.dot(weight, F), v)[0])
        for k in range(v.numel()):
            if H.sparsity().has_nz(k, k):
                H[k, k] = H[k, k] / 2
        J = ca.jacobian(F, v) if first else ca.SX(F.numel(), v.numel())
        outputs = [F if first else ca.SX(0, 1), _column(J), _column(H)]
        function = ca.Function("H", [v, weight], outputs)
        values, slopes, curves = function.map(self.points.n)(self.points.stacked, factors)
        half = self.input_jacobian.T @ self._block(H, curves) @ self.input_jacobian
        return values, self._block(J, slopes) @ self.input_jacobian, half

    def _block(self, one: Any, entries: Any) -> Any:
        """Block diagonal matrix with the pattern of `one` for every point, and nonzeros `entries`, shape (nnz, n)."""
        pattern = ca.diagcat(*[one.sparsity()] * self.points.n)
        return ca.MX(pattern, ca.vec(entries)) if one.nnz() else ca.MX(*pattern.shape)


def derivatives(x: Any, f: Any, g: Any, points: Sequence[Points]) -> Derivatives:
    """Derivatives by x of the objective f and the constraints g, which contain the symbols of the results at points."""
    p = ca.MX.sym("p", 0)
    groups = _groups(x, [one for one in points if one.rows])
    value, slope = _jacobian(x, f, groups)
    rows, jacobian = _jacobian(x, g, groups)
    return Derivatives(
        ca.Function("nlp_grad_f", [x, p], [value, ca.densify(slope.T)], ["x", "p"], ["f", "grad_f_x"]),
        ca.Function("nlp_jac_g", [x, p], [rows, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        _hessian(x, p, (f, g), groups),
    )


def _groups(x: Any, points: Sequence[Points]) -> list[_Group]:
    """Groups of points; one coloring serves the Jacobians of all arguments by x."""
    if not points:
        return []
    columns = [ca.vec(one.stacked) for one in points]
    borders = np.cumsum([0, *(c.numel() for c in columns)]).tolist()
    input_jacobian = ca.vertsplit(ca.evalf(ca.jacobian(ca.vertcat(*columns), x)), borders)
    return [_Group(one, part) for one, part in zip(points, input_jacobian, strict=True)]


def _jacobian(x: Any, expression: Any, groups: Sequence[_Group]) -> tuple[Any, Any]:
    """An expression and its Jacobian by x."""
    used = [one for one in (group.only(expression) for group in groups) if one.points.rows]
    (outer,), y = _with_result_column([expression], used)
    slope = ca.jacobian(outer, ca.veccat(x, y))
    if not used:
        return outer, slope
    found = [group.jacobian() for group in used]
    D, values = ca.vertcat(*(d for _, d in found)), ca.vertcat(*(ca.vec(v) for v, _ in found))
    n = x.numel()
    value, by_x, by_y = ca.Function("outer", [x, y], [outer, slope[:, :n], slope[:, n:]])(x, values)
    return value, by_x + by_y @ D


def _hessian(x: Any, p: Any, both: tuple[Any, Any], groups: Sequence[_Group]) -> Any:
    """The function `(x, p, lam_f, lam_g) -> triu` of the Hessian of the Lagrange function."""
    n = x.numel()
    (f, g), y = _with_result_column(both, groups)
    factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    arguments = [x, y, factor, multipliers]
    second, slope = ca.hessian(factor * f + ca.dot(multipliers, g), ca.veccat(x, y))
    across, among = second[:n, n:], second[n:, n:]
    need = bool(across.nnz() or among.nnz())
    # if the Lagrange function is linear in y, its slopes do not depend on y, whose values are then not needed
    at = ca.vertcat(*(ca.vec(one.points.values()) for one in groups)) if among.nnz() else ca.DM.zeros(y.numel())
    factors = ca.Function("slope", arguments, [slope[n:]])(x, at, factor, multipliers)
    curved, slopes, values, first = ca.MX(n, n), [], [], 0
    for group in groups:
        count = group.points.results.numel() * group.points.n
        found, D, half = group.hessian(ca.reshape(factors[first : first + count], -1, group.points.n), need)
        first += count
        curved = curved + half + half.T
        slopes.append(D)
        values.append(ca.vec(found))
    at = ca.vertcat(*values) if need else ca.DM.zeros(y.numel())
    own, across, among = ca.Function("second", arguments, [second[:n, :n], across, among])(x, at, factor, multipliers)
    H = own + curved
    if need:
        D = ca.vertcat(*slopes)
        mixed = across @ D
        H = H + mixed + mixed.T + D.T @ (among @ D)
    names = ["x", "p", "lam_f", "lam_g"]
    return ca.Function("nlp_hess_l", [x, p, factor, multipliers], [ca.triu(H)], names, ["triu_hess_gamma_x_x"])


def _with_result_column(expressions: Sequence[Any], groups: Sequence[_Group]) -> tuple[list[Any], Any]:
    """(Expressions with the symbols of all results replaced by parts of one column, this column)."""
    sizes = [group.points.results.numel() * group.points.n for group in groups]
    y, first = ca.MX.sym("y", sum(sizes)), 0
    symbols, pieces = [], []
    for group, size in zip(groups, sizes, strict=True):
        symbols += group.points.symbols
        pieces += group.points.split(ca.reshape(y[first : first + size], -1, group.points.n))
        first += size
    return (list(ca.substitute(list(expressions), symbols, pieces)) if symbols else list(expressions)), y


def _column(matrix: Any) -> Any:
    """Structural nonzeros of a sparse matrix, as a column."""
    return matrix.nz[:] if matrix.nnz() else ca.SX(0, 1)
