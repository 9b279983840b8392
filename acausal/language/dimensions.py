"""Dimension check of equations: units are declared, literal numbers and undeclared units adapt to anything."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

from acausal.errors import Span, UnitError
from acausal.language.expression import CONDITIONS, RELATIONS, Equation, Expr, Operation, Symbol, symbols_in
from acausal.units import DIMENSIONLESS, Dimension, divide, format_dimension, multiply, parse, power

_SECOND = parse("s").dimension
_TRANSCENDENTAL = frozenset(
    ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "atan2"]
)
_COMPARED = frozenset((*RELATIONS, "equals"))
_SUMS = frozenset(("add", "sub", "min", "max", "where", "homotopy", *_COMPARED))
_SAME = frozenset(("neg", "pre", "noevent", "index", "transpose", "fabs", "floor", "ceil"))


class _Mismatch(Exception):
    def __init__(self, fact: str) -> None:
        self.fact = fact


def check_dimensions(equation: Equation, where: Sequence[Span]) -> None:
    """Raise UnitError (AC155) when the sides of an equation, or the terms of a sum in it, differ in dimension."""
    try:
        known: dict[int, Dimension | None] = {}
        left, right = dimension(equation.left, known), dimension(equation.right, known)
        if left is not None and right is not None and left != right:
            raise _Mismatch(
                f"`{equation}`: the left side is in {format_dimension(left)}, "
                f"the right side in {format_dimension(right)}"
            )
    except _Mismatch as mismatch:
        symbols = symbols_in(equation.left, equation.right)
        if not any(symbol.declaration.unit for symbol in symbols) and not _calls(equation):
            return  # only `time` has a unit here: in a problem without units it is a number like the others
        raise UnitError(
            "AC155",
            mismatch.fact,
            where=where,
            evidence=[f"{symbol}  [{symbol.declaration.unit or 'adapts'}]" for symbol in symbols],
            cause="a factor is missing or two quantities are mixed up",
            help="check the declared units; a plain number adapts to any unit",
        ) from None


def _calls(equation: Equation) -> bool:
    """True when an external function, which declares units, is in the equation."""
    stack, seen = [equation.left, equation.right], set[int]()
    while stack:
        e = stack.pop()
        if e.op == "call":
            return True
        stack.extend(a for a in e.args if id(a) not in seen)
        seen.update(id(a) for a in e.args)
    return False


def dimension(e: Expr, known: dict[int, Dimension | None]) -> Dimension | None:
    """Dimension of an expression; None where a literal or an undeclared unit adapts.

    Without recursion: a sum over a thousand parts is a thousand nodes deep.
    """
    stack = [e]
    while stack:
        here = stack[-1]
        missing = [a for a in here.args if id(a) not in known]
        if missing:
            stack.extend(missing)
            continue
        stack.pop()
        if id(here) not in known:
            known[id(here)] = _dimension(here, [known[id(a)] for a in here.args])
    return known[id(e)]


def _dimension(e: Expr, parts: list[Dimension | None]) -> Dimension | None:
    op = e.op
    if isinstance(e, Symbol):
        return parse(e.declaration.unit).dimension if e.declaration.unit else None
    if op == "time":
        return _SECOND
    if op == "const":
        return None
    if op == "delay":
        return _delay(e, parts)
    if op in _SUMS or op == "stack":
        return _sum(e, parts[1:] if op == "where" else parts)
    if op in _SAME:
        return parts[0]
    if op in ("mul", "matmul", "cross"):
        return None if parts[0] is None or parts[1] is None else multiply(parts[0], parts[1])
    if op == "div":
        return None if parts[0] is None or parts[1] is None else divide(parts[0], parts[1])
    if op == "der":
        return None if parts[0] is None else divide(parts[0], _SECOND)
    if op == "sqrt":
        return None if parts[0] is None else power(parts[0], Fraction(1, 2))
    if op == "pow":
        return _pow(e, parts)
    if op == "call":
        external, output = e.payload
        return parse(external.units[output]).dimension if external.units[output] else None
    if op in _TRANSCENDENTAL:
        return _transcendental(e, parts)
    return DIMENSIONLESS if op == "sign" or op in CONDITIONS else None


def _sum(e: Expr, parts: list[Dimension | None]) -> Dimension | None:
    declared = [p for p in parts if p is not None]
    if e.op == "stack":
        return declared[0] if len(set(declared)) == 1 else None
    if len(set(declared)) > 1:
        raise _Mismatch(f"`{e}` mixes {format_dimension(declared[0])} and {format_dimension(declared[1])}")
    if e.op in _COMPARED:
        return DIMENSIONLESS
    return declared[0] if declared else None


def _delay(e: Expr, parts: list[Dimension | None]) -> Dimension | None:
    for t, found in zip(e.args[1:], parts[1:], strict=True):
        if found is not None and found != _SECOND:
            raise _Mismatch(f"`{e}`: a delay is a time, `{t}` is in {format_dimension(found)}")
    return parts[0]


def _pow(e: Expr, parts: list[Dimension | None]) -> Dimension | None:
    base, exponent = e.args
    if parts[1] is not None and parts[1] != DIMENSIONLESS:
        raise _Mismatch(f"`{e}`: an exponent has no unit, this one is in {format_dimension(parts[1])}")
    if parts[0] is None:
        return None
    if exponent.op == "const" and math.isfinite(exponent.payload):
        return power(parts[0], Fraction(exponent.payload).limit_denominator(1000))
    if parts[0] != DIMENSIONLESS:
        raise _Mismatch(
            f"`{e}`: `{base}` is in {format_dimension(parts[0])}; with a symbolic exponent divide it by a reference"
        )
    return DIMENSIONLESS


def _transcendental(e: Expr, parts: list[Dimension | None]) -> Dimension | None:
    if e.op == "atan2":
        _sum(Operation("sub", e.args, ()), parts)
        return DIMENSIONLESS
    if parts[0] is not None and parts[0] != DIMENSIONLESS:
        raise _Mismatch(f"`{e}`: {e.op} takes a number or an angle, not {format_dimension(parts[0])}")
    return DIMENSIONLESS
