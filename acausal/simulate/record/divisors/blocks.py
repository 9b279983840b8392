"""Determinants of diagonal blocks of the algebraic equations along a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.lower.diagonal_blocks import Place
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.problem import Problem

Rows = tuple[Vector, ...]
"""Times, states, algebraic variables and modes; columns are instants."""

_DENSE = 100  # largest block whose determinants are computed by a dense factorisation
_ENTRIES = 1_000_000  # most entries of Jacobians in memory at once


@dataclass(frozen=True, eq=False)
class Block:
    """Coupled algebraic equations: indices of their unknowns, and of the entries of their Jacobian."""

    columns: NDArray[np.intp]
    row: NDArray[np.intp]  # column by column
    column: NDArray[np.intp]

    def matrices(self, entries: Vector) -> Vector:
        """Jacobians, shape (n, size, size), from their entries, shape (n, entries)."""
        found = np.zeros((len(entries), len(self.columns), len(self.columns)))
        found[:, self.row, self.column] = entries
        return found

    def determinants(self, entries: Vector) -> tuple[Vector, Vector]:
        """Signs of the determinants, and logarithms of their magnitudes, shape (n,) each."""
        if len(self.columns) == 1:
            with np.errstate(divide="ignore"):
                return np.sign(entries[:, 0]), np.log(np.abs(entries[:, 0]))
        if len(self.columns) <= _DENSE:
            signs, sizes = np.linalg.slogdet(self.matrices(entries))
            return signs, sizes
        found = np.array([self._sparse(values) for values in entries])
        return found[:, 0], found[:, 1]

    def _sparse(self, values: Vector) -> tuple[float, float]:
        """Sign and logarithm for one Jacobian, by a sparse factorisation."""
        import scipy.sparse.linalg  # the import takes a tenth of a second, and only large blocks need it

        first = np.searchsorted(self.column, np.arange(len(self.columns) + 1))
        try:
            lu = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix((values, self.row, first)))
        except RuntimeError:  # singular
            return 0.0, -np.inf
        pivots = lu.U.diagonal()
        sign = _parity(lu.perm_r.tolist()) * _parity(lu.perm_c.tolist()) * np.prod(np.sign(pivots))
        return float(sign), float(np.log(np.abs(pivots)).sum())


def _parity(order: list[int]) -> int:
    """Sign of a permutation: 1 if it is even, -1 if it is odd."""
    sign = 1
    for k in range(len(order)):
        while order[k] != k:
            other = order[k]
            order[k], order[other], sign = order[other], other, -sign
    return sign


@dataclass(frozen=True, eq=False)
class Blocks:
    """Some diagonal blocks of the algebraic equations of a model."""

    blocks: tuple[Block, ...]
    slopes: BufferedFunction  # `(t, x, z, u, p, m) -> entries`, block by block, by unknowns in nominal magnitudes

    @classmethod
    def of(cls, compiled: CompiledModel, s: Symbols, slope: Any, places: Sequence[Place]) -> Blocks | None:
        """Those at some places of the Jacobian of the algebraic equations by their unknowns; None if there are none."""
        blocks, entries = [], []
        for equations, unknowns in places:
            pattern, own = slope.sparsity().sub(equations, unknowns, False)
            blocks.append(Block(*(np.array(v, dtype=np.intp) for v in (unknowns, *pattern.get_triplet()))))
            entries += own
        if not entries:
            return None
        scaled = (slope @ ca.diag(ca.DM(compiled.nominal_z))).nz[entries]
        return cls(tuple(blocks), BufferedFunction(ca.Function("slopes", s.inputs, [scaled])))

    def entries(self, problem: Problem, at: Rows) -> list[Vector]:
        """Entries of the Jacobian of each block, shape (n, entries)."""
        t, x, z, m = (np.ascontiguousarray(a.T) for a in at)
        found = self.slopes.many(t[:, None], x, z, problem.u, problem.p, m)
        found[~np.isfinite(found)] = 0.0
        return np.split(found, np.cumsum([len(b.row) for b in self.blocks])[:-1], axis=1)

    def determinants(self, problem: Problem, at: Rows) -> tuple[Vector, Vector]:
        """Signs of the determinants of all blocks, and logarithms of their magnitudes, shape (blocks, n) each."""
        largest = max(min(len(b.columns), _DENSE) ** 2 for b in self.blocks)
        many, parts = 1 + _ENTRIES // (largest + self.slopes.function.numel_out(0)), []
        for first in range(0, len(at[0]), many):
            entries = self.entries(problem, tuple(a[..., first : first + many] for a in at))
            parts.append(np.array([b.determinants(e) for b, e in zip(self.blocks, entries, strict=True)]))
        signs, sizes = np.concatenate(parts, axis=-1).swapaxes(0, 1)
        return signs, sizes
