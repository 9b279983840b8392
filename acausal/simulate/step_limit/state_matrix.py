"""The matrix of the linearised states at points of a run, algebraic variables eliminated, and its eigenvalues."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from acausal.arrays import Complex, Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.equations.calls.buffered import rows

LARGEST_DENSE = 400
"""Beyond so many states only the fastest eigenvalues are computed."""
FEW = 12
"""How many then."""


@dataclass(frozen=True, eq=False)
class StateMatrix:
    """d(rates)/d(states) of a compiled model with given parameters and inputs.

    Algebraic variables follow the states by the implicit function theorem. Integrals of time that act on nothing and
    discrete variables are left out: their eigenvalues are zero.
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

    @cached_property
    def _derivatives(self) -> Any:
        if self.compiled not in _made:
            s = Symbols(self.compiled)
            ode, alg = self.compiled.rhs(*s.inputs)
            n = self.size
            along = ca.vertcat(s.t, s.x)
            parts = [ca.jacobian(f, v) for f in (ode[:n], alg) for v in (s.x[:n], s.z)]
            speed = ca.vertcat(1, ode)
            rates = [ca.densify(ode[:n]), *(ca.densify(ca.jtimes(f, along, speed)) for f in (ode[:n], alg))]
            _made[self.compiled] = ca.Function("derivatives", s.inputs, [*parts, *rates])
        return _made[self.compiled]

    def _at(self, t: float, x: Vector, z: Vector, m: Vector) -> list[Any]:
        return list(self._derivatives(t, x, z, self.u, self.p, m))

    def at(self, t: float, x: Vector, z: Vector, m: Vector) -> Vector | None:
        """The matrix [1/s], shape (n, n); None where the algebraic variables are not determined or not finite."""
        fx, fz, gx, gz, *_ = (np.array(part) for part in self._at(t, x, z, m))
        try:
            matrix = fx - fz @ np.linalg.solve(gz, gx) if gz.size else fx
        except np.linalg.LinAlgError:
            return None
        return np.asarray(matrix, dtype=float) if np.isfinite(matrix).all() else None

    @property
    def inert(self) -> bool:
        """Whether all eigenvalues are zero whatever the numbers: states that integrate others, without a loop."""
        if self.compiled not in _inert:
            fx, fz, gx, _, *_ = (self._derivatives.sparsity_out(k) for k in range(4))
            whole = fx
            if len(self.compiled.algebraic):
                rows = sorted(set(fz.row()))
                columns = [c for c in range(gx.size2()) if gx.colind()[c + 1] > gx.colind()[c]]
                whole = fx + ca.Sparsity.rowcol(rows, columns, self.size, self.size)
            loops, *_ = whole.scc() if whole.nnz() else (0, [], [])
            diagonal = whole.get_diag()[0].nnz() if whole.nnz() else 0
            _inert[self.compiled] = whole.nnz() == 0 or (diagonal == 0 and loops == self.size)
        return _inert[self.compiled]

    def spectra(self, times: Vector, x: Vector, z: Vector, m: Vector) -> Complex:
        """Eigenvalues [1/s] at many points, shape (points, size), nan where there are none; columns are points.

        For small systems: one call of compiled loops for all points.
        """
        n, nz = self.size, len(self.compiled.algebraic)
        flat = rows(self._packed, (times[:, None], x.T, z.T, self.u, self.p, m.T))
        ends = np.cumsum([n * n, n * nz, nz * n])
        fx, fz, gx, gz = (
            part.reshape(len(times), columns, count).transpose(0, 2, 1)
            for part, (count, columns) in zip(
                np.split(flat, ends, axis=1), ((n, n), (n, nz), (nz, n), (nz, nz)), strict=True
            )
        )
        found = np.full((len(times), n), np.nan, dtype=complex)
        good = np.asarray(np.isfinite(flat).all(axis=1), dtype=bool)
        if nz:
            good = good & (np.abs(np.linalg.det(np.where(good[:, None, None], gz, 0.0))) > 0.0)
            fx = fx.copy()
            fx[good] -= fz[good] @ np.linalg.solve(gz[good], gx[good])
        good = good & np.isfinite(fx).all(axis=(1, 2))
        found[good] = np.linalg.eigvals(fx[good])
        return found

    @property
    def _packed(self) -> Any:
        """All four parts as one dense column, for calls on NumPy's memory."""
        if self.compiled not in _columns:
            s = Symbols(self.compiled)
            parts = self._derivatives(*s.inputs)[:4]
            column = ca.vertcat(*(ca.vec(ca.densify(part)) for part in parts))
            _columns[self.compiled] = ca.Function("packed", s.inputs, [column])
        return _columns[self.compiled]

    def regularity(self, t: float, x: Vector, z: Vector, m: Vector) -> tuple[float, float]:
        """How well the algebraic variables are determined: reciprocal condition and sign of the determinant.

        (1, 1) without algebraic variables, and where there are too many to look.
        """
        if not 0 < len(self.compiled.algebraic) <= LARGEST_DENSE:
            return 1.0, 1.0
        slope = np.array(self._at(t, x, z, m)[3]) * self.compiled.nominal_z
        size = np.abs(slope).max(axis=1, keepdims=True)
        if not np.isfinite(slope).all() or not size.all():
            return 0.0, 0.0
        slope = slope / size
        return float(1.0 / np.linalg.cond(slope)), float(np.linalg.slogdet(slope)[0])

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
        begin = np.cos(np.arange(1.0, self.size + 1.0))  # a fixed start, so that a run gives the same twice
        try:
            search: Any = eigs
            return np.asarray(search(linear, k=FEW, which="LM", return_eigenvectors=False, v0=begin, tol=1e-6))
        except ArpackError as error:
            found = getattr(error, "eigenvalues", None)
            return np.asarray(found, dtype=complex) if found is not None and len(found) else None


# The derivatives of a model do not depend on the run; symbolic work of milliseconds.
_made: WeakKeyDictionary[CompiledModel, Any] = WeakKeyDictionary()
_columns: WeakKeyDictionary[CompiledModel, Any] = WeakKeyDictionary()
_inert: WeakKeyDictionary[CompiledModel, bool] = WeakKeyDictionary()
