"""The flat system as a matrix at one point: which unknowns are free, and which equations depend on each other.

A linear system with derivatives, E x' + A x = b, determines x if det(s E + A) is not zero for almost every s. Here
every derivative counts as s times its variable for one arbitrary number s, so that an ordinary matrix has the null
vectors of the whole system, of high index as well. As nothing has been eliminated, the names are those of the flat
system.

Source of the criterion: Brenan, Campbell, Petzold, Numerical Solution of Initial-Value Problems in
Differential-Algebraic Equations, SIAM 1996, section 2.3 (regular pencils).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.flatten.flat import FlatSystem
from acausal.numeric.evaluate import gradients, values

_RATE_FACTOR = 1.3
_MOST_DENSE = 800
_TINY = 1e-9

Vector = dict[int, float]


@dataclass(frozen=True, eq=False)
class Pencil:
    """Rows are flat equations, columns flat scalars."""

    flat: FlatSystem
    matrix: Any  # sparse, shape (equations, scalars); columns of the inputs of the model itself are empty
    rest: NDArray[np.float64]  # left minus right side with all unknowns zero, shape (equations,)
    # True for equations with a source: for generic parameters they are not homogeneous in the unknowns.
    prescribes: NDArray[np.bool_]

    def dependent(self) -> list[Vector]:
        """Combinations of equations in which every unknown cancels, the shortest first."""
        return self._null[0]

    def free(self) -> list[Vector]:
        """Directions in which the unknowns can move without violating any equation, the shortest first."""
        return self._null[1]

    @cached_property
    def _null(self) -> tuple[list[Vector], list[Vector]]:
        inputs = set(self.flat.inputs)
        columns = [k for k in range(self.flat.n_scalars) if k not in inputs]
        left, right = null_vectors(self.matrix[:, columns])
        return left, [{columns[k]: v for k, v in vector.items()} for vector in right]


def pencil(flat: FlatSystem) -> Pencil:
    """The matrix of a flat system at a generic point, with the actual parameters."""
    matrix = pencil_rows(flat, range(len(flat.equations)), flat.parameter_values)
    roots = [flat.pool.sub(e.left, e.right) for e in flat.equations]
    rest = _at_zero(flat, roots, {"par": flat.parameter_values.__getitem__, "time": lambda _: 0.37})
    generic = _at_zero(flat, roots, {"par": lambda k: 0.7 + 0.1 * (k % 7), "time": lambda _: 0.37})
    return Pencil(flat, matrix, rest, np.abs(generic) > _TINY)


def pencil_rows(flat: FlatSystem, equations: Sequence[int], parameters: Sequence[float], seed: int = 1) -> Any:
    """Some rows of the matrix for given values of the parameters; sparse, shape (len(equations), scalars).

    Other seeds give other points, which distinguishes linear equations from nonlinear ones.
    """
    pool = flat.pool
    roots = [pool.sub(flat.equations[i].left, flat.equations[i].right) for i in equations]
    random = np.random.default_rng(seed)
    point = 0.5 + random.random(pool.n_variables)
    leaves: dict[str, Callable[[int], Any]] = {
        "var": lambda k: point[k],
        "par": parameters.__getitem__,
        "time": lambda _: 0.37,
    }
    inputs = set(flat.inputs)
    rows: list[int] = []
    columns: list[int] = []
    entries: list[float] = []
    for i, gradient in enumerate(gradients(pool, roots, range(pool.n_variables), leaves)):
        for variable, slope in gradient.items():
            factor, base = 1.0, variable
            while base in pool.integral_of:
                factor, base = factor * _RATE_FACTOR, pool.integral_of[base]
            if base not in inputs and np.isfinite(slope):
                rows.append(i)
                columns.append(base)
                entries.append(factor * np.asarray(slope).item())  # external functions give arrays
    from scipy.sparse import csr_matrix

    return csr_matrix((entries, (rows, columns)), shape=(len(roots), flat.n_scalars))


def _at_zero(flat: FlatSystem, roots: list[int], leaves: Mapping[str, Any]) -> NDArray[np.float64]:
    inputs = set(flat.inputs)
    leaves_at_zero = {**leaves, "var": lambda k: 1.0 if k in inputs else 0.0}
    with np.errstate(all="ignore"):
        value_of = values(flat.pool, roots, leaves_at_zero)
    at_zero = np.array([float(value_of[r]) for r in roots], dtype=np.float64)
    return np.where(np.isfinite(at_zero), at_zero, 0.0)


def null_vectors(matrix: Any) -> tuple[list[Vector], list[Vector]]:
    """Left and right null vectors of a sparse matrix, each with few entries, as maps from index to entry."""
    m, n = matrix.shape
    if not m or not n:
        return ([{i: 1.0} for i in range(m)], [{k: 1.0} for k in range(n)])
    scaled, by_row, by_column = _equilibrated(matrix)
    left, right = _dense_null_space(scaled) if max(m, n) <= _MOST_DENSE else _sparse_null_space(scaled)
    return _sparsest(left * by_row), _sparsest(right * by_column)


def sparse_null_vectors(
    rows: NDArray[np.int64], columns: NDArray[np.int64], entries: NDArray[np.float64], n: int
) -> tuple[list[Vector], list[Vector]]:
    """Left and right null vectors of a large square matrix; a regular one costs one factorisation.

    The matrix, shape (n, n), is given by the positions and values of its entries, each of shape (n_entries,).
    """
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    matrix = csc_matrix((entries, (rows, columns)), shape=(n, n))
    try:
        pivots = np.abs(splu(csc_matrix(_equilibrated(matrix)[0])).U.diagonal())
        if pivots.min() > 1e-10 * pivots.max():
            return [], []
    except RuntimeError:  # exactly singular
        pass
    return null_vectors(matrix)


def _equilibrated(matrix: Any) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
    """(Matrix scaled so that the largest entry of every row and column is about one, row factors, column factors)."""
    by_row, by_column = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    from scipy.sparse import csr_matrix, diags

    scaled = csr_matrix(matrix)
    for _ in range(4):
        for axis in (1, 0):
            largest = np.asarray(abs(scaled).max(axis=axis).todense()).ravel()
            factor = 1.0 / np.sqrt(np.where(largest > 0.0, largest, 1.0))
            if axis:
                by_row *= factor
                scaled = diags(factor) @ scaled
            else:
                by_column *= factor
                scaled = scaled @ diags(factor)
    return csr_matrix(scaled), by_row, by_column


def _dense_null_space(scaled: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    u, s, vt = np.linalg.svd(scaled.toarray())
    rank = int(np.sum(s > 1e-10 * max(1.0, s[0])))
    return u[:, rank:].T, vt[rank:]


def _sparse_null_space(scaled: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inverse iteration on [[0, M], [M', 0]], whose null vectors are those of M' above those of M.

    A block of vectors finds several null vectors at once; a message does not need more than its width.
    """
    from scipy.sparse import bmat, eye
    from scipy.sparse.linalg import splu

    m, n = scaled.shape
    shift = 1e-9
    zero = eye(m) * shift, eye(n) * -shift
    factor = splu(bmat([[zero[0], scaled], [scaled.T, zero[1]]], format="csc"))
    block = np.random.default_rng(7).standard_normal((m + n, 6))
    for _ in range(4):
        block, _ = np.linalg.qr(factor.solve(block))
    null_spaces = []
    for part, matrix in ((block[:m], scaled.T), (block[m:], scaled)):
        u, s, _ = np.linalg.svd(part, full_matrices=False)
        basis = u[:, s > 1e-6]
        # Rayleigh-Ritz: select the directions that the matrix maps to zero.
        _, size, rotation = np.linalg.svd(matrix @ basis, full_matrices=False)
        null_spaces.append((basis @ rotation.T)[:, size < 1e-7].T)
    return null_spaces[0], null_spaces[1]


def _sparsest(basis: NDArray[np.float64]) -> list[Vector]:
    """Null vectors of which each has an entry that is zero in all others; small entries are dropped."""
    from scipy.linalg import qr

    if not len(basis):
        return []
    order: Any = qr(basis, pivoting=True, mode="economic")[-1]
    pivots = order[: len(basis)]
    vectors = []
    for row in np.linalg.solve(basis[:, pivots], basis):
        row = row / row[np.argmax(np.abs(row))]
        support = np.flatnonzero(np.abs(row) > 1e-7)
        vectors.append({int(k): float(row[k]) for k in support})
    return sorted(vectors, key=len)
