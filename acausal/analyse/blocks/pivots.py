"""Pivots of one, two or three equations, solved by Cramer's rule, which divides by their determinant only."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from acausal.flatten.pool import Pool
from acausal.numeric.evaluate import Samples

_CANCELLED = 1e-6  # smallest ratio of a determinant to the sum of the magnitudes of its terms


def keeps_sign(samples: Samples) -> bool:
    """Whether a sampled quantity, shape (K,), has one sign and stays away from zero; nan and inf are ignored."""
    samples = samples[np.isfinite(samples)]
    if len(samples) < 4:
        return False
    low, high = np.abs(samples).min(), np.abs(samples).max()
    return bool(((samples > 0).all() or (samples < 0).all()) and low > 1e-6 * high)


def may_lose_digits(pool: Pool, divisor: int, lone: bool) -> bool:
    """Whether quotients by this pivot may consist of rounding errors for other values of its parameters.

    A `lone` pivot has no other entry in its row, or none in its column. No coefficient is divided by it then and kept,
    so that elimination stays backward stable whatever its size (N. J. Higham, Accuracy and Stability of Numerical
    Algorithms, 2002, theorem 9.3: the error is bounded by |L||U|, here the coefficients themselves). It loses digits
    only if it is a difference that cancels.
    """
    nodes = pool.nodes
    if nodes[divisor][0] == "const":
        return False
    return not lone or any(nodes[n][0] in ("add", "sub") for n in pool.reachable([divisor]))


class Pivot:
    """A square set of rows solved for as many variables."""

    def __init__(
        self, pool: Pool, rows: tuple[int, ...], variables: tuple[int, ...], entries: Sequence[dict[int, int]]
    ) -> None:
        self.pool, self.rows, self.variables = pool, rows, variables
        self.entries = [[row.get(v, pool.zero) for v in variables] for row in entries]
        n = len(rows)
        self.cofactors = [[self._cofactor(i, k) for k in range(n)] for i in range(n)] if n > 1 else [[pool.one]]
        first = (pool.mul(a, c) for a, c in zip(self.entries[0], self.cofactors[0], strict=True))
        self.determinant = pool.sum(first)

    def factors(self, coefficients: Sequence[int]) -> list[int]:
        """Factors of the pivot rows that eliminate the pivot variables from a row with these `coefficients`."""
        pool = self.pool
        if len(coefficients) == 1:
            # A pivot is never zero, so equal coefficients cancel exactly.
            if coefficients[0] == self.determinant:
                return [pool.one]
            if coefficients[0] == pool.neg(self.determinant):
                return [pool.neg(pool.one)]
        return [
            pool.div(pool.sum(pool.mul(t, c) for t, c in zip(coefficients, row, strict=True)), self.determinant)
            for row in self.cofactors
        ]

    def solved(self, totals: Sequence[int]) -> list[int]:
        """Solutions for the pivot variables; `totals` are the rows without the terms of these variables."""
        pool = self.pool
        columns = zip(*self.cofactors, strict=True)
        sums = (pool.sum(pool.mul(c, t) for c, t in zip(column, totals, strict=True)) for column in columns)
        return [pool.div(pool.neg(total), self.determinant) for total in sums]

    def _cofactor(self, i: int, k: int) -> int:
        pool = self.pool
        rest = [[e for c, e in enumerate(row) if c != k] for r, row in enumerate(self.entries) if r != i]
        if len(rest) == 1:
            minor = rest[0][0]
        else:
            (a, b), (c, d) = rest
            minor = pool.sub(pool.mul(a, d), pool.mul(b, c))
        return pool.neg(minor) if (i + k) % 2 else minor


def determinant(entries: Sequence[Sequence[Samples]]) -> tuple[Samples, Samples]:
    """(Determinant, sum of the magnitudes of its terms) at the sample points, shape (K,) each."""
    total, size = np.zeros_like(entries[0][0]), np.zeros_like(entries[0][0])
    for order in permutations(range(len(entries))):
        swaps = sum(order[a] > order[b] for b in range(len(order)) for a in range(b))
        term = np.prod([row[k] for row, k in zip(entries, order, strict=True)], axis=0)
        total = total + (-term if swaps % 2 else term)
        size = size + np.abs(term)
    return total, size


def is_safe(total: Samples, size: Samples) -> bool:
    """Whether a determinant keeps its sign and is more than the rounding errors of terms that cancel."""
    return keeps_sign(total) and bool(np.nanmin(np.abs(total) / size) > _CANCELLED)


def safe_pairs(first: Sequence[Samples], second: Sequence[Samples]) -> list[tuple[int, int]]:
    """Pairs of columns of two rows whose determinant is safe; vectorised, because most pairs are unsafe."""
    a, b = np.array(first), np.array(second)
    with np.errstate(all="ignore"):
        products = a[:, None, :] * b[None, :, :]
        swapped = products.transpose(1, 0, 2)
        total = products - swapped
        one_sign = ((total > 0) | ~np.isfinite(total)).all(axis=2) | ((total < 0) | ~np.isfinite(total)).all(axis=2)
        likely = np.triu(one_sign, 1)
        return [
            (int(k), int(m))
            for k, m in zip(*np.nonzero(likely), strict=True)
            if is_safe(total[k, m], np.abs(products[k, m]) + np.abs(swapped[k, m]))
        ]
