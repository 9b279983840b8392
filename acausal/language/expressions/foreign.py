"""Operators of Python and functions of numpy that expressions do not support; each is refused with a remedy."""

from __future__ import annotations

from typing import Any, NoReturn

from acausal.errors import DeclarationError

_REDUCTIONS = {
    "add": ("sum", "sum(v), Python's own, adds the elements of a vector"),
    "multiply": ("prod", "write the product out: v[0] * v[1]"),
    "maximum": ("max", "write maximum(v[0], v[1]) of acausal"),
    "minimum": ("min", "write minimum(v[0], v[1]) of acausal"),
}
"""Name of a reduction in numpy and advice, by the name of the function that it applies to the elements."""
_SHIFT = "compare by a < b; a shift of bits is a * 2**n, or floor(a / 2**n) with acausal.floor"


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
