"""Choice of the cheapest factorisation, and order of variables, for the Newton matrices of a multistep method.

CasADi has a sparse QR that orders the columns by minimum degree of A'A, and CSparse's LU, which keeps their order. QR
is twice as fast on bands and chains. LU is faster where QR causes much fill-in: on grids, or with an equation in many
variables (a row of n entries alone adds n^2/2 entries to R). LU in the order in which a model declares its states can
be a hundred times slower than either: two fields of 400 cells, one declared after the other, are a band of 800. So the
fill-in of both is counted, that of LU after ordering by minimum degree of A + A'. Source: T. A. Davis, Direct Methods
for Sparse Linear Systems (2006), chapters 5 to 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

Order = NDArray[np.int64]

# Up to this many unknowns QR is used without comparison.
FEW = 60
# Nanoseconds per operation and per entry, measured on chains, stacked fields, grids, arrows and dense matrices.
_QR, _LU = (1.2, 5.5), (3.0, 27.0)
# Factor on the cost of LU with algebraic equations, whose diagonal may be zero: pivoting then adds uncounted fill-in.
_PIVOTING = 3.0


@dataclass(frozen=True, eq=False)
class Factorisation:
    """The order of states and of algebraic variables for CSparse's LU."""

    x: Order
    z: Order

    def settings(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """The options of an integrator, with those that have a number for each variable put in this order."""
        reordered = {**settings, "linear_solver": "csparse"}
        if "init_xdot" in reordered:
            reordered["init_xdot"] = np.array(reordered["init_xdot"])[self.x].tolist()
        if "abstolv" in reordered:
            reordered["abstolv"] = np.array(reordered["abstolv"])[[*self.x, *(len(self.x) + self.z)]].tolist()
        return reordered

    def there(self, x: Vector, z: Vector) -> tuple[Vector, Vector]:
        """Put states and algebraic variables, shapes (nx,) and (nz,), in this order."""
        return x[self.x], z[self.z]

    def back(self, x: Vector, z: Vector) -> tuple[Vector, Vector]:
        """Put rows over time, shapes (n, nx) and (n, nz), back in the order of the model."""
        return x[:, np.argsort(self.x)], z[:, np.argsort(self.z)] if z.size else z


def factorisation(pattern: Any, n: int) -> Factorisation | None:
    """The cheapest factorisation of a square pattern whose first `n` unknowns are states; None stands for QR."""
    size = pattern.size1()
    if size <= FEW:
        return None
    symmetric = ca.Sparsity.diag(size) + pattern + pattern.T
    _, order = symmetric.ldl(True)
    positions = np.array(order, dtype=np.int64)
    x, z = positions[positions < n], positions[positions >= n]
    lu_order = np.concatenate([x, z]).tolist()
    lower, _ = symmetric.sub(lu_order, lu_order)[0].ldl(False)
    lu = _LU[0] * float((_counts(lower) ** 2).sum()) + _LU[1] * 2.0 * lower.nnz()
    lu *= _PIVOTING if size > n else 1.0
    longest = float(np.bincount(np.array(pattern.row(), dtype=np.int64), minlength=size).max())
    if lu < _QR[1] * longest**2 / 2.0 or lu < _cost_of_qr(pattern):
        return Factorisation(x, z - n)
    return None


def _cost_of_qr(pattern: Any) -> float:
    """Cost of a QR factorisation [ns], in which each column k of V and row k of R form an outer product."""
    v, r, *_ = pattern.qr_sparse()
    entries = np.diff(np.array(v.colind(), dtype=np.int64))
    rows = _counts(r)[: len(entries)]
    return _QR[0] * 2.0 * float((entries * rows).sum()) + _QR[1] * float(v.nnz() + r.nnz())


def _counts(pattern: Any) -> NDArray[np.int64]:
    """Number of entries in each row."""
    return np.bincount(np.array(pattern.row(), dtype=np.int64), minlength=pattern.size1())
