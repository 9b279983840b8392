"""Interval arithmetic: bounds of expressions for all values of their variables within given bounds.

1 + e - cos(x) is never below e; two bodies whose poses are bounded cannot touch. Dependent terms are treated as
independent, so that an interval may be too wide but never too narrow. Its ends are rounded outward unless they are
exact, by more than the error of the functions of C: a bound holds for real numbers and for any order of evaluation. It
holds wherever an expression has a value; `partial` tells whether it may have none.

Source: R. E. Moore, Interval Analysis (1966).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from acausal.flatten.pool import Pool

Interval = tuple[float, float]

EVERYTHING: Interval = (-math.inf, math.inf)
# Functions of C differ from the true value by at most four units in the last place.
_LIBRARY = 9e-16
_PI = math.nextafter(math.pi, 4.0)
_DOMAINS: Mapping[Any, Interval] = {
    "sqrt": (0.0, math.inf),
    "log": (0.0, math.inf),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
}


def ranges(
    pool: Pool, reachable: Iterable[int], known: Callable[[int], float | Interval | None], kinks: bool = False
) -> dict[int, Interval]:
    """Bounds of nodes, given in evaluation order; `known` returns the value of a node, or its bounds, if they are.

    Those of `minimum`, `maximum`, `fabs` and branches are unbounded without `kinks`: an event is at every kink
    (`acausal.analyse.events.located_kinks`) and where a branch changes, so that a jump between bounded branches, such
    as from 0 to 1, is no steep function. The jump of a relation within `noevent` is left to the solver.
    """
    range_of: dict[int, Interval] = {}
    for number in reachable:
        value = known(number)
        op, *operands = pool.nodes[number]
        if isinstance(value, tuple):
            range_of[number] = value
        elif value is not None:
            range_of[number] = (value, value) if math.isfinite(value) else EVERYTHING
        elif op in ("min", "max", "fabs", "where") and not kinks:
            range_of[number] = EVERYTHING
        else:
            range_of[number] = interval(op, operands, [range_of.get(n, EVERYTHING) for n in operands])
    return range_of


def interval(op: Any, operands: Sequence[int], bounds: Sequence[Interval]) -> Interval:
    """Bounds of an operation; `operands` are its nodes, which show that equal factors form a square."""
    if op == "mul" and operands[0] == operands[1]:
        return _square(bounds[0])
    rule = _RULES.get(op)
    if rule is None:
        return EVERYTHING
    low, high = rule(*bounds)
    return EVERYTHING if math.isnan(low) or math.isnan(high) else (low, high)


def partial(op: Any, bounds: Sequence[Interval]) -> bool:
    """Whether a function has no value for some operands within their bounds."""
    if op == "pow":
        return bounds[0][0] < 0.0 and not (bounds[1][0] == bounds[1][1] and bounds[1][0] % 1.0 == 0.0)
    low, high = _DOMAINS.get(op, EVERYTHING)
    return op in _DOMAINS and not low <= bounds[0][0] <= bounds[0][1] <= high


def decided(op: str, a: Interval, b: Interval) -> bool | None:
    """Whether `a op b` holds for all values (True) or for none (False); None if that depends on them."""
    if op in ("gt", "ge"):
        op, a, b = ("lt" if op == "gt" else "le"), b, a
    if op == "lt":
        return True if a[1] < b[0] else False if a[0] >= b[1] else None
    return True if a[1] <= b[0] else False if a[0] > b[1] else None


def _down(x: float) -> float:
    return math.nextafter(x, -math.inf)


def _up(x: float) -> float:
    return math.nextafter(x, math.inf)


def _sum(a: Interval, b: Interval) -> Interval:
    # the difference to the larger operand is exact
    low, high = a[0] + b[0], a[1] + b[1]
    return (
        low if low - a[0] == b[0] and low - b[0] == a[0] else _down(low),
        high if high - a[1] == b[1] and high - b[1] == a[1] else _up(high),
    )


def _is_product(product: float, x: float, y: float) -> bool:
    """Whether a product is exact."""
    if not (math.isfinite(product) and math.isfinite(x) and math.isfinite(y)):
        return False
    (p, below), (n, d), (m, e) = product.as_integer_ratio(), x.as_integer_ratio(), y.as_integer_ratio()
    return p * d * e == below * n * m


def _enclosed(corners: Iterable[tuple[float, float, float]], exact: Callable[[float, float, float], bool]) -> Interval:
    """The least and the greatest of some results (result, operand, operand), rounded outward unless they are exact."""
    ordered = sorted(corners)
    ends = [r if math.isinf(x) or math.isinf(y) or exact(r, x, y) else None for r, x, y in (ordered[0], ordered[-1])]
    low, high = ends
    return _down(ordered[0][0]) if low is None else low, _up(ordered[-1][0]) if high is None else high


def _product(a: Interval, b: Interval) -> Interval:
    # 0 times infinity is 0, because the infinite end of an interval is never attained
    return _enclosed(((0.0 if x == 0.0 or y == 0.0 else x * y, x, y) for x in a for y in b), _is_product)


def _quotient(a: Interval, b: Interval) -> Interval:
    if b[0] <= 0.0 <= b[1]:
        return EVERYTHING
    # of the quotients of infinite ends, between zero and infinity, other corners are the least and the greatest
    corners = ((0.0 if math.isinf(y) else x / y, x, y) for x in a for y in b)
    return _enclosed(corners, lambda quotient, x, y: _is_product(x, quotient, y))


def _magnitude(a: Interval) -> Interval:
    return max(a[0], -a[1], 0.0), max(abs(a[0]), abs(a[1]))


def _square(a: Interval) -> Interval:
    a = _magnitude(a)
    return _product((a[0], a[0]), (a[0], a[0]))[0], _product((a[1], a[1]), (a[1], a[1]))[1]


def _root(a: Interval) -> Interval:
    ends = sorted((math.sqrt(max(x, 0.0)), max(x, 0.0), max(x, 0.0)) for x in a)
    return _enclosed(ends, lambda root, x, _: _is_product(x, root, root))


def _power(a: Interval, b: Interval) -> Interval:
    exponent = b[0]
    if b[0] != b[1]:
        return (0.0, math.inf) if a[0] >= 0.0 else EVERYTHING
    if exponent == 2.0:
        return _square(a)
    if exponent % 1.0 != 0.0:
        a = max(a[0], 0.0), max(a[1], 0.0)
    elif exponent % 2.0 == 0.0:
        a = _magnitude(a)
    if a[0] < 0.0 and exponent < 0.0:
        return EVERYTHING
    return _monotone(lambda x: x**exponent, a if exponent > 0.0 else (a[1], a[0]))


def _monotone(function: Callable[[float], float], a: Interval, limits: Interval = EVERYTHING) -> Interval:
    """Image under a monotone function of the operands with the least and the greatest value, within its limits."""
    ends = []
    for x, beyond in ((a[0], -math.inf), (a[1], math.inf)):
        try:
            ends.append(float(function(x)))
        except (ValueError, ArithmeticError):
            ends.append(beyond)
    low, high = ends
    return (
        max(low - _LIBRARY * abs(low), limits[0]) if math.isfinite(low) else low,
        min(high + _LIBRARY * abs(high), limits[1]) if math.isfinite(high) else high,
    )


_RULES: Mapping[Any, Callable[..., Interval]] = {
    "add": _sum,
    "sub": lambda a, b: _sum(a, (-b[1], -b[0])),
    "neg": lambda a: (-a[1], -a[0]),
    "mul": _product,
    "div": _quotient,
    "pow": _power,
    "min": lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    "max": lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    "where": lambda c, a, b: (min(a[0], b[0]), max(a[1], b[1])),
    "noevent": lambda a: a,
    "fabs": _magnitude,
    "sqrt": _root,
    "exp": lambda a: _monotone(math.exp, a),
    "log": lambda a: _monotone(math.log, a),
    "sin": lambda a: (-1.0, 1.0),
    "cos": lambda a: (-1.0, 1.0),
    "tanh": lambda a: _monotone(math.tanh, a, (-1.0, 1.0)),
    "atan": lambda a: _monotone(math.atan, a, (-_PI / 2.0, _PI / 2.0)),
    "sinh": lambda a: _monotone(math.sinh, a),
    "cosh": lambda a: _monotone(math.cosh, _magnitude(a), (1.0, math.inf)),
    "asin": lambda a: (-_PI / 2.0, _PI / 2.0),
    "acos": lambda a: (0.0, _PI),
    "atan2": lambda a, b: (-_PI, _PI),
    "sign": lambda a: (-1.0, 1.0),
    **{name: lambda *_: (0.0, 1.0) for name in ("lt", "le", "gt", "ge", "and", "or", "not")},
}
