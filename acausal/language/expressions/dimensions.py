"""Dimension check of equations: declared units are compared, literal numbers are dimensionless.

Apart from a dimension, an expression can be:

- *unknown*, if it depends on a variable declared without a unit: it agrees with everything;
- *a number*, if it consists of literals, or of results of `unitless`. In sums and products with quantities a number is
  dimensionless. Alone it is a value like a default, in the SI unit of the quantity to which it is assigned or compared:
  `v == 1`, `reset(s, 0.2)`, `maximum(f, 1e-3)`, `time < 2`;
- *a signal*, if it consists of literals and `time`: it is also a number, so that `force.u == 10 * sin(3 * time)` needs
  no units. In combination with quantities it has the dimension that follows from seconds;
- *any*, for the numbers zero and infinity, which are the same in every unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import TypeAlias

from acausal.errors import Span, UnitError
from acausal.language.expressions.expression import (
    CONDITIONS,
    RELATIONS,
    Equation,
    Expr,
    Symbol,
    nodes,
    symbols_in,
    to_text,
)
from acausal.units import DIMENSIONLESS, Dimension, divide, format_dimension, multiply, parse, power


class _Plain(Enum):
    NUMBER = "number"
    ANY = "any"


@dataclass(frozen=True)
class _Signal:
    """An expression of literals and `time`; `bare` for `time` itself, which is always in seconds."""

    dimension: Dimension
    bare: bool = False


_NUMBER, _ANY = _Plain.NUMBER, _Plain.ANY

_Dimensional: TypeAlias = Dimension | _Plain | _Signal | None
"""Result for an expression; None means that it is unknown."""

_LONGEST_TEXT = 200
_SECOND = parse("s").dimension
_TRANSCENDENTAL = frozenset(("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log"))
_COMPARED = frozenset((*RELATIONS, "equals"))
_ALTERNATIVES = frozenset(("min", "max", "where", "homotopy", *_COMPARED))
_SUMS = frozenset(("add", "sub", "atan2"))
_UNIT_OF_OPERAND = frozenset(("neg", "pre", "noevent", "index", "slice", "fill", "transpose", "fabs", "floor", "ceil"))
_PRODUCTS = frozenset(("mul", "matmul", "cross"))


_NUMBERS = 'a number has no unit: quantity(2, "m") gives it one, unitless(x) takes one away'


class _Mismatch(Exception):
    def __init__(self, fact: str, help: str = f"check the declared units; {_NUMBERS}") -> None:
        self.fact = fact
        self.help = help


def check_dimensions(equation: Equation, where: Sequence[Span]) -> None:
    """Raise UnitError (AC155) when the sides of an equation, or the terms of a sum in it, differ in dimension."""
    try:
        dimension_of: dict[int, _Dimensional] = {}
        left, right = (
            _bare_time_as_seconds(_dimension_of(equation.left, dimension_of)),
            _bare_time_as_seconds(_dimension_of(equation.right, dimension_of)),
        )
        if isinstance(left, tuple) and isinstance(right, tuple) and left != right:
            raise _Mismatch(
                f"`{_short(equation)}`: the left side is in {format_dimension(left)}, "
                f"the right side in {format_dimension(right)}",
                _missing_factor("the right side", equation.right, divide(left, right)),
            )
    except _Mismatch as mismatch:
        symbols = symbols_in(equation.left, equation.right)
        # External functions declare units, and quantities have them.
        has_units = any(e.op in ("call", "quantity") for e in nodes(equation.left, equation.right))
        if not has_units and not any(symbol.declaration.unit for symbol in symbols):
            return  # only `time` has a unit: in a model without units it counts as a number
        raise UnitError(
            "AC155",
            mismatch.fact,
            where=where,
            evidence=[f"{symbol}  [{symbol.declaration.unit or 'adapts'}]" for symbol in symbols],
            cause="a factor is missing, two quantities are mixed up, or a number is used as a quantity",
            help=mismatch.help,
        ) from None


def _dimension_of(e: Expr, dimension_of: dict[int, _Dimensional]) -> _Dimensional:
    """Dimension of an expression; without recursion, because a sum of a thousand terms is a thousand nodes deep."""
    stack = [e]
    while stack:
        here = stack[-1]
        missing = [a for a in here.args if id(a) not in dimension_of]
        if missing:
            stack.extend(missing)
            continue
        stack.pop()
        if id(here) not in dimension_of:
            dimension_of[id(here)] = _dimension(here, [dimension_of[id(a)] for a in here.args])
    return dimension_of[id(e)]


def _dimension(e: Expr, parts: list[_Dimensional]) -> _Dimensional:
    op = e.op
    if isinstance(e, Symbol):
        return parse(e.declaration.unit).dimension if e.declaration.unit else None
    if not parts or op in ("quantity", "unitless", "call"):
        return _leaf_dimension(e)
    if op in _UNIT_OF_OPERAND:
        return parts[0]
    if op in _PRODUCTS:
        return _product(parts[0], parts[1], multiply)
    if op == "div":
        return _product(parts[0], parts[1], divide)
    if op in _SUMS:
        return _sum(e, parts)
    if op in _ALTERNATIVES:
        return _alternatives(e, parts[1:] if op == "where" else parts)
    if op in ("stack", "concatenate"):
        return _common(parts) if len(set(_dimensions(parts))) < 2 else None
    if op == "der":
        return _product(parts[0], _SECOND, divide) if isinstance(parts[0], tuple) else parts[0] and _NUMBER
    if op == "sqrt":
        return _power(parts[0], Fraction(1, 2))
    if op == "pow":
        return _pow(e, parts)
    if op in ("delay", "sample"):
        return _timed(e, parts)
    if op in _TRANSCENDENTAL:
        return _transcendental(e, parts[0])
    if op == "sign":
        return _NUMBER if _is_number(parts[0]) else DIMENSIONLESS
    return DIMENSIONLESS if op in CONDITIONS else None


def _leaf_dimension(e: Expr) -> _Dimensional:
    """Dimension of literals, `time`, and expressions that declare their unit."""
    if e.op == "const":
        numbers = e.payload if isinstance(e.payload, tuple) else (e.payload,)
        return _ANY if all(v == 0.0 or math.isinf(v) for v in numbers) else _NUMBER
    if e.op == "time":
        return _Signal(_SECOND, bare=True)
    if e.op == "quantity":
        return parse(e.payload[1]).dimension
    if e.op == "unitless":
        return _NUMBER
    if e.op == "call":
        external, output = e.payload
        return parse(external.units[output]).dimension if external.units[output] else None
    return DIMENSIONLESS if e.op in CONDITIONS else None


def _bare_time_as_seconds(operand: _Dimensional) -> _Dimensional:
    """The dimension of `time` if it is alone; anything else unchanged."""
    return operand.dimension if isinstance(operand, _Signal) and operand.bare else operand


def _is_number(dimension: _Dimensional) -> bool:
    return isinstance(dimension, _Plain | _Signal)


def _dimensions(parts: Iterable[_Dimensional]) -> list[Dimension]:
    return [p for p in parts if isinstance(p, tuple)]


def _common(parts: Sequence[_Dimensional]) -> _Dimensional:
    """Common result of parts that agree: the first that occurs of a dimension, unknown, a signal, a number, any."""
    declared = _dimensions(parts)
    if declared:
        return declared[0]
    signals = [p for p in parts if isinstance(p, _Signal)]
    if None in parts or signals:
        return None if None in parts else _Signal(signals[0].dimension)
    return _NUMBER if _NUMBER in parts else _ANY


def _product(a: _Dimensional, b: _Dimensional, combine: Callable[[Dimension, Dimension], Dimension]) -> _Dimensional:
    if a is _ANY or b is _ANY:
        return _ANY
    if a is None or b is None:
        return None
    if a is _NUMBER and b is _NUMBER:
        return _NUMBER
    dimension = combine(_dimension_with_quantity(a), _dimension_with_quantity(b))
    return _Signal(dimension) if _is_number(a) and _is_number(b) else dimension


def _dimension_with_quantity(operand: _Dimensional) -> Dimension:
    """Dimension of a number, a signal or a quantity in combination with a quantity."""
    if isinstance(operand, _Signal):
        return operand.dimension
    return operand if isinstance(operand, tuple) else DIMENSIONLESS


def _power(operand: _Dimensional, exponent: Fraction) -> _Dimensional:
    if isinstance(operand, _Signal):
        return _Signal(power(operand.dimension, exponent))
    return power(operand, exponent) if isinstance(operand, tuple) else operand


def _sum(e: Expr, parts: list[_Dimensional]) -> _Dimensional:
    declared = _dimensions(parts)
    _require_agreement(e, [*declared, *(p.dimension for p in parts if isinstance(p, _Signal) and declared)])
    if declared and declared[0] != DIMENSIONLESS and _NUMBER in parts:
        number = next(a for a, p in zip(e.args, parts, strict=True) if p is _NUMBER)
        unit = format_dimension(declared[0])
        raise _Mismatch(
            f"`{_short(e)}` mixes {unit} and the number {_short(number)}",
            f"if the number is in {unit}: {_with_unit(number, unit)}",
        )
    if e.op == "atan2":
        return _NUMBER if all(map(_is_number, parts)) else DIMENSIONLESS
    return _common(parts)


def _alternatives(e: Expr, parts: list[_Dimensional]) -> _Dimensional:
    parts = [*map(_bare_time_as_seconds, parts)] if _dimensions(parts) else parts
    _require_agreement(e, _dimensions(parts))
    return DIMENSIONLESS if e.op in _COMPARED else _common(parts)


def _require_agreement(e: Expr, declared: list[Dimension]) -> None:
    if len(set(declared)) > 1:
        first, other = (format_dimension(d) for d in dict.fromkeys(declared))
        raise _Mismatch(f"`{_short(e)}` mixes {first} and {other}")


def _timed(e: Expr, parts: list[_Dimensional]) -> _Dimensional:
    first = 1 if e.op == "delay" else 0
    for t, dimension in zip(e.args[first:], parts[first:], strict=True):
        if isinstance(dimension, tuple) and dimension != _SECOND:
            what = "a delay is a time" if first else "samples are taken at times"
            raise _Mismatch(f"`{_short(e)}`: {what}, `{_short(t)}` is in {format_dimension(dimension)}")
    return parts[0] if first else DIMENSIONLESS


def _pow(e: Expr, parts: list[_Dimensional]) -> _Dimensional:
    base, exponent = e.args
    if isinstance(parts[1], tuple) and parts[1] != DIMENSIONLESS:
        raise _Mismatch(f"`{_short(e)}`: an exponent has no unit, this one is in {format_dimension(parts[1])}")
    if exponent.op == "const" and not exponent.shape and math.isfinite(exponent.payload):
        return _power(parts[0], Fraction(exponent.payload).limit_denominator(1000))
    if _is_number(parts[0]):
        return _NUMBER if _is_number(parts[1]) else parts[1]
    if isinstance(parts[0], tuple) and parts[0] != DIMENSIONLESS:
        raise _Mismatch(
            f"`{_short(e)}`: `{_short(base)}` is in {format_dimension(parts[0])}; "
            "with a symbolic exponent divide it by a reference"
        )
    return parts[0]


def _transcendental(e: Expr, part: _Dimensional) -> _Dimensional:
    if isinstance(part, tuple) and part != DIMENSIONLESS:
        raise _Mismatch(
            f"`{_short(e)}`: {e.op} takes a number or an angle, not {format_dimension(part)}",
            _missing_factor("the argument", e.args[0], divide(DIMENSIONLESS, part)),
        )
    return _NUMBER if _is_number(part) else DIMENSIONLESS


def _missing_factor(what: str, e: Expr, lacking: Dimension) -> str:
    """Remedy for `what`, the expression `e`, which lacks a factor of dimension `lacking`."""
    remedy = f"{what} lacks a factor in {format_dimension(lacking)}"
    number, divides = _literal_factor(e)
    if number is None:
        has_number = any(n.op == "const" and n.payload for n in nodes(e))
        return f"{remedy}; {_NUMBERS}" if has_number else f"{remedy}: check the declared units"
    unit = format_dimension(divide(DIMENSIONLESS, lacking) if divides else lacking)
    return f"{remedy}; if the number {number} is in {unit}: {_with_unit(number, unit)}"


def _literal_factor(e: Expr) -> tuple[Expr | None, bool]:
    """A literal factor or divisor of a product, and whether it divides."""
    stack = [(e, False)]
    while stack:
        here, divides = stack.pop()
        if here.op == "const" and not here.shape:
            return here, divides
        if here.op == "neg":
            stack.append((here.args[0], divides))
        elif here.op in ("mul", "div"):
            stack += [(here.args[1], divides != (here.op == "div")), (here.args[0], divides)]
    return None, False


def _with_unit(number: Expr, unit: str) -> str:
    return f'quantity({number}, "{unit}")'


def _short(e: Expr | Equation) -> str:
    """Text of an expression, limited to its outer levels if it is long."""
    text = str(e)
    if len(text) <= _LONGEST_TEXT:
        return text
    if isinstance(e, Equation):
        return f"{_short(e.left)} == {_short(e.right)}"
    return next(
        (t for depth in range(2, 12) if len(t := to_text(e, depth)) <= _LONGEST_TEXT), text[:_LONGEST_TEXT] + " ..."
    )
