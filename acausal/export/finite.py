"""Functions whose derivatives are finite wherever their values are.

`maximum(f, 0)**1.3`, `sqrt(maximum(f, 0))` and `acos(clamp(c, -1, 1))` have values everywhere, and a constant is all
they are where the limit holds; but the chain rule multiplies an infinite slope by zero there, which is nan, in the
first derivative or in the second. So does the length of a vector that vanishes. A power, a root, an inverse sine or
cosine, and an angle are therefore taken apart at the one point where their slope is not finite: they keep their value,
and their derivatives are 0. Everywhere else nothing changes.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

_SINGULAR = frozenset((ca.OP_SQRT, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATAN2, ca.OP_HYPOT))


def finite(function: Any) -> Any:
    """The SX function with the same values and finite derivatives; itself where it needs no change."""
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    if _SINGULAR.isdisjoint(operations) or ca.OP_CALL in operations:
        return function
    arguments = function.sx_in()
    entries = [a.nonzeros() for a in arguments]
    results = [[ca.SX(0)] * function.nnz_out(k) for k in range(function.n_out())]
    work: list[Any] = [ca.SX(0)] * function.sz_w()
    for k, op in enumerate(operations):
        places, to = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_CONST:
            work[to[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_INPUT:
            work[to[0]] = entries[places[0]][places[1]]
        elif op == ca.OP_OUTPUT:
            results[to[0]][to[1]] = work[places[0]]
        else:
            operands = [work[p] for p in places]
            work[to[0]] = _operation(op, operands)
    values = [ca.SX(function.sparsity_out(k), ca.vertcat(ca.SX(0, 1), *v)) for k, v in enumerate(results)]
    return ca.Function(function.name(), arguments, values, function.name_in(), function.name_out())


def _operation(op: int, operands: list[Any]) -> Any:
    if op not in _SINGULAR:
        return ca.SX.unary(op, *operands) if len(operands) == 1 else ca.SX.binary(op, *operands)
    a = operands[0]
    if a.is_constant() and op in (ca.OP_POW, ca.OP_CONSTPOW):
        return a ** operands[1]
    if op == ca.OP_SQRT:
        return ca.if_else(a == 0, 0, ca.sqrt(a + (a == 0)))
    if op in (ca.OP_ASIN, ca.OP_ACOS):
        at_end = ca.fabs(a) == 1
        inside = ca.if_else(at_end, 0, a)
        if op == ca.OP_ASIN:
            return ca.if_else(at_end, ((a > 0) - (a < 0)) * (math.pi / 2), ca.asin(inside))
        return ca.if_else(at_end, (a < 0) * math.pi, ca.acos(inside))
    if op in (ca.OP_ATAN2, ca.OP_HYPOT):
        b = operands[1]
        origin = ca.logic_and(a == 0, b == 0)
        other = b + origin
        value = ca.atan2(a, other) if op == ca.OP_ATAN2 else ca.hypot(a, other)
        return ca.if_else(origin, 0, value)
    return _power(a, operands[1])


def _power(base: Any, exponent: Any) -> Any:
    if exponent.is_constant() and float(exponent) == round(float(exponent)) and float(exponent) >= 0:
        return base**exponent
    at_zero = ca.if_else(exponent > 0, 0, ca.if_else(exponent == 0, 1, math.inf))
    return ca.if_else(base == 0, at_zero, (base + (base == 0)) ** exponent)
