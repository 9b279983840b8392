"""Bounds of a CasADi function over boxes of its inputs, by interval arithmetic (R. E. Moore, Interval Analysis, 1966).

Dependent terms are treated as independent: bounds may be too wide, but are never too narrow, except by rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

Range = tuple[float, float]
_ALL = (-math.inf, math.inf)
_TRUE, _FALSE = (1.0, 1.0), (0.0, 0.0)


class Enclosure:
    """Bounds of the first output of an SX function with dense inputs."""

    def __init__(self, function: Any) -> None:
        constant, self._steps = function.instruction_constant, list[tuple[int, list[int], list[int], float]]()
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            value = float(constant(k)) if op == ca.OP_CONST else 0.0
            self._steps.append((op, function.instruction_input(k), function.instruction_output(k), value))
        self._work, self._count = function.sz_w(), function.numel_out(0)
        # instructions number the nonzeros of an output
        self._rows = function.sparsity_out(0).row()

    def bounds(self, inputs: Sequence[Sequence[Range]]) -> list[Range]:
        """Bounds of the elements of the output, where each element of the inputs is in its range."""
        work, found = [_ALL] * self._work, [(0.0, 0.0)] * self._count
        for op, operands, results, value in self._steps:
            if op == ca.OP_CONST:
                work[results[0]] = value, value
            elif op == ca.OP_INPUT:
                work[results[0]] = inputs[operands[0]][operands[1]]
            elif op == ca.OP_OUTPUT:
                found[self._rows[results[1]]] = work[operands[0]]
            else:
                rule = _RULES.get(op)
                work[results[0]] = _ALL if rule is None else _clean(rule(*(work[k] for k in operands)))
        return found


def _clean(found: Range) -> Range:
    """All numbers instead of bounds that are none."""
    return found if found[0] <= found[1] else _ALL


def _product(a: Range, b: Range) -> Range:
    # infinite bounds are never reached, so zero times infinity is zero
    corners = [0.0 if x == 0.0 or y == 0.0 else x * y for x in a for y in b]
    return min(corners), max(corners)


def _inverse(a: Range) -> Range:
    return (1.0 / a[1], 1.0 / a[0]) if a[0] > 0.0 or a[1] < 0.0 else _ALL


def _square(a: Range) -> Range:
    low = max(a[0], -a[1], 0.0)
    return low * low, max(a[0] * a[0], a[1] * a[1])


def _magnitude(a: Range) -> Range:
    return max(a[0], -a[1], 0.0), max(-a[0], a[1])


def _power(a: Range, e: Range) -> Range:
    if e[0] != e[1]:
        return _ALL
    if e[0] % 2.0 == 0.0:
        a = _magnitude(a)
    if a[0] < 0.0 and (e[0] % 1.0 or e[0] < 0.0):
        return _ALL
    low, high = (_number(math.pow, v, e[0]) for v in a)
    return min(low, high), max(low, high)


def _number(f: Callable[..., float], *values: float) -> float:
    try:
        return f(*values)
    except OverflowError:
        return math.inf
    except (ValueError, ZeroDivisionError):
        return math.nan


def _rising(f: Callable[[float], float]) -> Callable[[Range], Range]:
    return lambda a: (_number(f, a[0]), _number(f, a[1]))


def _choice(condition: Range, a: Range) -> Range:
    """Bounds of `a` where a condition holds, and zero elsewhere."""
    if condition == _TRUE:
        return a
    return (0.0, 0.0) if condition == _FALSE else (min(a[0], 0.0), max(a[1], 0.0))


def _truth(holds: bool, fails: bool) -> Range:
    return _TRUE if holds else _FALSE if fails else (0.0, 1.0)


def _both(a: Range, b: Range) -> Range:
    return _truth(a == b == _TRUE, _FALSE in (a, b))


def _negated(a: Range) -> Range:
    return _truth(a == _FALSE, a == _TRUE)


def _same(a: Range, b: Range) -> Range:
    return _truth(a[0] == a[1] == b[0] == b[1], a[1] < b[0] or b[1] < a[0])


_RULES: dict[int, Callable[..., Range]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: (a[0] + b[0], a[1] + b[1]),
    ca.OP_SUB: lambda a, b: (a[0] - b[1], a[1] - b[0]),
    ca.OP_NEG: lambda a: (-a[1], -a[0]),
    ca.OP_TWICE: lambda a: (2.0 * a[0], 2.0 * a[1]),
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: _product(a, _inverse(b)),
    ca.OP_INV: _inverse,
    ca.OP_SQ: _square,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_FABS: _magnitude,
    ca.OP_FMIN: lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    ca.OP_FMAX: lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    ca.OP_SQRT: lambda a: _rising(math.sqrt)((max(a[0], 0.0), a[1])),
    ca.OP_EXP: _rising(math.exp),
    ca.OP_LOG: lambda a: (_number(math.log, a[0]) if a[0] > 0.0 else -math.inf, _number(math.log, a[1])),
    ca.OP_TANH: _rising(math.tanh),
    ca.OP_ATAN: _rising(math.atan),
    ca.OP_SINH: _rising(math.sinh),
    ca.OP_COSH: lambda a: _rising(math.cosh)(_magnitude(a)),
    ca.OP_SIN: lambda a: (-1.0, 1.0),
    ca.OP_COS: lambda a: (-1.0, 1.0),
    ca.OP_SIGN: _rising(lambda a: math.copysign(1.0, a) if a else 0.0),
    ca.OP_LT: lambda a, b: _truth(a[1] < b[0], a[0] >= b[1]),
    ca.OP_LE: lambda a, b: _truth(a[1] <= b[0], a[0] > b[1]),
    ca.OP_EQ: _same,
    ca.OP_NE: lambda a, b: _negated(_same(a, b)),
    ca.OP_NOT: _negated,
    ca.OP_AND: _both,
    ca.OP_OR: lambda a, b: _negated(_both(_negated(a), _negated(b))),
    ca.OP_IF_ELSE_ZERO: _choice,
}
