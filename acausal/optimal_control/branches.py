"""Piecewise operations (`if_else`, minima, maxima, absolute values, relations) per phase: fixed, smoothed or relaxed.

Phases end where branches change, so within a phase each branch is fixed, and the equations are smooth, as an
interior-point method needs. Only branches that differ between phases are fixed. Others stay as the model has them, are
smoothed on request, or are relaxed: a selector in [0, 1] becomes an unknown of the program, coupled by complementarity
to the quantity whose sign decides the branch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Truth, Vector

# The condition on the operands that decides each operation.
_CONDITIONS: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b: a <= b,
    ca.OP_FMAX: lambda a, b: a >= b,
    ca.OP_FABS: lambda a: a >= 0,
    ca.OP_SIGN: lambda a: a > 0,
    ca.OP_LT: lambda a, b: a < b,
    ca.OP_LE: lambda a, b: a <= b,
    ca.OP_EQ: lambda a, b: a == b,
    ca.OP_NE: lambda a, b: a != b,
}
# The quantity that is zero where the branch changes.
_DIFFERENCES: Mapping[int, Callable[..., Any]] = {
    **{op: (lambda a, b: a - b) for op in _CONDITIONS},
    ca.OP_FABS: lambda a: a,
    ca.OP_SIGN: lambda a: a,
}
# Values of each operation: (if the condition holds, otherwise).
_VALUES: Mapping[int, tuple[Callable[..., Any], Callable[..., Any]]] = {
    ca.OP_FMIN: (lambda a, b: a, lambda a, b: b),
    ca.OP_FMAX: (lambda a, b: a, lambda a, b: b),
    ca.OP_FABS: (lambda a: a, lambda a: -a),
    ca.OP_SIGN: (lambda a: ca.SX(1), lambda a: ca.SX(-1)),
    **{op: (lambda a, b: ca.SX(1), lambda a, b: ca.SX(0)) for op in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)},
}


_CHOICE = ca.OP_IF_ELSE_ZERO
# Smooth approximations of width e: hyperbolas for kinks, tanh for steps.
_SMOOTHED: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b, e: (a + b - ca.sqrt((a - b) ** 2 + e**2)) / 2,
    ca.OP_FMAX: lambda a, b, e: (a + b + ca.sqrt((a - b) ** 2 + e**2)) / 2,
    ca.OP_FABS: lambda a, e: ca.sqrt(a**2 + e**2),
    ca.OP_SIGN: lambda a, e: ca.tanh(a / e),
    ca.OP_LT: lambda a, b, e: (1 + ca.tanh((b - a) / e)) / 2,
    ca.OP_LE: lambda a, b, e: (1 + ca.tanh((b - a) / e)) / 2,
}
# Boolean operations continued to truth values in [0, 1].
_RELAXED_LOGIC: Mapping[int, Callable[..., Any]] = {
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_AND: lambda a, b: a * b,
    ca.OP_OR: lambda a, b: a + b - a * b,
    _CHOICE: lambda a, b: a * b,
}
# Each operation with a selector y, which is 1 where the difference is positive.
_BY_SELECTOR: Mapping[int, Callable[..., Any]] = {
    ca.OP_FMIN: lambda a, b, y: b + y * (a - b),
    ca.OP_FMAX: lambda a, b, y: b + y * (a - b),
    ca.OP_FABS: lambda a, y: (2 * y - 1) * a,
    ca.OP_SIGN: lambda a, y: 2 * y - 1,
    ca.OP_LT: lambda a, b, y: y,
    ca.OP_LE: lambda a, b, y: y,
}
# Sign of the difference for which the condition holds, where it is not +1.
_SIGNS: Mapping[int, int] = {ca.OP_FMIN: -1, ca.OP_LT: -1, ca.OP_LE: -1}
# A branch is smoothed if at least this fraction of the instants of a guess is on each side: fewer belong to the ends of
# a phase.
_OFTEN = 0.1

Widths = Mapping[int, float]


def specialize_branches(
    function: Any,
    points: Sequence[Sequence[Vector]],
    beyond: Sequence[Sequence[Vector]] = (),
    widths: Sequence[Widths] = (),
) -> list[Any]:
    """The SX function specialised for each phase: branches that differ between phases are fixed.

    `points`: for each phase the arguments at n instants inside it, each of shape (rows, n).
    `beyond`: the same for the run of the guess after the last phase.
    `widths`: for each phase the widths of smoothed branches, by their numbers; 0 leaves a branch as the model has it.
    """
    source = _Operations.of(function)
    conditions = None if source is None else _branch_function(source, _CONDITIONS)
    if source is None or conditions is None or (len(points) + len(beyond) < 2 and not any(widths)):
        return [function for _ in points]
    truths = [_evaluated(conditions, columns) > 0.5 for columns in (*points, *beyond)]
    uniform = np.array([a.all(axis=1) | ~a.any(axis=1) for a in truths])
    first = np.array([a[:, 0] for a in truths])
    decided = uniform & (first != first[0]).any(axis=0)
    phase_widths = [*widths, *({} for _ in range(len(points) - len(widths)))]
    return [_specialize(source, decided[k], first[k], phase_widths[k]) for k in range(len(points))]


def relax_branches(function: Any, points: Sequence[Sequence[Vector]], number: int, sizes: Widths) -> Any:
    """The function of phase `number` with the selectors of some branches as a further argument, a column.

    A further result holds the quantities that decide these branches, scaled, and positive where the condition holds.
    Branches that differ between phases are fixed as in `specialize_branches`.

    `points`: for each phase the arguments at n instants inside it, each of shape (rows, n).
    `sizes`: magnitudes of the deciding quantities, by the numbers of their branches; 0 leaves a branch as it is.
    """
    source = _Operations.of(function)
    assert source is not None, "branches were found in it"
    conditions = _branch_function(source, _CONDITIONS)
    truths = [_evaluated(conditions, columns) > 0.5 for columns in points]
    uniform = np.array([a.all(axis=1) | ~a.any(axis=1) for a in truths])
    first = np.array([a[:, 0] for a in truths])
    decided = uniform & (first != first[0]).any(axis=0)
    chosen = {k: size for k, size in sizes.items() if size > 0.0}
    selectors: list[Any] = []
    deciding: list[Any] = []

    def replacement(k: int, op: int, operands: list[Any]) -> Any:
        if op not in _BY_SELECTOR:
            return None
        difference = _SIGNS.get(op, 1) * _DIFFERENCES[op](*operands)
        deciding.append(difference / chosen[k])
        selectors.append(ca.SX.sym("y"))
        return _BY_SELECTOR[op](*operands, selectors[-1])

    arguments, outputs = _replace_branches(source, decided[number], first[number], chosen, replacement)
    names = [*function.name_in(), "selectors"], [*function.name_out(), "deciding"]
    columns = (ca.vertcat(ca.SX(0, 1), *v) for v in (selectors, deciding))
    return ca.Function(function.name(), [*arguments, next(columns)], [*outputs, next(columns)], *names)


def switching_branches(function: Any, points: Sequence[Vector], smooth: float, often: bool = False) -> dict[int, float]:
    """Smoothing widths of the branches taken both ways at n instants, by their numbers.

    `points`: arguments of the function, each of shape (rows, n).
    `smooth`: width relative to the largest magnitude of the quantity that decides the branch.
    `often`: whether to ignore branches that differ at few instants only.
    """
    source = _Operations.of(function)
    differences = None if source is None else _branch_function(source, _DIFFERENCES)
    if differences is None:
        return {}
    values = _evaluated(differences, points)
    size = np.nanmax(np.abs(values), axis=1, initial=0.0)
    # the sign of rounding errors is meaningless
    sides = [(side * values > 1e-9 * size[:, None]).mean(axis=1) for side in (1.0, -1.0)]
    has_both_sides = np.minimum(*sides) > (_OFTEN if often else 0.0)
    return {int(k): float(smooth * size[k]) for k in np.flatnonzero(has_both_sides)}


def _evaluated(function: Any, columns: Sequence[Vector]) -> Vector:
    """Values at n instants, shape (rows, n)."""
    n = columns[0].shape[1]
    given = [ca.DM(c) if c.size else ca.DM(c.shape[0], n) for c in columns]
    return np.array(function.map(n)(*given))


@dataclass(frozen=True, eq=False)
class _Operations:
    """An SX function and its operations `(operation, inputs, outputs)`, read once because access is slow."""

    function: Any
    operations: list[tuple[int, list[int], list[int]]]

    @classmethod
    def of(cls, function: Any) -> _Operations | None:
        """None for a function that calls others, because it cannot be rebuilt from its operations: its kinks stay."""
        n = range(function.n_instructions())
        found = [(function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)) for k in n]
        return None if any(op == ca.OP_CALL for op, *_ in found) else cls(function, found)


def _branch_function(source: _Operations, forms: Mapping[int, Callable[..., Any]]) -> Any:
    """The function that evaluates `forms` of the operands of each branch; None without branches."""
    found: list[Any] = []

    def note(op: int, operands: list[Any]) -> Any:
        if op in forms:
            found.append(forms[op](*operands))
        return None

    arguments, _ = _rebuild(source, note)
    return ca.Function("branches", arguments, [ca.vertcat(*found)]) if found else None


def _specialize(source: _Operations, decided: Truth, truths: Truth, widths: Widths) -> Any:
    """The function with the branches `decided` fixed, and those in `widths` smoothed."""

    def replacement(k: int, op: int, operands: list[Any]) -> Any:
        if widths[k] == 0.0 or op not in _SMOOTHED:
            return None
        return _SMOOTHED[op](*operands, widths[k])

    arguments, outputs = _replace_branches(source, decided, truths, widths, replacement)
    function = source.function
    return ca.Function(function.name(), arguments, outputs, function.name_in(), function.name_out())


def _replace_branches(
    source: _Operations,
    decided: Truth,
    truths: Truth,
    chosen: Widths,
    replacement: Callable[[int, int, list[Any]], Any],
) -> tuple[list[Any], list[Any]]:
    """(Arguments, outputs) with the branches `decided` fixed.

    Those `chosen` are replaced by the result of `replacement(number, operation, operands)` unless it is None.
    """
    number = iter(range(len(decided)))
    soft: set[int] = set()  # hashes of expressions of truth values in [0, 1]

    def change(op: int, operands: list[Any]) -> Any:
        if op not in _CONDITIONS:
            return softened(op, operands)
        k = next(number)
        if k in chosen:
            found = replacement(k, op, operands)
            if found is not None and op in (ca.OP_LT, ca.OP_LE):
                soft.add(found.element_hash())
            return found
        return _VALUES[op][0 if truths[k] else 1](*operands) if decided[k] else None

    def softened(op: int, operands: list[Any]) -> Any:
        if op not in _RELAXED_LOGIC or not any(o.element_hash() in soft for o in operands[: 1 if op == _CHOICE else 2]):
            return None
        found = _RELAXED_LOGIC[op](*operands)
        if op != _CHOICE:
            soft.add(found.element_hash())
        return found

    return _rebuild(source, change)


def _rebuild(source: _Operations, branch: Callable[[int, list[Any]], Any]) -> tuple[list[Any], list[Any]]:
    """(Arguments, outputs) of the function rebuilt; an expression returned by `branch` replaces an operation."""
    function = source.function
    arguments = [ca.SX.sym(function.name_in(k), function.sparsity_in(k)) for k in range(function.n_in())]
    given = [ca.vertsplit(ca.vec(ca.densify(a))) if a.numel() else [] for a in arguments]
    outputs = [[ca.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    work: dict[int, Any] = {}
    for k, (op, inputs, target) in enumerate(source.operations):
        if op == ca.OP_INPUT:
            work[target[0]] = given[inputs[0]][inputs[1]]
        elif op == ca.OP_CONST:
            work[target[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[inputs[0]]
        else:
            operands = [work[i] for i in inputs]
            other = branch(op, operands)
            work[target[0]] = _apply(op, operands) if other is None else other
    shaped = []
    for k, entries in enumerate(outputs):
        column = ca.vertcat(*entries) if entries else ca.SX(0, 1)
        shaped.append(ca.SX(function.sparsity_out(k), column) if entries else ca.SX(*function.size_out(k)))
    return arguments, shaped


def _apply(op: int, operands: list[Any]) -> Any:
    """The SX expression of an operation."""
    if len(operands) == 1:
        return ca.SX.unary(op, operands[0])
    return ca.SX.binary(op, *operands)
