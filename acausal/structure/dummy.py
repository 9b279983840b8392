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
) -> list[Choice]:
    """Dummy derivatives of every block, from the highest level down.

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
    """
    choices: list[Choice] = []
    for block in blocks:
        equations = [e for e in block.rows if e in equation_integral]
        candidates = [v for v in block.columns if v in variable_integral]
        while equations:
            choice = _choose(equations, candidates, jacobian, lambda v: preference(variable_integral[v]))
            choices.append(choice)
            equations = [equation_integral[e] for e in equations]
            equations = [e for e in equations if e in equation_integral]
            candidates = [variable_integral[v] for v in choice.dummies]
            candidates = [v for v in candidates if v in variable_integral]
    return choices


def _choose(
    equations: list[int], candidates: list[int], jacobian: Jacobian, preference: Callable[[int], float]
) -> Choice:
    values = jacobian(equations, candidates)
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
