"""Which factorisation, and which order of the variables, is cheapest for the Newton matrices of a multistep method.

CasADi has a sparse QR that orders the columns by minimum degree of A'A, and CSparse's LU, which takes them as they
come. QR is twice as fast on bands and chains, LU where QR fills up: grids, or one equation that holds many variables
(the row of n entries alone makes n^2/2 of R). LU in the order in which a model happens to declare its states can be a
hundred times slower than either: two fields of 400 cells, one behind the other, are a band of 800. So what either
fills is counted, LU's after ordering by minimum degree of A + A'. Source: T. A. Davis, Direct Methods for Sparse
Linear Systems (2006), chapters 5 to 7.
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

# Unknowns up to which nothing is counted.
FEW = 60
# Nanoseconds of an operation and of an entry, measured on chains, stacked fields, grids, arrows and dense matrices.
_QR, _LU = (1.2, 5.5), (3.0, 27.0)
# LU picks its pivots; with equations that have none on the diagonal it fills more than is counted.
_DOUBT = 3.0


@dataclass(frozen=True, eq=False)
class Factorisation:
    """The orders of states and algebraic variables for CSparse's LU."""

    x: Order
    z: Order

    def settings(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """An integrator's options: those that hold a number for each variable in the order that is used."""
        found = {**settings, "linear_solver": "csparse"}
        if "init_xdot" in found:
            found["init_xdot"] = np.array(found["init_xdot"])[self.x].tolist()
        if "abstolv" in found:
            found["abstolv"] = np.array(found["abstolv"])[[*self.x, *(len(self.x) + self.z)]].tolist()
        return found

    def there(self, x: Vector, z: Vector) -> tuple[Vector, Vector]:
        """A point in the order that is used."""
        return x[self.x], z[self.z]

    def back(self, x: Vector, z: Vector) -> tuple[Vector, Vector]:
        """Rows over time in the order of the model."""
        return x[:, np.argsort(self.x)], z[:, np.argsort(self.z)] if z.size else z


def factorisation(pattern: Any, n: int) -> Factorisation | None:
    """The cheapest one of a square matrix with this pattern, whose first `n` unknowns are states; None is plain QR."""
    size = pattern.size1()
    if size <= FEW:
        return None
    whole = ca.Sparsity.diag(size) + pattern + pattern.T
    _, order = whole.ldl(True)
    place = np.array(order, dtype=np.int64)
    x, z = place[place < n], place[place >= n]
    together = np.concatenate([x, z]).tolist()
    lower, _ = whole.sub(together, together)[0].ldl(False)
    lu = _LU[0] * float((_counts(lower) ** 2).sum()) + _LU[1] * 2.0 * lower.nnz()
    lu *= _DOUBT if size > n else 1.0
    longest = float(np.bincount(np.array(pattern.row(), dtype=np.int64), minlength=size).max())
    if lu < _QR[1] * longest**2 / 2.0 or lu < _cost_of_qr(pattern):
        return Factorisation(x, z - n)
    return None


def _cost_of_qr(pattern: Any) -> float:
    """Nanoseconds; column k of V and row k of R are an outer product."""
    v, r, *_ = pattern.qr_sparse()
    entries = np.diff(np.array(v.colind(), dtype=np.int64))
    rows = _counts(r)[: len(entries)]
    return _QR[0] * 2.0 * float((entries * rows).sum()) + _QR[1] * float(v.nnz() + r.nnz())


def _counts(pattern: Any) -> NDArray[np.int64]:
    """Entries of each row."""
    return np.bincount(np.array(pattern.row(), dtype=np.int64), minlength=pattern.size1())
