"""Tables as external functions: a binary search for the segment, and evaluation of its polynomial.

A tree of `where` on the abscissas would compute both branches of each decision, whatever the solver: ten thousand rows
would be ten thousand operations for each value, and as many lines of C.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import isfinite
from typing import Any, NoReturn
from weakref import WeakValueDictionary

from acausal.errors import DeclarationError
from acausal.language.expressions.expression import Expr
from acausal.language.expressions.external import External

# A jump smaller than this fraction of the terms counts as a rounding error of the coefficients.
_ROUNDING = 1e-9
_CACHE: WeakValueDictionary[Any, Lookup] = WeakValueDictionary()


def lookup(breaks: Sequence[float], coefficients: Sequence[Sequence[float]], name: str = "table") -> Lookup:
    """A piecewise polynomial; equal arguments return one object, so that models that contain it are equal.

    Raises DeclarationError: AC160 when the breakpoints do not increase, the rows of coefficients do not match the
    segments or differ in length, or a value is not a finite number.
    """
    fault = _fault(breaks, coefficients)
    if fault:
        raise DeclarationError(
            "AC160",
            f"lookup: {fault}",
            help="lookup(breaks, coefficients) makes a function, which is called with its argument: "
            "lookup([0.0, 1.0, 2.0], [(5.0, 1.0), (6.0, 0.0)])(u); "
            "table(points, u) of acausal.library.blocks interpolates points",
        )
    key = tuple(breaks), tuple(map(tuple, coefficients)), name
    cached = _CACHE.get(key)
    if cached is None:
        cached = _CACHE[key] = Lookup(*key)
    return cached


def _fault(breaks: Sequence[float], coefficients: Sequence[Sequence[float]]) -> str:
    """The fault in the arguments of `lookup`; "" if there is none."""
    if isinstance(breaks, Expr):
        return f"`{breaks}` is given as breakpoints"
    try:
        rows = [tuple(map(float, row)) for row in coefficients]
        ends = tuple(map(float, breaks))
    except (TypeError, ValueError, DeclarationError):
        return "breakpoints, and a row of coefficients for each segment, are numbers"
    if not all(map(isfinite, (*ends, *(c for row in rows for c in row)))):
        return "a breakpoint or a coefficient is not finite"
    falling = next((k for k, (a, b) in enumerate(pairwise(ends)) if b <= a), None)
    if falling is not None:
        return f"breakpoint {falling + 2} of {len(ends)}, {ends[falling + 1]}, is not greater than the one before"
    if len(rows) != len(ends) - 1 or not rows:
        return f"{len(ends)} breakpoints have {max(len(ends) - 1, 0)} segments, but there are {len(rows)} rows"
    degrees = {len(row) for row in rows}
    return "" if len(degrees) == 1 and 0 not in degrees else "its rows have different lengths, or none"


class Lookup(External):
    """A piecewise polynomial of one variable as an external function.

    Parameters
    ----------
    breaks
        Abscissas, strictly increasing, shape (n,); the first and the last segment are extrapolated.
    coefficients
        Of (u - breaks[k]) on segment k, the constant first, shape (n - 1, degree + 1).
    """

    def __init__(self, breaks: Sequence[float], coefficients: Sequence[Sequence[float]], name: str = "table") -> None:
        super().__init__(name, _no_factory, inputs=((),), outputs=((),))
        self.breaks = tuple(breaks)
        self.coefficients = tuple(map(tuple, coefficients))
        self.has_jumps = any(self._jumps())
        self._slope: Lookup | None = None

    def _jumps(self) -> Iterator[bool]:
        """For each inner breakpoint, whether the polynomials of its sides differ there beyond rounding errors."""
        for (a, b), row, next_row in zip(pairwise(self.breaks), self.coefficients, self.coefficients[1:], strict=False):
            terms = [c * (b - a) ** k for k, c in enumerate(row)]
            yield abs(sum(terms) - next_row[0]) > _ROUNDING * max(map(abs, (*terms, next_row[0])))

    @property
    def partials(self) -> External:
        """The derivative between breakpoints, a polynomial of one degree less on each segment."""
        if self._slope is None:
            derivative = [[k * c for k, c in enumerate(row)][1:] or [0.0] for row in self.coefficients]
            self._slope = lookup(self.breaks, derivative, self.name)
        return self._slope

    def __reduce__(self) -> tuple[Any, ...]:
        return lookup, (self.breaks, self.coefficients, self.name)


def _no_factory() -> NoReturn:
    raise AssertionError("a lookup is made from its points when it is lowered")
