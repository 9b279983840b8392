"""Tables as external functions: a binary search for the segment, and the polynomial there.

A tree of `where` on the abscissas would compute both sides of each of its decisions, whatever the solver: ten thousand
rows would be ten thousand operations for each value, and as many lines of C.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn
from weakref import WeakValueDictionary

from acausal.errors import DeclarationError
from acausal.language.expressions.external import External

_CACHE: WeakValueDictionary[Any, Lookup] = WeakValueDictionary()


def lookup(breaks: Sequence[float], coefficients: Sequence[Sequence[float]], name: str = "table") -> Lookup:
    """A piecewise polynomial; equal arguments return one object, so that models that contain it are equal."""
    key = tuple(breaks), tuple(map(tuple, coefficients)), name
    found = _CACHE.get(key)
    if found is None:
        found = _CACHE[key] = Lookup(*key)
    return found


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
        self._slope: Lookup | None = None

    @property
    def partials(self) -> External:
        """Its derivative, a polynomial of one degree less on each segment.

        Raises DeclarationError: AC128 for a step function, which has no derivative.
        """
        if len(self.coefficients[0]) == 1:
            raise DeclarationError(
                "AC128",
                f"the time derivative of the slope of a {self.name} is needed and does not exist",
                cause="a table of straight segments is differentiated twice; its slope jumps at every row",
                help="give the table as speed or acceleration instead of position, or a smooth one: CombiTable1D with "
                "smoothness=Smoothness.CONTINUOUS_DERIVATIVE on time",
            )
        if self._slope is None:
            below = [[k * c for k, c in enumerate(row)][1:] for row in self.coefficients]
            self._slope = lookup(self.breaks, below, self.name)
        return self._slope

    def __reduce__(self) -> tuple[Any, ...]:
        return lookup, (self.breaks, self.coefficients, self.name)


def _no_factory() -> NoReturn:
    raise AssertionError("a lookup is made from its points when it is lowered")
