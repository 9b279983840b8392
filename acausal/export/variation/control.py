"""Which error of its variations a step may have.

A step that is short enough for the states need not be so for their derivatives. A force k d**1.5 enters the velocity as
t**2.5 and its derivative as t**1.5 from the touch on: with steps of the states alone, at a tolerance of 1e-10, the
derivative was off by 1e-5, and by 6e-4 for a power of 1.2. What a small factor hides from the states is in the
derivatives by that factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.element import SMALL, Accuracy

# Share of the largest variation over the run below which its error is controlled absolutely.
LEAST_SHARE = 1e-5
# What rounding may do in a step, relative to the largest variation by the same parameter. What cancels, or is zero by
# symmetry, is known to this and no better.
ROUNDING = 1e-15
# So many steps of an interval may be refused for their variations: those that leave zero as a power of time take a few
# dozen, and where slopes are known to rounding only, shorter steps are no better.
MOST_REFUSED = 150
# Keeps what is zero from being divided by.
_TINY = 1e-290


@dataclass
class Control:
    """The errors that steps may have in variations, which are `x`, shape (nx, k), at the start of an interval.

    An error counts relative to the variation, and absolutely below `SMALL` of its largest value since the start and
    `LEAST_SHARE` of that over the run: where a variation leaves zero as a power of time, a first step has the same
    relative error, however short it is, and before a burst it may be a rounding error.
    """

    accuracy: Accuracy | None
    tolerance: float
    x: Vector
    refused: int = 0
    """Number of steps whose variations were not accurate enough."""

    def __post_init__(self) -> None:
        self._largest = np.abs(self.x)

    def allowed(self, before: Vector, after: Vector) -> Vector:
        """Errors of variations that go from `before` to `after` in a step, shapes (nx, k)."""
        assert self.accuracy is not None, "errors are asked for where they are controlled"
        scale = self.accuracy.scale
        size = np.maximum(np.abs(before), np.abs(after))
        rounding = ROUNDING * scale.max(axis=0, initial=0.0) + _TINY
        least = SMALL * np.maximum(self._largest, size) + LEAST_SHARE * scale
        return np.asarray(self.tolerance * (least + size) + rounding)

    def accepted(self, after: Vector) -> None:
        """Go on from `after`, shape (nx, k)."""
        if self.accuracy is not None:
            self._largest = np.maximum(self._largest, np.abs(after))
            self.accuracy.largest = np.maximum(self._largest, self.accuracy.largest)

    def judged(self, h: float, ratio: float, moved: Vector, errors: Vector) -> float:
        """The error of a step in what is allowed: `ratio`, or less where shorter steps would be no better.

        `moved`, shape (nx, k), is what the step adds to the variations, `errors` those of it. All of a step that is as
        short as the ends of the interval are known is uncertain.
        """
        assert self.accuracy is not None, "errors are asked for where they are controlled"
        if ratio <= 1:
            return ratio
        self.refused += 1
        short = h <= self.accuracy.shortest
        if not short and self.refused < MOST_REFUSED:
            return ratio
        self.accuracy.missed(moved if short else errors)
        return 0.1 if short else 0.0  # the next one is longer, or as long as the states allow
