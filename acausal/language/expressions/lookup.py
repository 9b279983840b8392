"""Tables as external functions: a binary search for the segment, and the polynomial there.

A tree of `where` on the abscissas would compute both sides of each of its decisions, whatever the solver: ten thousand
rows would be ten thousand operations for each value, and as many lines of C.
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

# Size of a jump that may be the rounding of coefficients, relative to their terms.
_ROUNDING = 1e-9
_CACHE: WeakValueDictionary[Any, Lookup] = WeakValueDictionary()


def lookup(breaks: Sequence[float], coefficients: Sequence[Sequence[float]], name: str = "table") -> Lookup:
    """A piecewise polynomial; equal arguments return one object, so that models that contain it are equal.

    Raises DeclarationError: AC160 when the breakpoints do not increase, the rows of coefficients are not one for each
    segment and of one length, or something is no finite number.
    """
    wrong = _wrong(breaks, coefficients)
    if wrong:
        raise DeclarationError(
            "AC160",
            f"lookup: {wrong}",
            help="lookup(breaks, coefficients) makes a function, to be called with its argument: "
            "lookup([0.0, 1.0, 2.0], [(5.0, 1.0), (6.0, 0.0)])(u); "
            "table(points, u) of acausal.library.blocks interpolates points",
        )
    key = tuple(breaks), tuple(map(tuple, coefficients)), name
    found = _CACHE.get(key)
    if found is None:
        found = _CACHE[key] = Lookup(*key)
    return found


def _wrong(breaks: Sequence[float], coefficients: Sequence[Sequence[float]]) -> str:
    """What is wrong with the arguments of `lookup`; "" if nothing is."""
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
        return f"breakpoint {falling + 2} of {len(ends)}, {ends[falling + 1]}, does not lie beyond the one before"
    if len(rows) != len(ends) - 1 or not rows:
        return f"{len(ends)} breakpoints have {max(len(ends) - 1, 0)} segments, and there are {len(rows)} rows"
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
        """For each inner breakpoint whether the polynomials of its sides differ there by more than rounding."""
        for (a, b), row, after in zip(pairwise(self.breaks), self.coefficients, self.coefficients[1:], strict=False):
            terms = [c * (b - a) ** k for k, c in enumerate(row)]
            yield abs(sum(terms) - after[0]) > _ROUNDING * max(map(abs, (*terms, after[0])))

    @property
    def partials(self) -> External:
        """Its derivative between breakpoints, a polynomial of one degree less on each segment."""
        if self._slope is None:
            below = [[k * c for k, c in enumerate(row)][1:] or [0.0] for row in self.coefficients]
            self._slope = lookup(self.breaks, below, self.name)
        return self._slope

    def __reduce__(self) -> tuple[Any, ...]:
        return lookup, (self.breaks, self.coefficients, self.name)


def _no_factory() -> NoReturn:
    raise AssertionError("a lookup is made from its points when it is lowered")
