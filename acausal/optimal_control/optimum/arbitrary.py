"""What a program leaves open: decided parameters without an effect, and states that measurements do not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.optimal_control.program.nlp import Solution
from acausal.optimal_control.program.points import insert_functions
from acausal.optimal_control.program.radau import Program

# Singular values below this fraction of the largest are zero, and so are components of null vectors.
_RANK, _PART = 1e-9, 1e-5


def arbitrary_note(program: Program, solution: Solution) -> tuple[str, ...]:
    """A note on decided parameters on which nothing depends at the solution.

    Where a parameter acts through truth values only, as the time of a switch does, all slopes are zero, and an interior
    point method moves it to the middle of its limits.
    """
    decided, nlp = program.problem.quantities.decided, program.nlp
    if not decided:
        return ()
    # the first unknowns and the first constraints are the decided parameters and their limits
    f, g = insert_functions([nlp.objective, nlp.g], nlp.points)
    slopes = ca.jacobian(ca.vertcat(f, g[len(decided) :]), ca.veccat(*nlp.unknowns[: len(decided)]))
    found = np.array(ca.Function("slopes", [nlp.x], [ca.densify(slopes)])(solution.x))
    names = program.problem.quantities.parameters.names
    free = [names[place] for k, (place, *_) in enumerate(decided) if not found[:, k].any()]
    if not free:
        return ()
    return (
        f"nothing changes with {', '.join(free)} near the solution, so that the value is arbitrary: leave it out, or, "
        "if it moves a switch, end a phase there: problem.phase(until=...)",
    )


def undetermined(program: Program, residuals: Sequence[Any], answer: Any) -> Callable[[Vector, Vector], list[int]]:
    """The function `(x, p)` that finds which results of `answer`, a function of the same, nothing determines.

    `residuals` are what an estimate minimizes the squares of. Unknowns along a null vector of their Jacobian and that
    of the equations are free.
    """
    nlp = program.nlp
    low, high = nlp.limits
    equations = nlp.g[np.flatnonzero(low == high).tolist()]
    rows = insert_functions([equations, ca.vertcat(*residuals)], nlp.points)
    slopes = ca.Function("slopes", [nlp.x, nlp.p], [ca.jacobian(ca.vertcat(*rows), nlp.x)])

    def find(x: Vector, p: Vector) -> list[int]:
        matrix = np.array(ca.densify(slopes(x, p)))
        length = np.linalg.norm(matrix, axis=1)
        _, sizes, directions = np.linalg.svd(matrix[length > 0.0] / length[length > 0.0, None], full_matrices=True)
        rank = int((sizes > _RANK * sizes[0]).sum()) if len(sizes) else 0
        results = [np.concatenate([np.array(v).ravel() for v in answer(x + d, p)]) for d in (0.0, *directions[rank:])]
        moved = np.abs(np.array(results[1:]) - results[0]).max(axis=0, initial=0.0) if len(results) > 1 else np.zeros(0)
        return np.flatnonzero(moved > _PART * max(float(moved.max(initial=0.0)), 1e-300)).tolist()

    return find
