"""Operators of Python and functions of numpy that expressions do not support; each is refused with a remedy."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from types import FrameType
from typing import Any, NoReturn

from acausal.errors import DeclarationError
from acausal.language.written import called_name, parsed, written

_REDUCTIONS = {
    "add": ("sum", "sum(v), Python's own, adds the elements of a vector"),
    "multiply": ("prod", "write the product out: v[0] * v[1]"),
    "maximum": ("max", "write maximum(v[0], v[1]) of acausal"),
    "minimum": ("min", "write minimum(v[0], v[1]) of acausal"),
}
"""Name of a reduction in numpy and advice, by the name of the function that it applies to the elements."""
_SHIFT = "compare by a < b; a shift of bits is a * 2**n, or floor(a / 2**n) with acausal.floor"

_SAME_NAME = frozenset("sin cos tan asin acos atan sinh cosh tanh exp log sqrt fabs floor ceil atan2".split())  # noqa: SIM905
_OF_MATH = {
    "pow": "x ** y",
    "fsum": "sum(v)",
    "hypot": "sqrt(x**2 + y**2), with acausal.sqrt",
    "log10": "log(x) / log(10), with acausal.log",
    "log2": "log(x) / log(2), with acausal.log",
    "isclose": "fabs(a - b) < tolerance, with acausal.fabs",
    "fmod": "a - b * floor(a / b), with acausal.floor",
    "copysign": "x * sign(y), with acausal.sign",
    "radians": "x * pi / 180",
    "degrees": "x * 180 / pi",
}
"""What to write instead of a function of Python's `math`."""


def truth_advice(frame: FrameType, parameters: Iterable[str]) -> str:
    """Advice where `frame` takes the truth value of an expression; `parameters` if it consists of these only."""
    instead = _instead_of_truth(frame)
    names = ", ".join(parameters)
    if names:
        return (
            f"declare {names} with structural(...) if equations depend on it; "
            f"for a value write {instead or 'where(...)'}"
        )
    return f"write {instead or 'where(condition, a, b) for a value, and & | ~ between conditions'}"


def _instead_of_truth(frame: FrameType) -> str:
    """What to write instead of the expression that `frame` computes; empty for an `if`."""
    node = parsed(written(frame.f_code, frame.f_lasti))
    match node:
        case ast.BoolOp(op, values):
            return (" & " if isinstance(op, ast.And) else " | ").join(map(_closed, values))
        case ast.UnaryOp(ast.Not(), operand):
            return f"~{_closed(operand)}"
        case ast.Compare(left, ops, comparators) if len(ops) > 1:
            sides = [left, *comparators]
            pairs = [ast.Compare(sides[k], [op], [sides[k + 1]]) for k, op in enumerate(ops)]
            return " & ".join(map(_closed, pairs))
        case ast.Call(_, args) if (name := called_name(node)) in ("max", "min"):
            shown = ", ".join(map(ast.unparse, args)) if len(args) == 2 else "a, b"
            return f"{name}imum({shown}), with acausal.{name}imum"
        case ast.Call() if called_name(node) in ("all", "any"):
            return "a & b" if called_name(node) == "all" else "a | b"
    return ""


def _closed(operand: ast.expr) -> str:
    shown = ast.unparse(operand)
    return shown if isinstance(operand, ast.Name | ast.Attribute | ast.Call | ast.Subscript) else f"({shown})"


def number_advice(frame: FrameType) -> str:
    """What to write instead of the function in `frame` that asks an expression for its number."""
    name = called_name(parsed(written(frame.f_code, frame.f_lasti)))
    if name in _SAME_NAME:
        return f"write {name}(...) with acausal.{name}: functions of math and numpy take numbers only"
    if name in _OF_MATH:
        return f"write {_OF_MATH[name]}: functions of math and numpy take numbers only"
    return "use acausal.sin, acausal.sqrt, acausal.fabs ... instead of the math and numpy functions"


class WithoutForeignOperators:
    """Base of expressions; without it these operators would be TypeErrors of Python, which give no remedy."""

    __slots__ = ()

    def _refused(self, text: str, instead: str) -> NoReturn:
        raise DeclarationError("AC104", f"`{text}` does not take symbolic operands", help=instead)

    def __mod__(self, other: object) -> NoReturn:
        self._refused(f"{self} % {other}", "write a - b * floor(a / b), with acausal.floor")

    def __rmod__(self, other: object) -> NoReturn:
        self._refused(f"{other} % {self}", "write a - b * floor(a / b), with acausal.floor")

    def __floordiv__(self, other: object) -> NoReturn:
        self._refused(f"{self} // {other}", "write floor(a / b), with acausal.floor")

    def __rfloordiv__(self, other: object) -> NoReturn:
        self._refused(f"{other} // {self}", "write floor(a / b), with acausal.floor")

    def __xor__(self, other: object) -> NoReturn:
        self._refused(f"{self} ^ {other}", "a power is a ** b; of conditions, exactly one holds: (a & ~b) | (b & ~a)")

    def __rxor__(self, other: object) -> NoReturn:
        self._refused(f"{other} ^ {self}", "a power is a ** b; of conditions, exactly one holds: (a & ~b) | (b & ~a)")

    def __divmod__(self, other: object) -> NoReturn:
        self._refused(f"divmod({self}, {other})", "write floor(a / b), and a - b * floor(a / b)")

    def __rdivmod__(self, other: object) -> NoReturn:
        self._refused(f"divmod({other}, {self})", "write floor(a / b), and a - b * floor(a / b)")

    def __lshift__(self, other: object) -> NoReturn:
        self._refused(f"{self} << {other}", _SHIFT)

    def __rlshift__(self, other: object) -> NoReturn:
        self._refused(f"{other} << {self}", _SHIFT)

    def __rshift__(self, other: object) -> NoReturn:
        self._refused(f"{self} >> {other}", _SHIFT)

    def __rrshift__(self, other: object) -> NoReturn:
        self._refused(f"{other} >> {self}", _SHIFT)

    def __format__(self, specification: str) -> str:
        if specification:
            text = f"`{self}` is symbolic and cannot be written as {specification!r}"
            raise DeclarationError("AC104", text, help="write it without a format, or print values of a result")
        return str(self)

    def __round__(self, digits: object = None) -> NoReturn:
        self._refused(f"round({self})", "write floor(x + 0.5), with acausal.floor")

    def __trunc__(self) -> NoReturn:
        self._refused(f"trunc({self})", "write sign(x) * floor(fabs(x)), with the functions of acausal")


def refuse_numpy(shown: str, function: Any, method: str) -> NoReturn:
    """Raise DeclarationError AC104 for a function of numpy called with the expression `shown`."""
    name = function.__name__
    help = f"use acausal.{name}, if there is one: numpy knows numbers only"
    if method == "reduce" and name in _REDUCTIONS:
        name, help = _REDUCTIONS[name]
    raise DeclarationError("AC104", f"numpy.{name} does not take the symbolic `{shown}`", help=help)
