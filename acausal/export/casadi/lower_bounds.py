"""Numbers that no value of an expression is below, for all states and inputs, as expressions in the parameters.

`maximum(h, h_min) / h_1` is at least h_min / h_1 where h_1 > 0, and `x**2 + eps**2` at least eps**2. What asks whether
such a value is zero then has its answer from parameters alone: with numbers in their place nothing of it is left. A
bound is a parameter expression that is there already, or one operation on it, so asking stays cheap without numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

_AT_LEAST_ZERO = frozenset((ca.OP_SQ, ca.OP_FABS, ca.OP_SQRT, ca.OP_HYPOT))


@dataclass(frozen=True, eq=False)
class Bounded:
    """A scalar expression, and what it never is below."""

    value: Any
    low: Any = None  # None where nothing is said
    is_known: bool = False  # whether the expression depends on parameters alone


@dataclass(frozen=True, eq=False)
class LowerBounds:
    """Bounds of results by those of operands; the same quotient of parameters is made once."""

    _made: dict[tuple[int, int, int], tuple[Any, Any, Any]] = field(default_factory=dict)

    def bounded(self, op: int, value: Any, operands: list[Bounded]) -> Bounded:
        """The result of an operation, `value`, with its bound."""
        if all(o.is_known for o in operands):
            return known(value)
        return Bounded(value, self._low(op, operands))

    def _low(self, op: int, operands: list[Bounded]) -> Any:
        if op in _AT_LEAST_ZERO:
            return ca.SX(0)
        if op == ca.OP_COSH:
            return ca.SX(1)
        if op == ca.OP_FMAX:
            return _larger(operands[0].low, operands[1].low)
        if op not in (ca.OP_ADD, ca.OP_MUL, ca.OP_DIV):
            return None
        a, b = operands
        if op == ca.OP_ADD:
            # Sums of two symbolic bounds would double the work of long sums.
            if a.low is None or b.low is None or not (a.low.is_constant() or b.low.is_constant()):
                return None
            return a.low + b.low
        if op == ca.OP_MUL and a.is_known:
            a, b = b, a
        return self._scaled(op, a.low, b.value) if a.low is not None and b.is_known else None

    def _scaled(self, op: int, low: Any, factor: Any) -> Any:
        """The bound times or divided by a factor, which holds where the factor is positive."""
        if factor.is_constant():
            return ca.SX.binary(op, low, factor) if float(factor) > 0 else None
        if low.is_constant() and float(low) <= 0:
            return None
        key = op, low.element_hash(), factor.element_hash()
        if key not in self._made:
            found = ca.if_else(factor > 0, ca.SX.binary(op, low, factor), -math.inf)
            self._made[key] = found, low, factor  # expressions that live keep their hashes
        return self._made[key][0]


def known(value: Any) -> Bounded:
    """A number or a parameter expression, which is its own bound."""
    return Bounded(value, value, True)


def _larger(a: Any, b: Any) -> Any:
    """Of two bounds the one that says more; where parameters decide that, a positive number or either."""
    if a is None or b is None:
        return b if a is None else a
    if a.is_constant() and b.is_constant():
        return a if float(a) >= float(b) else b
    number, other = (a, b) if a.is_constant() else (b, a)
    return number if number.is_constant() and float(number) > 0 else other
