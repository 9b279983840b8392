"""Interval bounds of expressions for any values of their variables.

Interval arithmetic (R. E. Moore, Interval Analysis, 1966): 1 + e - cos(x) is never below e, cosh(x) never below one.
Dependent terms are treated as independent, so that a range may be too wide but never too narrow. Ranges of `minimum`,
`maximum` and `fabs` are unbounded unless asked for: their kinks are located (`acausal.analyse.events.located_kinks`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from acausal.flatten.pool import Pool

Range = tuple[float, float]
_ALL = (-math.inf, math.inf)
_BOUNDED: dict[str, Range] = {
    "sin": (-1.0, 1.0),
    "cos": (-1.0, 1.0),
    "tanh": (-1.0, 1.0),
    "atan": (-math.pi / 2, math.pi / 2),
    "asin": (-math.pi / 2, math.pi / 2),
    "acos": (0.0, math.pi),
    "atan2": (-math.pi, math.pi),
    "exp": (0.0, math.inf),
    "cosh": (1.0, math.inf),
}


def ranges(
    pool: Pool, reachable: Iterable[int], constant: Callable[[int], float | None], kinks: bool = False
) -> dict[int, Range]:
    """Ranges of nodes, given in evaluation order; `constant` returns the value of a constant node, else None.

    With `kinks`, also those of `minimum`, `maximum` and `fabs`.
    """
    range_of: dict[int, Range] = {}
    for number in reachable:
        value = constant(number)
        op, *operands = pool.nodes[number]
        if value is not None:
            range_of[number] = (value, value) if math.isfinite(value) else _ALL
        else:
            operand_ranges = [range_of.get(n, _ALL) for n in operands if isinstance(n, int)]
            range_of[number] = _range(op, operands, operand_ranges)
            if kinks and op in ("min", "max", "fabs"):
                range_of[number] = _piecewise(op, operand_ranges)
    return range_of


def _range(op: object, operands: list[int], operand_ranges: list[Range]) -> Range:
    if op in _BOUNDED:
        return _BOUNDED[str(op)]
    if op == "mul" and operands[0] == operands[1]:
        return _square(operand_ranges[0])
    match op, operand_ranges:
        case "sqrt", [a]:
            return math.sqrt(max(a[0], 0.0)), math.sqrt(max(a[1], 0.0))
        case "add", [a, b]:
            return a[0] + b[0], a[1] + b[1]
        case "sub", [a, b]:
            return a[0] - b[1], a[1] - b[0]
        case "neg", [a]:
            return -a[1], -a[0]
        case "mul", [a, b]:
            return _product(a, b)
        case "div", [a, b] if b[0] > 0.0 or b[1] < 0.0:
            return _product(a, (1.0 / b[1], 1.0 / b[0]))
        case "pow", [a, (e, same)] if e == same and e > 0.0 and e % 2.0 == 0.0:
            low, high = _square(a)
            return _power(low, e / 2.0), _power(high, e / 2.0)
    return _ALL


def _piecewise(op: str, operand_ranges: list[Range]) -> Range:
    low, high = (tuple(ends) for ends in zip(*operand_ranges, strict=True))
    if op == "fabs":
        return max(low[0], -high[0], 0.0), max(abs(low[0]), abs(high[0]))
    choice = min if op == "min" else max
    return choice(low), choice(high)


def _square(a: Range) -> Range:
    low = max(a[0], -a[1], 0.0)
    return low * low, _power(max(abs(a[0]), abs(a[1])), 2.0)


def _power(base: float, exponent: float) -> float:
    try:
        return float(base**exponent)
    except OverflowError:
        return math.inf


def _product(a: Range, b: Range) -> Range:
    # infinite bounds are never reached, so zero times infinity is zero
    corners = [0.0 if x == 0.0 or y == 0.0 else x * y for x in a for y in b]
    return min(corners), max(corners)
