"""The matrix of the linearised state equations at points of a run, without algebraic variables; its eigenvalues."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Complex, Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import rows

LARGEST_DENSE = 400
"""For more states than this, only the fastest eigenvalues are computed."""
FEW = 12
"""Number of eigenvalues that are computed then."""


@dataclass(frozen=True, eq=False)
class StateMatrix:
    """d(rates)/d(states) of a compiled model with given parameters and inputs.

    Algebraic variables are eliminated by the implicit function theorem. Quadratures and discrete variables are left
    out, as their eigenvalues are zero.
    """

    compiled: CompiledModel
    p: Vector
    u: Vector

    @property
    def size(self) -> int:
        """Number of states of the coupled system."""
        return self.compiled.n_dynamic

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these states."""
        return self.compiled.states[: self.size]

    def _at(self, t: float, x: Vector, z: Vector, m: Vector) -> list[Any]:
        return list(_derivatives(self.compiled)(t, x, z, self.u, self.p, m))

    def at(self, t: float, x: Vector, z: Vector, m: Vector) -> Vector | None:
        """The matrix [1/s], shape (n, n); None where algebraic variables are not determined, or entries not finite."""
        fx, fz, gx, gz, *_ = (np.array(part) for part in self._at(t, x, z, m))
        try:
            matrix = fx - fz @ np.linalg.solve(gz, gx) if gz.size else fx
        except np.linalg.LinAlgError:
            return None
        return np.asarray(matrix, dtype=float) if np.isfinite(matrix).all() else None

    @property
    def inert(self) -> bool:
        """Whether the structure makes all eigenvalues zero: states integrate other states, without a loop."""
        return _is_inert(self.compiled)

    def spectra(self, times: Vector, x: Vector, z: Vector, m: Vector) -> Complex:
        """Eigenvalues [1/s] at many points, the columns of x, z and m; shape (points, size), nan where `at` is None.

        For small systems this is one call of compiled loops for all points.
        """
        n, nz = self.size, len(self.compiled.algebraic)
        flat = rows(_packed(self.compiled), (times[:, None], x.T, z.T, self.u, self.p, m.T))
        ends = np.cumsum([n * n, n * nz, nz * n])
        fx, fz, gx, gz = (
            part.reshape(len(times), columns, count).transpose(0, 2, 1)
            for part, (count, columns) in zip(
                np.split(flat, ends, axis=1), ((n, n), (n, nz), (nz, n), (nz, nz)), strict=True
            )
        )
        eigenvalues = np.full((len(times), n), np.nan, dtype=complex)
        valid = np.asarray(np.isfinite(flat).all(axis=1), dtype=bool)
        if nz:
            valid = valid & (np.abs(np.linalg.det(np.where(valid[:, None, None], gz, 0.0))) > 0.0)
            fx = fx.copy()
            fx[valid] -= fz[valid] @ np.linalg.solve(gz[valid], gx[valid])
        valid = valid & np.isfinite(fx).all(axis=(1, 2))
        eigenvalues[valid] = np.linalg.eigvals(fx[valid])
        return eigenvalues

    def regularity(self, t: float, x: Vector, z: Vector, m: Vector) -> tuple[float, float]:
        """How well the algebraic variables are determined: reciprocal condition number, and sign of the determinant.

        (1, 1) without algebraic variables, or with too many to compute it.
        """
        if not 0 < len(self.compiled.algebraic) <= LARGEST_DENSE:
            return 1.0, 1.0
        jacobian = np.array(self._at(t, x, z, m)[3]) * self.compiled.nominal_z
        size = np.abs(jacobian).max(axis=1, keepdims=True)
        if not np.isfinite(jacobian).all() or not size.all():
            return 0.0, 0.0
        jacobian = jacobian / size
        return float(1.0 / np.linalg.cond(jacobian)), float(np.linalg.slogdet(jacobian)[0])

    def rates(self, t: float, x: Vector, z: Vector, m: Vector) -> tuple[Vector, Vector]:
        """First and second time derivatives of the states along the solution, shape (n,) each."""
        _, fz, _, gz, f, ft, gt = (np.array(part) for part in self._at(t, x, z, m))
        if gz.size:
            try:
                ft = ft - fz @ np.linalg.solve(gz, gt)
            except np.linalg.LinAlgError:
                ft = np.full_like(f, np.nan)
        return f.ravel(), ft.ravel()

    def eigenvalues(self, t: float, x: Vector, z: Vector, m: Vector) -> Complex | None:
        """Eigenvalues [1/s] at a point, all of them or the fastest of a large system; None as in `at`."""
        if self.size == 0:
            return np.zeros(0, dtype=complex)
        if self.size > LARGEST_DENSE:
            return self._fastest(t, x, z, m)
        matrix = self.at(t, x, z, m)
        return None if matrix is None else np.asarray(np.linalg.eigvals(matrix), dtype=complex)

    def _fastest(self, t: float, x: Vector, z: Vector, m: Vector) -> Complex | None:
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import ArpackError, LinearOperator, eigs, splu

        fx, fz, gx, gz = (csc_matrix(part.sparse()) for part in self._at(t, x, z, m)[:4])
        if not all(np.isfinite(part.data).all() for part in (fx, fz, gx, gz)):
            return None
        try:
            solve = splu(gz).solve if len(self.compiled.algebraic) else None
        except RuntimeError:
            return None

        def apply(v: Vector) -> Vector:
            follows = fz @ solve(gx @ v) if solve is not None else 0.0
            return np.asarray(fx @ v - follows)

        operator: Any = LinearOperator  # scipy's overloads confuse type checkers
        linear = operator((self.size, self.size), matvec=apply, dtype=float)
        begin = np.cos(np.arange(1.0, self.size + 1.0))  # a fixed start, so that results are reproducible
        try:
            search: Any = eigs
            return np.asarray(search(linear, k=FEW, which="LM", return_eigenvectors=False, v0=begin, tol=1e-6))
        except ArpackError as error:
            converged = getattr(error, "eigenvalues", None)
            return np.asarray(converged, dtype=complex) if converged is not None and len(converged) else None


@once_per_owner
def _derivatives(compiled: CompiledModel) -> Any:
    """`(t, x, z, u, p, m) -> (fx, fz, gx, gz, rates, their derivative along the solution, that of the residuals)`."""
    s = Symbols(compiled)
    ode, alg = compiled.rhs(*s.inputs)
    n = compiled.n_dynamic
    along = ca.vertcat(s.t, s.x)
    parts = [ca.jacobian(f, v) for f in (ode[:n], alg) for v in (s.x[:n], s.z)]
    speed = ca.vertcat(1, ode)
    rates = [ca.densify(ode[:n]), *(ca.densify(ca.jtimes(f, along, speed)) for f in (ode[:n], alg))]
    return ca.Function("derivatives", s.inputs, [*parts, *rates])


@once_per_owner
def _packed(compiled: CompiledModel) -> Any:
    """The first four of `_derivatives` as one dense column, for calls on NumPy memory."""
    s = Symbols(compiled)
    parts = _derivatives(compiled)(*s.inputs)[:4]
    return ca.Function("packed", s.inputs, [ca.vertcat(*(ca.vec(ca.densify(part)) for part in parts))])


@once_per_owner
def _is_inert(compiled: CompiledModel) -> bool:
    """See `StateMatrix.inert`."""
    n = compiled.n_dynamic
    fx, fz, gx, _, *_ = (_derivatives(compiled).sparsity_out(k) for k in range(4))
    dependence = fx
    if len(compiled.algebraic):
        rows = sorted(set(fz.row()))
        columns = [c for c in range(gx.size2()) if gx.colind()[c + 1] > gx.colind()[c]]
        dependence = fx + ca.Sparsity.rowcol(rows, columns, n, n)
    loops, *_ = dependence.scc() if dependence.nnz() else (0, [], [])
    diagonal = dependence.get_diag()[0].nnz() if dependence.nnz() else 0
    return bool(dependence.nnz() == 0 or (diagonal == 0 and loops == n))
