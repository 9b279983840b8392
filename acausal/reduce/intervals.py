"""Bounds of expressions, to prove that a relation always or never holds: two bodies that cannot touch.

Every operation is rounded outward by a little more than its rounding error. A decision is therefore proved for all
values of variables, and for all values that the declared limits of parameters allow.

Source: R. E. Moore, Interval Analysis (1966).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from acausal.flatten.flat import FlatSystem

Interval = tuple[float, float]

EVERYTHING: Interval = (-math.inf, math.inf)
_ROUNDING = 4e-16


def parameter_limits(flat: FlatSystem) -> list[Interval]:
    """Interval of the values that a run accepts for each free parameter scalar, by its declared limits."""
    limits = [EVERYTHING] * len(flat.parameter_values)
    for parameter in flat.parameters:
        if parameter.free:
            for op, *number in (flat.pool.nodes[n] for n in parameter.nodes):
                if op == "par":
                    limits[number[0]] = (parameter.declaration.min, parameter.declaration.max)
    return limits


def interval(op: Any, args: tuple[int, ...], operands: tuple[Interval, ...]) -> Interval:
    """Bounds of an operation; `args` are the nodes of its operands, which show that equal factors form a square."""
    if op == "mul" and args[0] == args[1]:
        return _square(operands[0])
    rule = _RULES.get(op)
    if rule is None:
        return EVERYTHING
    low, high = rule(*operands)
    if math.isnan(low) or math.isnan(high):
        return EVERYTHING
    return _outward(low, high)


def decided(op: str, a: Interval, b: Interval) -> bool | None:
    """Whether `a op b` holds for all values (True) or for none (False); None if that depends on them."""
    if op in ("gt", "ge"):
        op, a, b = ("lt" if op == "gt" else "le"), b, a
    if op == "lt":
        return True if a[1] < b[0] else False if a[0] >= b[1] else None
    return True if a[1] <= b[0] else False if a[0] > b[1] else None


def _outward(low: float, high: float) -> Interval:
    return low - _ROUNDING * abs(low) if low else low, high + _ROUNDING * abs(high) if high else high


def _square(a: Interval) -> Interval:
    low, high = abs(a[0]), abs(a[1])
    smallest = 0.0 if a[0] <= 0.0 <= a[1] else min(low, high)
    return _outward(_times(smallest, smallest), _times(max(low, high), max(low, high)))


def _times(a: float, b: float) -> float:
    # 0 times infinity is 0, because the infinite end of an interval is never attained.
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _mul(a: Interval, b: Interval) -> Interval:
    ends = [_times(x, y) for x in a for y in b]
    return min(ends), max(ends)


def _div(a: Interval, b: Interval) -> Interval:
    if b[0] <= 0.0 <= b[1]:
        return EVERYTHING
    return _mul(a, (1.0 / b[1], 1.0 / b[0]))


def _pow(a: Interval, b: Interval) -> Interval:
    exponent = b[0]
    if b[0] != b[1]:
        return (0.0, math.inf) if a[0] >= 0.0 else EVERYTHING
    if exponent == 2.0:
        return _square(a)
    if a[0] >= 0.0 and exponent > 0.0:
        return _safely(lambda x: x**exponent, a)
    if a[0] >= 0.0 or (exponent == int(exponent) and int(exponent) % 2 == 0):
        return 0.0, math.inf
    return EVERYTHING


def _safely(function: Callable[[float], float], a: Interval) -> Interval:
    """Image under a monotonically increasing function."""
    ends = []
    for x, beyond in ((a[0], -math.inf), (a[1], math.inf)):
        try:
            ends.append(function(x))
        except (ValueError, OverflowError):
            ends.append(beyond)
    return ends[0], ends[1]


def _fabs(a: Interval) -> Interval:
    low = 0.0 if a[0] <= 0.0 <= a[1] else min(abs(a[0]), abs(a[1]))
    return low, max(abs(a[0]), abs(a[1]))


def _sqrt(a: Interval) -> Interval:
    return _safely(math.sqrt, (max(a[0], 0.0), max(a[1], 0.0)))


_RULES: Mapping[Any, Callable[..., Interval]] = {
    "add": lambda a, b: (a[0] + b[0], a[1] + b[1]),
    "sub": lambda a, b: (a[0] - b[1], a[1] - b[0]),
    "neg": lambda a: (-a[1], -a[0]),
    "mul": _mul,
    "div": _div,
    "pow": _pow,
    "min": lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    "max": lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    "where": lambda c, a, b: (min(a[0], b[0]), max(a[1], b[1])),
    "noevent": lambda a: a,
    "fabs": _fabs,
    "sqrt": _sqrt,
    "exp": lambda a: (0.0, math.inf) if math.isinf(a[0]) and math.isinf(a[1]) else _safely(math.exp, a),
    "log": lambda a: _safely(math.log, a) if a[0] > 0.0 else EVERYTHING,
    "sin": lambda a: (-1.0, 1.0),
    "cos": lambda a: (-1.0, 1.0),
    "tanh": lambda a: _safely(math.tanh, a),
    "atan": lambda a: _safely(math.atan, a),
    "sinh": lambda a: _safely(math.sinh, a),
    "cosh": lambda a: (1.0, math.inf),
    "asin": lambda a: (-2.0, 2.0),
    "acos": lambda a: (0.0, 4.0),
    "atan2": lambda a, b: (-4.0, 4.0),
    "sign": lambda a: (-1.0, 1.0),
    **{name: lambda *_: (0.0, 1.0) for name in ("lt", "le", "gt", "ge", "and", "or", "not")},
}
