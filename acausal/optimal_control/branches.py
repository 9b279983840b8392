"""Branches that a phase takes throughout, put in place of `if_else`, minima, maxima, absolute values and relations.

Phases end where branches change. Within one, what such a branch computes is smooth, and an interior-point method meets
no kink. Only branches that differ between phases are put in place: all others stay as the model has them, or are
rounded where that is asked for, or freed: their answer becomes a number between 0 and 1 that the program chooses, bound
to what decides it by complementarity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Truth, Vector

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
# What is zero where the answer changes.
_DIFFERENCES: Mapping[int, Callable[..., Any]] = {
    **{op: (lambda a, b: a - b) for op in _QUESTIONS},
    ca.OP_FABS: lambda a: a,
    ca.OP_SIGN: lambda a: a,
}
# What it is when the answer is yes, and when it is no.
_ANSWERS: Mapping[int, tuple[Callable[..., Any], Callable[..., Any]]] = {
    ca.OP_FMIN: (lambda a, b: a, lambda a, b: b),
    ca.OP_FMAX: (lambda a, b: a, lambda a, b: b),
    ca.OP_FABS: (lambda a: a, lambda a: -a),
    ca.OP_SIGN: (lambda a: ca.SX(1), lambda a: ca.SX(-1)),
    **{op: (lambda a, b: ca.SX(1), lambda a, b: ca.SX(0)) for op in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)},
}


_CHOICE = ca.OP_IF_ELSE_ZERO
# Rounded forms of a width e: hyperbolas, and a step between 0 and 1 of an exponential tail.
_ROUNDED: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b, e: (a + b - ca.sqrt((a - b) ** 2 + e**2)) / 2,
    ca.OP_FMAX: lambda a, b, e: (a + b + ca.sqrt((a - b) ** 2 + e**2)) / 2,
    ca.OP_FABS: lambda a, e: ca.sqrt(a**2 + e**2),
    ca.OP_SIGN: lambda a, e: ca.tanh(a / e),
    ca.OP_LT: lambda a, b, e: (1 + ca.tanh((b - a) / e)) / 2,
    ca.OP_LE: lambda a, b, e: (1 + ca.tanh((b - a) / e)) / 2,
}
# What is made of truths between 0 and 1.
_SOFT: Mapping[int, Callable[..., Any]] = {
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_AND: lambda a, b: a * b,
    ca.OP_OR: lambda a, b: a + b - a * b,
    _CHOICE: lambda a, b: a * b,
}
# A freed branch by its answer, 1 where its difference is positive.
_FREED: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b, y: b + y * (a - b),
    ca.OP_FMAX: lambda a, b, y: b + y * (a - b),
    ca.OP_FABS: lambda a, y: (2 * y - 1) * a,
    ca.OP_SIGN: lambda a, y: 2 * y - 1,
    ca.OP_LT: lambda a, b, y: y,
    ca.OP_LE: lambda a, b, y: y,
}
# By what sign of the difference of the operands the answer is yes.
_SENSE: Mapping[int, int] = {ca.OP_FMIN: -1, ca.OP_LT: -1, ca.OP_LE: -1}
# Share of the instants of a guess that a branch must be off for to be rounded: what is beside an end is not.
_OFTEN = 0.1

Widths = Mapping[int, float]


def branched(
    function: Any,
    points: Sequence[Sequence[Vector]],
    beyond: Sequence[Sequence[Vector]] = (),
    widths: Sequence[Widths] = (),
) -> list[Any]:
    """An SX function once for each phase, with the branches that differ between phases as they are there.

    `points`: For each phase the arguments at n instants inside of it, each of shape (rows, n).
    `beyond`: The same of what comes behind the last phase, where the run behind the guess goes on.
    `widths`: For each phase, of the branches that are rounded the width by number; 0 leaves one as the model has it.
    """
    listed = _Listed.of(function)
    questions = None if listed is None else _questions(listed, _QUESTIONS)
    if listed is None or questions is None or (len(points) + len(beyond) < 2 and not any(widths)):
        return [function for _ in points]
    answers = [_evaluated(questions, columns) > 0.5 for columns in (*points, *beyond)]
    uniform = np.array([a.all(axis=1) | ~a.any(axis=1) for a in answers])
    first = np.array([a[:, 0] for a in answers])
    decided = uniform & (first != first[0]).any(axis=0)
    own = [*widths, *({} for _ in range(len(points) - len(widths)))]
    return [_with(listed, decided[k], first[k], own[k]) for k in range(len(points))]


def freed(function: Any, points: Sequence[Sequence[Vector]], number: int, sizes: Widths) -> Any:
    """The function of phase `number` with the answers of some branches as a further argument, a column.

    A further result is what decides each of them, divided by its size and positive where the answer is yes. Branches
    that differ between phases are put in place as by `branched`.
    """
    listed = _Listed.of(function)
    assert listed is not None, "branches were found in it"
    questions = _questions(listed, _QUESTIONS)
    answers = [_evaluated(questions, columns) > 0.5 for columns in points]
    uniform = np.array([a.all(axis=1) | ~a.any(axis=1) for a in answers])
    first = np.array([a[:, 0] for a in answers])
    decided = uniform & (first != first[0]).any(axis=0)
    chosen = {k: size for k, size in sizes.items() if size > 0.0}
    free: list[Any] = []
    deciding: list[Any] = []

    def instead(k: int, op: int, operands: list[Any]) -> Any:
        if op not in _FREED:
            return None
        difference = _SENSE.get(op, 1) * _DIFFERENCES[op](*operands)
        deciding.append(difference / chosen[k])
        free.append(ca.SX.sym("y"))
        return _FREED[op](*operands, free[-1])

    arguments, outputs = _rebuilt(listed, decided[number], first[number], chosen, instead)
    names = [*function.name_in(), "answers"], [*function.name_out(), "deciding"]
    columns = (ca.vertcat(ca.SX(0, 1), *v) for v in (free, deciding))
    return ca.Function(function.name(), [*arguments, next(columns)], [*outputs, next(columns)], *names)


def crossed(function: Any, points: Sequence[Vector], smooth: float, often: bool = False) -> dict[int, float]:
    """Branches that go both ways at n instants, by number, with the widths to round them.

    `points`: Arguments of the function, each of shape (rows, n).
    `smooth`: Widths by the largest magnitude of what changes its sign there.
    `often`: Whether those do not count that differ at few instants only.
    """
    listed = _Listed.of(function)
    differences = None if listed is None else _questions(listed, _DIFFERENCES)
    if differences is None:
        return {}
    values = _evaluated(differences, points)
    size = np.nanmax(np.abs(values), axis=1, initial=0.0)
    # what is left of rounding has no sign
    sides = [(side * values > 1e-9 * size[:, None]).mean(axis=1) for side in (1.0, -1.0)]
    both = np.minimum(*sides) > (_OFTEN if often else 0.0)
    return {int(k): float(smooth * size[k]) for k in np.flatnonzero(both)}


def _evaluated(function: Any, columns: Sequence[Vector]) -> Vector:
    """Values at n instants, shape (rows, n)."""
    n = columns[0].shape[1]
    given = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in columns]
    return np.array(function.map(n)(*given))


@dataclass(frozen=True, eq=False)
class _Listed:
    """An SX function and its operations, `(operation, inputs, outputs)`, asked for once."""

    function: Any
    operations: list[tuple[int, list[int], list[int]]]

    @classmethod
    def of(cls, function: Any) -> _Listed | None:
        """None for functions with calls of others, which cannot be built anew: their kinks stay."""
        n = range(function.n_instructions())
        found = [(function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)) for k in n]
        return None if any(op == ca.OP_CALL for op, *_ in found) else cls(function, found)


def _questions(listed: _Listed, forms: Mapping[int, Callable[..., Any]]) -> Any:
    """The function that gives these forms of the operands of each branch; None where there is none."""
    found: list[Any] = []

    def note(op: int, operands: list[Any]) -> Any:
        if op in forms:
            found.append(forms[op](*operands))
        return None

    arguments, _ = _walked(listed, note)
    return ca.Function("questions", arguments, [ca.vertcat(*found)]) if found else None


def _with(listed: _Listed, decided: Truth, answers: Truth, widths: Widths) -> Any:
    """The function with some of its branches decided, and some rounded."""

    def instead(k: int, op: int, operands: list[Any]) -> Any:
        if widths[k] == 0.0 or op not in _ROUNDED:
            return None
        return _ROUNDED[op](*operands, widths[k])

    arguments, outputs = _rebuilt(listed, decided, answers, widths, instead)
    function = listed.function
    return ca.Function(function.name(), arguments, outputs, function.name_in(), function.name_out())


def _rebuilt(
    listed: _Listed, decided: Truth, answers: Truth, chosen: Widths, instead: Callable[[int, int, list[Any]], Any]
) -> tuple[list[Any], list[Any]]:
    """Arguments and outputs with some branches decided, and others replaced; None leaves one as it is."""
    number = iter(range(len(decided)))
    soft: set[int] = set()  # truths between 0 and 1

    def change(op: int, operands: list[Any]) -> Any:
        if op not in _QUESTIONS:
            return softened(op, operands)
        k = next(number)
        if k in chosen:
            found = instead(k, op, operands)
            if found is not None and op in (ca.OP_LT, ca.OP_LE):
                soft.add(found.element_hash())
            return found
        return _ANSWERS[op][0 if answers[k] else 1](*operands) if decided[k] else None

    def softened(op: int, operands: list[Any]) -> Any:
        if op not in _SOFT or not any(o.element_hash() in soft for o in operands[: 1 if op == _CHOICE else 2]):
            return None
        found = _SOFT[op](*operands)
        if op != _CHOICE:
            soft.add(found.element_hash())
        return found

    return _walked(listed, change)


def _walked(listed: _Listed, branch: Callable[[int, list[Any]], Any]) -> tuple[list[Any], list[Any]]:
    """Arguments and outputs of a function built anew; `branch` may give something else for an operation."""
    function = listed.function
    arguments = [ca.SX.sym(function.name_in(k), function.sparsity_in(k)) for k in range(function.n_in())]
    given = [ca.vertsplit(ca.vec(ca.densify(a))) if a.numel() else [] for a in arguments]
    outputs = [[ca.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    work: dict[int, Any] = {}
    for k, (op, inputs, target) in enumerate(listed.operations):
        if op == ca.OP_INPUT:
            work[target[0]] = given[inputs[0]][inputs[1]]
        elif op == ca.OP_CONST:
            work[target[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[inputs[0]]
        else:
            operands = [work[i] for i in inputs]
            other = branch(op, operands)
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
