"""Functions of the language. They take expressions and numbers; `math` and `numpy` functions do not.

Functions of one or two scalars also work on vectors of shape (n,), element by element; a scalar argument is repeated if
the other one is a vector. The result has the shape of the longer argument, and the unit of the arguments unless stated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from acausal.errors import DeclarationError, UnitError
from acausal.language.expressions.arrays import sizes
from acausal.language.expressions.expression import (
    Expr,
    Operand,
    Operation,
    as_expr,
    checked_condition,
    elementwise,
    is_literal,
    shape_error,
)
from acausal.units import in_si

time = Operation("time", (), ())
"""The independent variable [s]."""

UNARY = "sin cos tan asin acos atan sinh cosh tanh exp log sqrt fabs sign floor ceil".split()  # noqa: SIM905
"""Names as in CasADi, so that lowering is a table of the same names."""
_CONSTANT_FOLDING = {name: getattr(math, name) for name in UNARY if hasattr(math, name)}


def _unary(op: str, x: Operand) -> Expr:
    e = as_expr(x)
    if e.op == "const" and not e.shape and op in _CONSTANT_FOLDING:
        try:
            return as_expr(float(_CONSTANT_FOLDING[op](e.payload)))
        except (ValueError, OverflowError) as error:
            raise DeclarationError(
                "AC107", f"{op}({e.payload:g}) has no value", help=f"{op} is not defined for this number"
            ) from error
    return elementwise(op, e)


def sin(x: Operand) -> Expr:
    """Sine [1] of an angle [rad], a scalar or a vector."""
    return _unary("sin", x)


def cos(x: Operand) -> Expr:
    """Cosine [1] of an angle [rad], a scalar or a vector."""
    return _unary("cos", x)


def tan(x: Operand) -> Expr:
    """Tangent [1] of an angle [rad], a scalar or a vector."""
    return _unary("tan", x)


def asin(x: Operand) -> Expr:
    """Inverse sine [rad] of a number [1], from -pi/2 to pi/2; a scalar or a vector."""
    return _unary("asin", x)


def acos(x: Operand) -> Expr:
    """Inverse cosine [rad] of a number [1], from 0 to pi; a scalar or a vector."""
    return _unary("acos", x)


def atan(x: Operand) -> Expr:
    """Inverse tangent [rad] of a number [1], from -pi/2 to pi/2; a scalar or a vector."""
    return _unary("atan", x)


def sinh(x: Operand) -> Expr:
    """Hyperbolic sine [1] of a number [1], a scalar or a vector."""
    return _unary("sinh", x)


def cosh(x: Operand) -> Expr:
    """Hyperbolic cosine [1] of a number [1], a scalar or a vector."""
    return _unary("cosh", x)


def tanh(x: Operand) -> Expr:
    """Hyperbolic tangent [1] of a number [1], a scalar or a vector."""
    return _unary("tanh", x)


def exp(x: Operand) -> Expr:
    """Exponential function [1] of a number [1], a scalar or a vector."""
    return _unary("exp", x)


def log(x: Operand) -> Expr:
    """Natural logarithm [1] of a number [1], a scalar or a vector."""
    return _unary("log", x)


def sqrt(x: Operand) -> Expr:
    """Square root of a scalar, or of each element of a vector; of m2 it is in m."""
    return _unary("sqrt", x)


def fabs(x: Operand) -> Expr:
    """Absolute value of a scalar, or of each element of a vector; `abs(x)` is the same."""
    return _unary("fabs", x)


def sign(x: Operand) -> Expr:
    """-1, 0 or 1 [1], as `x` is negative, zero or positive; of a vector, element by element."""
    return _unary("sign", x)


def floor(x: Operand) -> Expr:
    """Largest integer not above `x`; each step is an event, except below `no_event` and in the values of a `when`."""
    return _unary("floor", x)


def ceil(x: Operand) -> Expr:
    """Smallest integer not below `x`; events as for `floor`."""
    return _unary("ceil", x)


def atan2(y: Operand, x: Operand) -> Expr:
    """Angle of the point (x, y) [rad], from -pi to pi; `x` and `y` have one unit."""
    return elementwise("atan2", as_expr(y), as_expr(x))


def minimum(x: Operand, y: Operand) -> Expr:
    """The smaller of two scalars; of two vectors of one length, element by element."""
    return elementwise("min", as_expr(x), as_expr(y))


def maximum(x: Operand, y: Operand) -> Expr:
    """The larger of two scalars; of two vectors of one length, element by element."""
    return elementwise("max", as_expr(x), as_expr(y))


def clamp(x: Operand, low: Operand, high: Operand) -> Expr:
    """`x` limited to the interval from `low` to `high`, all of one unit; of a vector, element by element."""
    return minimum(maximum(x, low), high)


def where(condition: Expr, a: Operand, b: Operand, *, smooth: bool = False) -> Expr:
    """`a` where `condition` holds, else `b`: Modelica's `if condition then a else b`.

    `a` and `b` have one unit and one shape, which are those of the result; a literal number adapts. A vector of
    conditions chooses element by element, between vectors of its length or scalars.

    `smooth=True` promises that the value and its derivative are continuous across the switch, so that no
    crossing has to be located.
    """
    x, y = as_expr(a), as_expr(b)
    several = checked_condition(condition, several=True).shape
    if several and not {several, x.shape, y.shape} <= {several, ()}:
        raise shape_error("where", condition, x, y)
    if x.shape != y.shape and not several and not (is_literal(x) or is_literal(y)):
        raise shape_error("where", x, y)
    return Operation("where", (condition, x, y), several or x.shape or y.shape, smooth)


def homotopy(actual: Operand, simplified: Operand) -> Expr:
    """`actual`; if no start is found with it, the search begins with `simplified` and transforms it into `actual`.

    Both have one shape and one unit, which are those of the result.

    Source: Modelica language 3.6, section 3.7.4.4; M. Sielemann et al., Robust initialization of DAE models using
    homotopy, 8th Modelica Conference (2011).
    """
    a, s = as_expr(actual), as_expr(simplified)
    if a.shape != s.shape and not (is_literal(a) or is_literal(s)):
        raise shape_error("homotopy", a, s)
    return Operation("homotopy", (a, s), a.shape or s.shape)


def quantity(value: float | Sequence[Any], unit: str) -> Expr:
    """A number with a unit, or a vector or matrix of such numbers, converted to SI: `quantity(9.81, "m/s2")`.

    Literal numbers are dimensionless in sums and products; this one has the dimension of `unit`. A temperature scale
    means a temperature: `quantity(20, "degC")` is 293.15 K; a difference is given in K.

    Raises
    ------
    DeclarationError
        AC106 when `value` is no number.
    UnitError
        AC150 for an unknown unit.
    """
    if not isinstance(unit, str):
        raise UnitError("AC150", f"quantity: the unit is {unit!r}, not a text", help='write quantity(9.81, "m/s2")')
    given = as_expr(value)
    if given.op != "const":
        raise DeclarationError(
            "AC106",
            f"quantity(`{given}`, {unit!r}): `{given}` is no number",
            help=f"multiply a variable by a unit: {given} * quantity(1, {unit!r})",
        )
    numbers = given.payload if given.shape else (given.payload,)
    si = tuple(in_si(v, unit) for v in numbers)
    number = Operation("const", (), given.shape, si if given.shape else si[0])
    return Operation("quantity", (number,), given.shape, (given.payload, unit))


def unitless(x: Operand) -> Expr:
    """The value of `x` in SI units as a plain number without a unit; `x` has any shape.

    Use it where a formula takes a quantity as a pure number, for example the argument of a measured characteristic.
    """
    e = as_expr(x)
    return Operation("unitless", (e,), e.shape)


def der(x: Operand) -> Expr:
    """Time derivative of an expression of any shape, in its unit per second; `der(der(x))` for the second."""
    e = as_expr(x)
    return Operation("der", (e,), e.shape)


def dot(x: Operand, y: Operand) -> Expr:
    """Scalar product of two vectors of shape (n,): a scalar, in the product of their units."""
    a, b = as_expr(x), as_expr(y)
    if len(a.shape) != 1 or a.shape != b.shape:
        raise shape_error("dot", a, b)
    return Operation("matmul", (a, b), ())


def cross(x: Operand, y: Operand) -> Expr:
    """Vector product of two vectors of shape (3,): of shape (3,), in the product of their units."""
    a, b = as_expr(x), as_expr(y)
    if a.shape != (3,) or b.shape != (3,):
        raise shape_error("cross", a, b)
    return Operation("cross", (a, b), (3,))


def norm(x: Operand) -> Expr:
    """Euclidean length of a vector of shape (n,): a scalar, in its unit. Its derivative does not exist at length 0."""
    e = as_expr(x)
    return sqrt(dot(e, e))


def skew(x: Operand) -> Expr:
    """The matrix S of shape (3, 3) with S @ v == cross(x, v), for a vector `x` of shape (3,), in the unit of `x`."""
    e = as_expr(x)
    if e.shape != (3,):
        raise shape_error("skew", e)
    return as_expr(((0.0, -e[2], e[1]), (e[2], 0.0, -e[0]), (-e[1], e[0], 0.0)))


def identity(n: int = 3) -> Expr:
    """The unit matrix of shape (n, n), without unit; DeclarationError AC110 when `n` is no number of elements."""
    (size,) = sizes("identity", n)
    return as_expr([[1.0 if i == j else 0.0 for j in range(size)] for i in range(size)])


def zeros(*shape: int) -> Expr:
    """A vector `zeros(n)` or a matrix `zeros(m, n)` of literal zeros, which adapt to any unit.

    Raises
    ------
    DeclarationError
        AC110 when a size is no number of elements, or there are more than two.
    """
    counts = sizes("zeros", *shape)
    return Operation("const", (), counts, (0.0,) * math.prod(counts) if counts else 0.0)
