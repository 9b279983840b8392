"""Linear blocks solved symbolically: sparse Gaussian elimination with pivots that cannot vanish.

The order is Markowitz's (fewest fill-in), the pivots are restricted to coefficients that are constant, depend on
parameters only, or keep their sign at all sample points. On the flat equations of a tree-structured mechanism this
recovers the recursion of the articulated-body algorithm, linear in the number of bodies; tearing to a dense core does
not. What has no safe pivot is left over, for the DAE solver.

Source: H. M. Markowitz, The elimination form of the inverse, Management Science 3 (1957) 255-269;
R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 7.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acausal.flatten.pool import Pool
from acausal.lower.samples import SamplePoints

_PENALTY = (0.0, 0.2, 0.6, 2.0)  # added to Markowitz's count: a division by a constant is cheaper and safer


@dataclass(frozen=True)
class Eliminated:
    """Result of an elimination.

    `solved` lists (variable, node) in the order of evaluation; `left_variables` have no safe pivot, they must make
    `left_residuals` zero. `empty` holds positions of rows in which nothing is left, with the node that must be zero.
    """

    solved: tuple[tuple[int, int], ...]
    left_variables: tuple[int, ...]
    left_residuals: tuple[int, ...]
    empty: tuple[tuple[int, int], ...]


def safety(points: SamplePoints, coefficient: int) -> int | None:
    """0 for +-1, 1 for constants, 2 for parameter expressions, 3 for what keeps its sign; None when not safe."""
    pool = points.reduced.pool
    node = pool.nodes[coefficient]
    if node[0] == "const":
        return None if node[1] == 0.0 else 0 if abs(node[1]) == 1.0 else 1
    varies = points.varies(coefficient)
    found = points.of(coefficient)
    found = found[np.isfinite(found)]
    if not varies:
        return 2 if len(found) and found[0] != 0.0 else None
    if len(found) < 4:
        return None
    low, high = np.abs(found).min(), np.abs(found).max()
    same_sign = (found > 0).all() or (found < 0).all()
    return 3 if same_sign and low > 1e-6 * high else None


def eliminate(points: SamplePoints, rows: Sequence[dict[int, int]], rests: Sequence[int]) -> Eliminated:
    """Solve `sum(rows[i][v] * v) + rests[i] == 0` for all v."""
    work = _Work(points, rows, rests)
    work.run()
    return work.result()


class _Work:
    def __init__(self, points: SamplePoints, rows: Sequence[dict[int, int]], rests: Sequence[int]) -> None:
        self.points = points
        self.pool: Pool = points.reduced.pool
        self.rows = [{v: c for v, c in row.items() if c != self.pool.zero} for row in rows]
        self.rests = list(rests)
        self.columns: dict[int, set[int]] = {}
        for i, row in enumerate(self.rows):
            for v in row:
                self.columns.setdefault(v, set()).add(i)
        self.variables = set().union(*rows) if rows else set()
        self.active = set(range(len(self.rows)))
        self.pivots: list[tuple[int, int]] = []
        self._safety: dict[int, int | None] = {}
        self.heap: list[tuple[float, int, int, int]] = []
        for i, row in enumerate(self.rows):
            for v, c in row.items():
                self._offer(i, v, c)

    def _cost(self, i: int, v: int, c: int) -> float | None:
        if c not in self._safety:
            self._safety[c] = safety(self.points, c)
        rank = self._safety[c]
        if rank is None:
            return None
        return (len(self.rows[i]) - 1) * (len(self.columns[v]) - 1) + _PENALTY[rank]

    def _offer(self, i: int, v: int, c: int) -> None:
        cost = self._cost(i, v, c)
        if cost is not None:
            heapq.heappush(self.heap, (cost, i, v, c))

    def run(self) -> None:
        while self.heap:
            cost, i, v, c = heapq.heappop(self.heap)
            if i not in self.active or self.rows[i].get(v) != c or v not in self.columns:
                continue
            now = self._cost(i, v, c)
            if now is None:
                continue
            if now > cost:
                heapq.heappush(self.heap, (now, i, v, c))
                continue
            self._pivot(i, v)

    def _pivot(self, i: int, v: int) -> None:
        pool = self.pool
        row = self.rows[i]
        pivot = row[v]
        self.active.discard(i)
        self.pivots.append((i, v))
        for w in row:
            self.columns[w].discard(i)
        for j in list(self.columns.pop(v)):
            other = self.rows[j]
            factor = pool.div(other.pop(v), pivot)
            for w, c in row.items():
                if w == v:
                    continue
                new = pool.sub(other.get(w, pool.zero), pool.mul(factor, c))
                if new == pool.zero:
                    if other.pop(w, None) is not None:
                        self.columns[w].discard(j)
                else:
                    other[w] = new
                    self.columns[w].add(j)
                    self._offer(j, w, new)
            self.rests[j] = pool.sub(self.rests[j], pool.mul(factor, self.rests[i]))
            for w, c in other.items():
                if w not in row:
                    self._offer(j, w, c)

    def result(self) -> Eliminated:
        pool = self.pool
        solved = []
        for i, v in reversed(self.pivots):
            row = self.rows[i]
            total = self.rests[i]
            for w, c in row.items():
                if w != v:
                    total = pool.add(total, pool.mul(c, pool.var(w)))
            solved.append((v, pool.div(pool.neg(total), row[v])))
        done = {v for _, v in self.pivots}
        left = [i for i in sorted(self.active) if self.rows[i]]
        residuals = []
        for i in left:
            total = self.rests[i]
            for w, c in self.rows[i].items():
                total = pool.add(total, pool.mul(c, pool.var(w)))
            residuals.append(total)
        empty = [(i, self.rests[i]) for i in sorted(self.active) if not self.rows[i]]
        return Eliminated(tuple(solved), tuple(sorted(self.variables - done)), tuple(residuals), tuple(empty))
