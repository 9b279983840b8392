"""Vectors composed of parts, and elements of vector expressions and equations."""

from __future__ import annotations

from operator import index
from typing import SupportsIndex

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import (
    Equation,
    Expr,
    Operand,
    Operation,
    Symbol,
    as_expr,
    constant,
    shape_error,
)

_LONGEST_WHOLE = 3
"""Equations between vectors up to this length, such as vectors in space, are printed as a whole."""
_DEEPEST = 16
"""Depth up to which an element of an expression is expressed by elements of its operands."""
_WHOLE = frozenset(("matmul", "cross", "transpose", "call"))


def concatenate(*parts: Operand) -> Expr:
    """Scalars and vectors joined into one vector: `concatenate(self.u_a, self.u, self.u[-1])`.

    All parts have the same unit. For a scalar and a vector of shape (n,) the result has shape (n + 1,).

    Raises
    ------
    DeclarationError
        AC105 for a matrix, or without parts.
    """
    operands = tuple(as_expr(p) for p in parts)
    if not operands or any(len(p.shape) > 1 for p in operands):
        raise shape_error("concatenate", *operands)
    return Operation("concatenate", operands, (sum(p.shape[0] if p.shape else 1 for p in operands),))


def fill(x: Operand, n: int) -> Expr:
    """A vector of shape (n,) whose elements are all the scalar `x`, in the unit of `x`.

    Raises
    ------
    DeclarationError
        AC105 when `x` is no scalar, AC110 when `n` is no number of elements.
    """
    e = as_expr(x)
    if e.shape:
        raise shape_error("fill", e)
    return Operation("fill", (e,), sizes("fill", n, before=(f"`{e}`",)))


def sizes(function: str, *counts: SupportsIndex, before: tuple[str, ...] = ()) -> tuple[int, ...]:
    """The sizes of a vector or a matrix; raises DeclarationError AC110 if one is no number of elements.

    `before` are the arguments that precede them in the call, for the message.
    """
    try:
        checked = tuple(map(index, counts))
    except (TypeError, DeclarationError):
        checked = (0,)
    if len(counts) > 2 or any(isinstance(n, bool) for n in counts) or min(checked, default=1) < 1:
        call = f"{function}({', '.join(map(str, (*before, *counts)))})"
        raise DeclarationError(
            "AC110",
            f"{call}: a size is a whole number of elements",
            help=f"write {function} with sizes of at least 1: 3, or a structural n",
        )
    return checked


def element(e: Expr, k: int, depth: int = 0) -> Expr:
    """Element `k` of a vector, as an expression of elements: `u[3] - u[2]` for `u[1:] - u[:-1]` and 2."""
    if not e.shape:
        return e
    if isinstance(e, Symbol) or e.op in _WHOLE or len(e.shape) > 1 or depth > _DEEPEST:
        return Operation("index", (e,), (), (k,))
    if e.op == "const":
        return constant(e.payload[k])
    if e.op == "slice":
        return _sliced(e, k, depth)
    if e.op == "fill":
        return e.args[0]
    if e.op in ("concatenate", "stack"):
        for part in e.args:
            size = part.shape[0] if part.shape else 1
            if k < size:
                return element(part, k, depth)
            k -= size
    payload = e.payload
    if e.op == "quantity":
        payload = payload[0][k], payload[1]
    return Operation(e.op, tuple(element(a, k, depth + 1) for a in e.args), (), payload)


def _sliced(e: Expr, k: int, depth: int) -> Expr:
    indices, _ = e.payload
    if len(indices) == 1:
        return element(e.args[0], indices[0][k], depth)
    index = tuple(p[k] if isinstance(p, range) else p for p in indices)
    return Operation("index", (e.args[0],), (), index)


def one_of(equation: Equation, k: int) -> Equation:
    """Scalar equation `k` of an equation between long vectors; any other equation as a whole."""
    shape = equation.left.shape or equation.right.shape
    if len(shape) != 1 or shape[0] <= _LONGEST_WHOLE:
        return equation
    return Equation(element(equation.left, k), element(equation.right, k))
