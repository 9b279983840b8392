"""Branches that a phase takes throughout, put in place of `if_else`, minima, maxima, absolute values and relations.

Phases end where branches change. Within one, what such a branch computes is smooth, and an interior-point method meets
no kink. Only branches that differ between phases are put in place: all others stay as the model has them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Truth = NDArray[np.bool_]

# For each operation the question that decides it, by its operands.
_QUESTIONS: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b: a <= b,
    ca.OP_FMAX: lambda a, b: a >= b,
    ca.OP_FABS: lambda a: a >= 0,
    ca.OP_SIGN: lambda a: a > 0,
    ca.OP_LT: lambda a, b: a < b,
    ca.OP_LE: lambda a, b: a <= b,
    ca.OP_EQ: lambda a, b: a == b,
    ca.OP_NE: lambda a, b: a != b,
}
# What it is when the answer is yes, and when it is no.
_ANSWERS: Mapping[int, tuple[Callable[..., Any], Callable[..., Any]]] = {
    ca.OP_FMIN: (lambda a, b: a, lambda a, b: b),
    ca.OP_FMAX: (lambda a, b: a, lambda a, b: b),
    ca.OP_FABS: (lambda a: a, lambda a: -a),
    ca.OP_SIGN: (lambda a: ca.SX(1), lambda a: ca.SX(-1)),
    **{op: (lambda a, b: ca.SX(1), lambda a, b: ca.SX(0)) for op in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)},
}


def branched(function: Any, points: Sequence[Sequence[Vector]]) -> list[Any]:
    """An SX function once for each phase, with the branches that differ between phases as they are there.

    Parameters
    ----------
    points
        For each phase the arguments at n instants inside of it, each of shape (rows, n).
    """
    questions = _questions(function)
    if questions is None or len(points) < 2:
        return [function for _ in points]
    answers = [_asked(questions, columns) for columns in points]
    uniform = np.array([a.all(axis=1) | ~a.any(axis=1) for a in answers])
    first = np.array([a[:, 0] for a in answers])
    decided = uniform & (first != first[0]).any(axis=0)
    return [_with(function, decided[k], first[k]) for k in range(len(points))]


def _asked(questions: Any, columns: Sequence[Vector]) -> Truth:
    """The answers at n instants, shape (questions, n)."""
    n = columns[0].shape[1]
    given = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in columns]
    return np.array(questions.map(n)(*given)) > 0.5


def _questions(function: Any) -> Any:
    """The function that answers the question behind each branch; None where there is none."""
    if any(function.instruction_id(k) == ca.OP_CALL for k in range(function.n_instructions())):
        return None  # functions of others, which cannot be built anew: their kinks stay
    found: list[Any] = []

    def note(op: int, operands: list[Any]) -> Any:
        found.append(_QUESTIONS[op](*operands))
        return None

    arguments, _ = _walked(function, note)
    return ca.Function("questions", arguments, [ca.vertcat(*found)]) if found else None


def _with(function: Any, decided: Truth, answers: Truth) -> Any:
    """The function with some of its branches decided."""
    number = iter(range(len(decided)))

    def decide(op: int, operands: list[Any]) -> Any:
        k = next(number)
        return _ANSWERS[op][0 if answers[k] else 1](*operands) if decided[k] else None

    arguments, outputs = _walked(function, decide)
    return ca.Function(function.name(), arguments, outputs, function.name_in(), function.name_out())


def _walked(function: Any, branch: Callable[[int, list[Any]], Any]) -> tuple[list[Any], list[Any]]:
    """Arguments and outputs of a function built anew; `branch` may give something else for an operation."""
    arguments = [ca.SX.sym(function.name_in(k), function.sparsity_in(k)) for k in range(function.n_in())]
    given = [ca.vertsplit(ca.vec(ca.densify(a))) if a.numel() else [] for a in arguments]
    outputs = [[ca.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    work: dict[int, Any] = {}
    for k in range(function.n_instructions()):
        op, inputs, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = given[inputs[0]][inputs[1]]
        elif op == ca.OP_CONST:
            work[target[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[inputs[0]]
        else:
            operands = [work[i] for i in inputs]
            other = branch(op, operands) if op in _QUESTIONS else None
            work[target[0]] = _applied(op, operands) if other is None else other
    shaped = []
    for k, entries in enumerate(outputs):
        column = ca.vertcat(*entries) if entries else ca.SX(0, 1)
        shaped.append(ca.SX(function.sparsity_out(k), column) if entries else ca.SX(*function.size_out(k)))
    return arguments, shaped


def _applied(op: int, operands: list[Any]) -> Any:
    if len(operands) == 1:
        return ca.SX.unary(op, operands[0])
    return ca.SX.binary(op, *operands)
