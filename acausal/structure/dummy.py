"""Choice of states after index reduction: the method of dummy derivatives.

Source: S. E. Mattsson, G. Söderlind, Index reduction in differential-algebraic equations using dummy derivatives,
SIAM J. Sci. Comput. 14 (1993) 677-692. The column choice is greedy over classes of preference (rather not a state
first), which is optimal because independent column sets form a matroid; within a class the column that keeps the
selected matrix best conditioned is taken, not the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.structure.blt import Block

Jacobian = Callable[[Sequence[int], Sequence[int]], NDArray[np.float64]]


@dataclass(frozen=True)
class Choice:
    """One selection: of `candidates` the `dummies` became algebraic through `equations`.

    `condition` is the ratio of the smallest to the largest pivot at the start point; near 0 the static choice is bad.
    `deficient` holds equations that are dependent on the others, for whatever columns.
    """

    equations: tuple[int, ...]
    candidates: tuple[int, ...]
    dummies: tuple[int, ...]
    condition: float
    deficient: tuple[int, ...] = ()


def select_dummies(
    blocks: Iterable[Block],
    equation_integral: Mapping[int, int],
    variable_integral: Mapping[int, int],
    jacobian: Jacobian,
    preference: Callable[[int], float],
    hidden: Callable[[int], Iterable[int]] = lambda equation: (),
) -> list[Choice]:
    """Dummy derivatives of every block, from the highest level down.

    Ranks are those of the integral of an equation by the integrals of the candidates. For equations differentiated by
    the chain rule that is the same as the derivative by the candidates themselves; where known rates stood in for the
    chain rule (an angular velocity for the derivative of a rotation matrix), it is the only one that is right.

    Parameters
    ----------
    blocks
        Blocks of the highest equations and highest derivatives, in any order.
    equation_integral, variable_integral
        What an equation, a variable, is the time derivative of.
    jacobian
        `jacobian(equations, variables)`: values, shape (2, m, n): at the start point, and at a generic point that
        decides about rank.
    preference
        Of the *integral* of a candidate: higher means rather a state.
    hidden
        Of a differentiated equation: derivatives of variables in its integral that do not stand in it, because known
        rates stood in for the chain rule (a joint's speed or a quaternion's rate behind an angular velocity).
    """
    choices: list[Choice] = []
    level = [
        _Group([e for e in b.rows if e in equation_integral], [v for v in b.columns if v in variable_integral])
        for b in blocks
    ]
    differentiated = set(variable_integral.values())
    while any(group.equations for group in level):
        level = _joined(level, equation_integral, differentiated, hidden)
        below = []
        for group in level:
            candidates = group.candidates
            if group.equations:
                values = jacobian(
                    [equation_integral[e] for e in group.equations], [variable_integral[v] for v in candidates]
                )
                choice = _choose(group.equations, candidates, values, lambda v: preference(variable_integral[v]))
                choices.append(choice)
                equations = [equation_integral[e] for e in group.equations]
                candidates = [variable_integral[v] for v in choice.dummies]
                below.append(
                    _Group(
                        [e for e in equations if e in equation_integral],
                        [v for v in candidates if v in variable_integral],
                    )
                )
        level = below
    return choices


@dataclass
class _Group:
    """Equations and candidates of one level between which the choice is made together."""

    equations: list[int]
    candidates: list[int]


def _joined(
    groups: list[_Group],
    equation_integral: Mapping[int, int],
    differentiated: set[int],
    hidden: Callable[[int], Iterable[int]],
) -> list[_Group]:
    """Groups joined where an undifferentiated constraint reaches, behind known rates, candidates of another group.

    A hidden derivative that is never differentiated itself becomes a candidate here: the rate of a coordinate whose
    own equation is not a constraint.
    """
    owner = {v: group for group in groups for v in group.candidates}
    for group in list(groups):
        for e in list(group.equations):
            if equation_integral[e] in equation_integral:
                continue  # not yet at the constraint itself
            for v in hidden(e):
                other = owner.get(v)
                if other is None and v not in differentiated:
                    group.candidates.append(v)
                    owner[v] = group
                elif other is not None and other is not group:
                    small, group = sorted((group, other), key=lambda g: len(g.candidates))
                    group.equations += small.equations
                    group.candidates += small.candidates
                    owner.update(dict.fromkeys(small.candidates, group))
                    small.equations, small.candidates = [], []
    return groups


def _choose(
    equations: list[int], candidates: list[int], values: NDArray[np.float64], preference: Callable[[int], float]
) -> Choice:
    start, generic = values[0].copy(), values[1].copy()
    for a in (start, generic):
        scale = np.abs(a).max(axis=1, keepdims=True, initial=0.0)
        a /= np.where(scale > 0, scale, 1.0)
    order = sorted(set(map(preference, candidates)))
    chosen: list[int] = []
    pivots: list[float] = []
    for level in order:
        group = [k for k, v in enumerate(candidates) if preference(v) == level]
        while len(chosen) < len(equations):
            at_start = np.linalg.norm(start[:, group], axis=0)
            in_general = np.linalg.norm(generic[:, group], axis=0)
            score = np.where(in_general > 1e-9, at_start + 1e-6 * in_general, 0.0)
            score[[i for i, k in enumerate(group) if k in chosen]] = 0.0
            best = int(np.argmax(score)) if len(group) else 0
            if not len(group) or score[best] <= 0.0:
                break
            k = group[best]
            chosen.append(k)
            pivots.append(float(at_start[best]))
            start, generic = _project(start, k), _project(generic, k)
    deficient: tuple[int, ...] = ()
    if len(chosen) < len(equations):
        left = np.linalg.norm(values[1] - _span(values[1], chosen), axis=1)
        deficient = tuple(e for _, e in sorted(zip(left, equations, strict=True)))[: len(equations) - len(chosen)]
    condition = min(pivots, default=1.0) / max(max(pivots, default=1.0), 1e-300)
    return Choice(tuple(equations), tuple(candidates), tuple(candidates[k] for k in chosen), condition, deficient)


def _project(a: NDArray[np.float64], column: int) -> NDArray[np.float64]:
    """Columns of `a` without their part along one of them."""
    direction = a[:, column]
    length = np.linalg.norm(direction)
    if length < 1e-12:
        return a
    q = direction / length
    return a - np.outer(q, q @ a)


def _span(a: NDArray[np.float64], columns: list[int]) -> NDArray[np.float64]:
    if not columns:
        return np.zeros_like(a)
    q, _ = np.linalg.qr(a[:, columns])
    projected: NDArray[np.float64] = q @ (q.T @ a)
    return projected
