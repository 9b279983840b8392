"""Rewriting of functions so that their derivatives are finite wherever their values are.

`maximum(f, 0)**1.3`, `sqrt(maximum(f, 0))` and `acos(clamp(c, -1, 1))` have values everywhere, and are constant where
the limit is active. But there the chain rule multiplies an infinite slope by zero, which is nan, in the first or the
second derivative. The same holds for the length of a vector that vanishes. Therefore powers, roots, inverse sines and
cosines, and angles are replaced at the one point where their slope is not finite: there they keep their value, and
their derivatives are 0. Elsewhere nothing changes. Bases that cannot vanish are left unchanged. If that depends on
parameters, the test is an expression of parameters, which disappears when they are numbers.

For these tests every expression carries a lower bound that holds for all states and inputs, as an expression of
parameters: `maximum(h, h_min) / h_1` is at least h_min / h_1 where h_1 > 0, and `x**2 + eps**2` at least eps**2. A
bound is an existing parameter expression, or one operation on it, so that tests stay cheap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

_SINGULAR = frozenset((ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN2, ca.OP_HYPOT))


def finite(function: Any) -> Any:
    """An SX function with the same values and finite derivatives; the function itself if it needs no change."""
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    if _SINGULAR.isdisjoint(operations) or ca.OP_CALL in operations:
        return function
    arguments = function.sx_in()
    are_known = [name == "p" for name in function.name_in()]
    entries = [
        [known(v) if is_known else Bounded(v) for v in a.nonzeros()]
        for a, is_known in zip(arguments, are_known, strict=True)
    ]
    results = [[ca.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    work = [known(ca.SX(0))] * function.sz_w()
    bounds, finite_slopes = LowerBounds(), _FiniteSlopes()
    for k, op in enumerate(operations):
        places, to = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_CONST:
            work[to[0]] = known(ca.SX(function.instruction_constant(k)))
        elif op == ca.OP_INPUT:
            work[to[0]] = entries[places[0]][places[1]]
        elif op == ca.OP_OUTPUT:
            results[to[0]][to[1]] = work[places[0]].value
        else:
            operands = [work[p] for p in places]
            work[to[0]] = bounds.bounded(op, finite_slopes.operation(op, operands), operands)
    values = [ca.SX(function.sparsity_out(k), ca.vertcat(ca.SX(0, 1), *v)) for k, v in enumerate(results)]
    return ca.Function(function.name(), arguments, values, function.name_in(), function.name_out())


class _FiniteSlopes:
    """Replaces operations where their slope is not finite; equal bases, bounds and exponents share their tests."""

    def __init__(self) -> None:
        # By hash. The expression is stored, too: the hash of a deleted one may be reused.
        self._bases: dict[int, tuple[Any, Any, Any]] = {}
        self._exponents: dict[int, tuple[Any, Any]] = {}
        self._bounds: dict[int, tuple[Any, Any]] = {}

    def operation(self, op: int, operands: list[Bounded]) -> Any:
        values = [o.value for o in operands]
        if op not in _SINGULAR:
            return ca.SX.unary(op, *values) if len(values) == 1 else ca.SX.binary(op, *values)
        a = values[0]
        if op == ca.OP_SQRT:
            is_zero, base = self._base(operands[0])
            return ca.sqrt(base) - is_zero
        if op in (ca.OP_POW, ca.OP_CONSTPOW):
            return self._power(operands[0], values[1])
        if op in (ca.OP_ASIN, ca.OP_ACOS):
            return _inverse(op, a)
        b = values[1]
        origin = ca.logic_and(a == 0, b == 0)
        other = b + origin
        return ca.if_else(origin, 0, ca.atan2(a, other) if op == ca.OP_ATAN2 else ca.hypot(a, other))

    def _power(self, base: Bounded, exponent: Any) -> Any:
        if base.value.is_constant() or (exponent.is_constant() and _is_smooth(float(exponent))):
            return base.value**exponent
        is_zero, other = self._base(base)
        return other**exponent + _where(is_zero, self._zero_minus_one_power(exponent))

    def _base(self, base: Bounded) -> tuple[Any, Any]:
        """(Whether a base is zero, the base with zero replaced by 1)."""
        key = base.value.element_hash()
        if key not in self._bases:
            is_zero = base.value == 0
            if base.low is not None and not base.is_known:
                is_zero = self._can_vanish(base.low) * is_zero
            self._bases[key] = is_zero, is_zero + _where(ca.logic_not(is_zero), base.value), base.value
        return self._bases[key][:2]

    def _can_vanish(self, low: Any) -> Any:
        """Whether a value with the lower bound `low` may be zero."""
        key = low.element_hash()
        if key not in self._bounds:
            self._bounds[key] = ca.logic_not(low > 0), low
        return self._bounds[key][0]

    def _zero_minus_one_power(self, exponent: Any) -> Any:
        """0**exponent - 1**exponent: -1, 0 or infinity."""
        key = exponent.element_hash()
        if key not in self._exponents:
            found = _where(ca.logic_not(exponent >= 0), math.inf) - (exponent > 0)
            self._exponents[key] = found, exponent
        return self._exponents[key][0]


def _is_smooth(exponent: float) -> bool:
    """Whether all derivatives of a power are finite at zero; implicit steps need more than the first two."""
    return exponent >= 0 and exponent.is_integer()


def _where(condition: Any, value: Any) -> Any:
    return ca.SX.binary(ca.OP_IF_ELSE_ZERO, condition, value)


def _inverse(op: int, a: Any) -> Any:
    """Inverse sine or cosine with derivative 0 at 1 and -1, where it is infinite."""
    at_end = ca.fabs(a) == 1
    inside = ca.if_else(at_end, 0, a)
    if op == ca.OP_ASIN:
        return ca.if_else(at_end, ((a > 0) - (a < 0)) * (math.pi / 2), ca.asin(inside))
    return ca.if_else(at_end, (a < 0) * math.pi, ca.acos(inside))


_AT_LEAST_ZERO = frozenset((ca.OP_SQ, ca.OP_FABS, ca.OP_SQRT, ca.OP_HYPOT))


@dataclass(frozen=True, eq=False)
class Bounded:
    """A scalar expression and its lower bound."""

    value: Any
    low: Any = None  # None if unknown
    is_known: bool = False  # whether the expression depends on parameters alone


@dataclass(frozen=True, eq=False)
class LowerBounds:
    """Lower bounds of results from those of operands; equal quotients of parameters are shared."""

    _made: dict[tuple[int, int, int], tuple[Any, Any, Any]] = field(default_factory=dict)

    def bounded(self, op: int, value: Any, operands: list[Bounded]) -> Bounded:
        """The result `value` of an operation with its bound."""
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
            # adding symbolic bounds would double the cost of long sums
            if a.low is None or b.low is None or not (a.low.is_constant() or b.low.is_constant()):
                return None
            return a.low + b.low
        if op == ca.OP_MUL and a.is_known:
            a, b = b, a
        return self._scaled(op, a.low, b.value) if a.low is not None and b.is_known else None

    def _scaled(self, op: int, low: Any, factor: Any) -> Any:
        """The bound multiplied or divided by a factor, valid where the factor is positive."""
        if factor.is_constant():
            return ca.SX.binary(op, low, factor) if float(factor) > 0 else None
        if low.is_constant() and float(low) <= 0:
            return None
        key = op, low.element_hash(), factor.element_hash()
        if key not in self._made:
            found = ca.if_else(factor > 0, ca.SX.binary(op, low, factor), -math.inf)
            self._made[key] = found, low, factor  # stored expressions keep their hashes
        return self._made[key][0]


def known(value: Any) -> Bounded:
    """A constant or a parameter expression, which is its own bound."""
    return Bounded(value, value, True)


def _larger(a: Any, b: Any) -> Any:
    """The better of two bounds; where that depends on parameters, a positive number if there is one, else either."""
    if a is None or b is None:
        return b if a is None else a
    if a.is_constant() and b.is_constant():
        return a if float(a) >= float(b) else b
    number, other = (a, b) if a.is_constant() else (b, a)
    return number if number.is_constant() and float(number) > 0 else other
