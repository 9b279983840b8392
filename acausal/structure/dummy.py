"""Choice of states after index reduction: dummy derivatives where a fixed choice is safe, else stabilisation.

Source: S. E. Mattsson, G. Söderlind, Index reduction in differential-algebraic equations using dummy derivatives,
SIAM J. Sci. Comput. 14 (1993) 677-692. Columns are chosen by sparse Gaussian elimination, least preferred states first,
and only with pivots that stay away from zero at all sample points; constant pivots come before varying ones.
Constraints without such a pivot (a pendulum in x and y, a closed loop of joints) keep all their variables as states;
the caller stabilises them (Baumgarte) instead of solving them for a dummy derivative.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.structure.blt import Block

Samples = NDArray[np.float64]
Rows = Callable[[Sequence[int], Sequence[int]], list[dict[int, Samples]]]

_SAFE = 0.02  # least ratio of the smallest to the largest size of a varying pivot; 1 + 0.9 cos(q) is still above it


@dataclass(frozen=True)
class Choice:
    """Dummy derivatives selected at one level of differentiation of one block.

    `dummies` of the `candidates` become algebraic, determined by as many of the `equations`. `floating` equations have
    no safe pivot, so that all their variables remain states; `deficient` equations depend linearly on the others. If
    `varies`, some pivots are not constant, and the selection is safe for the sampled parameter values only.
    """

    equations: tuple[int, ...]
    candidates: tuple[int, ...]
    dummies: tuple[int, ...]
    floating: tuple[int, ...] = ()
    deficient: tuple[int, ...] = ()
    varies: bool = False


def select_dummies(
    blocks: Iterable[Block],
    equation_integral: Mapping[int, int],
    variable_integral: Mapping[int, int],
    rows: Rows,
    preference: Callable[[int], float],
    hidden: Callable[[int], Iterable[int]] = lambda equation: (),
    near: Callable[[int], int | None] = lambda variable: None,
) -> list[Choice]:
    """Dummy derivatives of every block, from the highest level of differentiation down.

    The pivots are those of the Jacobian of the *integrals* of the equations with respect to the integrals of the
    candidates. For equations differentiated by the chain rule this equals the Jacobian with respect to the candidates
    themselves. Where a known rate replaces the chain rule (an angular velocity for the derivative of a rotation matrix)
    only the former is right.

    Parameters
    ----------
    blocks
        Blocks of the highest equations and highest derivatives, in any order.
    equation_integral, variable_integral
        Maps each differentiated equation (variable) to the one it is the time derivative of.
    rows
        `rows(equations, variables)`: sparse rows of the Jacobian, values of shape (K,) at K sample points; the first
        point is the start, the second one decides about rank.
    preference
        Rank of the *integral* of a candidate as a state: those with the highest rank remain states.
    hidden
        For a differentiated equation, derivatives of variables of its integral that do not occur in it, because a known
        rate replaced the chain rule (the speed of a joint, or the rate of a quaternion, instead of an angular
        velocity).
    near
        For the *integral* of a candidate, the number of points, from the first, at which its pivots must be safe; None
        for all.
    """
    choices: list[Choice] = []
    level = [
        _Group([e for e in b.rows if e in equation_integral], [v for v in b.columns if v in variable_integral])
        for b in blocks
    ]
    differentiated = set(variable_integral.values())
    while any(group.equations for group in level):
        level = _merge_groups(level, equation_integral, differentiated, hidden)
        next_level = []
        for group in level:
            candidates = group.candidates
            if group.equations:
                derivative_of_integral = {variable_integral[v]: v for v in candidates}
                jacobian = rows([equation_integral[e] for e in group.equations], list(derivative_of_integral))
                choice = _Elimination(jacobian, preference, near).choose(group.equations, derivative_of_integral)
                choices.append(choice)
                unsolved = {*choice.floating, *choice.deficient}
                equations = [equation_integral[e] for e in group.equations if e not in unsolved]
                candidates = [variable_integral[v] for v in choice.dummies]
                next_level.append(
                    _Group(
                        [e for e in equations if e in equation_integral],
                        [v for v in candidates if v in variable_integral],
                    )
                )
        level = next_level
    return choices


@dataclass
class _Group:
    """Equations and candidates of one level that are treated together."""

    equations: list[int]
    candidates: list[int]


def _merge_groups(
    groups: list[_Group],
    equation_integral: Mapping[int, int],
    differentiated: set[int],
    hidden: Callable[[int], Iterable[int]],
) -> list[_Group]:
    """Merge groups if a constraint, through a known rate, depends on a candidate of another group.

    A hidden derivative that is never differentiated itself becomes a candidate, for instance the rate of a coordinate
    whose own equation is not a constraint.
    """
    owner = {v: group for group in groups for v in group.candidates}
    for group in list(groups):
        for e in list(group.equations):
            if equation_integral[e] in equation_integral:
                continue  # the level of the constraint itself is not yet reached
            for v in hidden(e):
                other = owner.get(v)
                if other is None and v not in differentiated:
                    group.candidates.append(v)
                    owner[v] = group
                elif other is not None and other is not group:
                    smaller, group = sorted((group, other), key=lambda g: len(g.candidates))
                    group.equations += smaller.equations
                    group.candidates += smaller.candidates
                    owner.update(dict.fromkeys(smaller.candidates, group))
                    smaller.equations, smaller.candidates = [], []
    return groups


def _size(row: Mapping[int, Samples]) -> Samples:
    """Largest entry of a row at each sample point, shape (K,).

    Not the largest over all points, because with exponentials a row may differ by 30 orders of magnitude between two
    points. If a row vanishes at the start only, 1e-12 of its median size replaces zero.
    """
    if not row:
        return np.ones(2)
    sizes: Samples = np.max([np.nan_to_num(np.abs(a), posinf=0.0) for a in row.values()], axis=0)
    sizes[0] = max(sizes[0], 1e-12 * float(np.median(sizes)))
    return np.asarray(np.maximum(sizes, 1e-300))


class _Elimination:
    """Sparse Gaussian elimination on rows whose entries are sampled, shape (K,) each."""

    def __init__(
        self,
        rows: list[dict[int, Samples]],
        preference: Callable[[int], float],
        near: Callable[[int], int | None],
    ) -> None:
        self.rows = [{v: a for v, a in row.items() if np.any(a != 0.0)} for row in rows]
        self.size = [_size(row) for row in self.rows]
        self.columns: dict[int, set[int]] = {}
        self.preference, self.near = preference, near
        self.heap: list[tuple[float, int, float, int, int]] = []
        for i, row in enumerate(self.rows):
            for v in row:
                self.columns.setdefault(v, set()).add(i)
        for i, row in enumerate(self.rows):
            for v in row:
                self._offer(i, v)

    def _rank(self, i: int, v: int) -> int | None:
        """0 for a constant pivot, 1 for one that varies but keeps its sign and magnitude, None for an unsafe one."""
        pivot = self.rows[i][v][: self.near(v)]
        is_finite = np.isfinite(pivot)
        relative = np.abs(pivot[is_finite]) / self.size[i][: len(pivot)][is_finite]
        pivot = pivot[is_finite]
        if not len(pivot):
            return None
        low, high = np.abs(pivot).min(), np.abs(pivot).max()
        if relative.max() <= 1e-9 or not ((pivot > 0).all() or (pivot < 0).all()):
            return None
        if high - low <= 1e-9 * high:
            return 0
        return 1 if low > _SAFE * high else None

    def _offer(self, i: int, v: int) -> None:
        rank = self._rank(i, v)
        if rank is not None:
            cost = (len(self.rows[i]) - 1) * (len(self.columns[v]) - 1)
            largest = abs(self.rows[i][v][0]) / self.size[i][0]
            heapq.heappush(self.heap, (self.preference(v), rank, cost - min(largest, 1.0), i, v))

    def choose(self, equations: Sequence[int], candidates: Mapping[int, int]) -> Choice:
        """Use safe pivots as long as there are any; `candidates` maps each column to the variable that is returned."""
        active = set(range(len(self.rows)))
        dummies: list[int] = []
        varies = False
        while self.heap and active:
            _, rank, _, i, v = heapq.heappop(self.heap)
            if i not in active or v not in self.columns or v not in self.rows[i] or self._rank(i, v) != rank:
                continue
            active.discard(i)
            varies = varies or rank == 1
            dummies.append(candidates[v])
            self._eliminate(i, v)
        remaining = sorted(active)
        deficient = self._dependent(remaining)
        return Choice(
            tuple(equations),
            tuple(candidates.values()),
            tuple(dummies),
            tuple(equations[i] for i in remaining if i not in deficient),
            tuple(equations[i] for i in deficient),
            varies,
        )

    def _eliminate(self, i: int, v: int) -> None:
        row = self.rows[i]
        for w in row:
            self.columns[w].discard(i)
        for j in self.columns.pop(v):
            other = self.rows[j]
            with np.errstate(all="ignore"):
                factor = other.pop(v) / row[v]
                for w, a in row.items():
                    if w == v:
                        continue
                    new = other.get(w, 0.0) - factor * a
                    if np.nanmax(np.abs(new) / self.size[j], initial=0.0) <= 1e-12:
                        if other.pop(w, None) is not None:
                            self.columns[w].discard(j)
                    else:
                        other[w] = new
                        self.columns[w].add(j)
            for w in other:
                self._offer(j, w)

    def _dependent(self, remaining: Sequence[int]) -> list[int]:
        """Remaining rows that depend linearly on the others: Gram-Schmidt at the second sample point."""
        columns = sorted({v for i in remaining for v in self.rows[i]})
        column_of = {v: k for k, v in enumerate(columns)}
        basis: list[NDArray[np.float64]] = []
        dependent = []
        for i in remaining:
            row = np.zeros(len(columns))
            for v, a in self.rows[i].items():
                row[column_of[v]] = a[1]
            residual = np.nan_to_num(row) / self.size[i][1]
            for q in basis:
                residual = residual - q * (q @ residual)
            length = float(np.linalg.norm(residual))
            if length < 1e-9:
                dependent.append(i)
            else:
                basis.append(residual / length)
        return dependent
