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
# Now and then a step is refused to one so many times shorter. The error of a smooth solution then falls by at least the
# fourth power of that, the error of slopes that are known to rounding by its first: by no more than `NOISE`. What falls
# by less than half is a pulse that neither step resolves, and so may be what is as large as `LARGE`.
PROBE, NOISE, UNRESOLVED, LARGE = 1 / 16, 1e-3, 0.5, 20.0
# Keeps what is zero from being divided by.
_TINY = 1e-290


@dataclass
class Control:
    """The errors that steps may have in variations, which are `x`, shape (nx, k), at the `start` [s] of an interval.

    `x` may have k more columns, see `Interval`.

    An error counts relative to the variation, and absolutely below `SMALL` of its largest value since the start and
    `LEAST_SHARE` of that over the run: where a variation leaves zero as a power of time, a first step has the same
    relative error, however short it is, and before a burst it may be a rounding error. Where slopes are known to
    rounding only, shorter steps are more steps of the same error in sum: it is noted, and the steps are longer.
    """

    accuracy: Accuracy | None
    tolerance: float
    x: Vector
    start: float
    refused: int = 0
    """Number of steps whose variations were not accurate enough."""
    due: int = 2
    """That number from which on the next one is shortened by `PROBE`."""
    noise: float = 0.0
    """The error by rounding in what is allowed, for each second of a step [1/s]."""
    probed: tuple[float, float] | None = None
    """Length [s] and error of a step that was refused to a much shorter one."""
    missed: Vector | None = None
    """Errors, shape (nx, k), of the last step that shorter ones would not make smaller."""

    def __post_init__(self) -> None:
        self.count = self.x.shape[1] if self.accuracy is None else self.accuracy.scale.shape[1]
        self._largest = np.abs(self.x[:, : self.count])

    def allowed(self, before: Vector, after: Vector) -> Vector:
        """Errors of variations that go from `before` to `after` in a step, shapes (nx, k)."""
        assert self.accuracy is not None, "errors are asked for where they are controlled"
        scale = self.accuracy.scale
        size = np.maximum(np.abs(before), np.abs(after))
        rounding = ROUNDING * scale.max(axis=0, initial=0.0) + _TINY
        least = SMALL * np.maximum(self._largest, size) + LEAST_SHARE * scale
        return np.asarray(self.accuracy.loose * self.tolerance * (least + size) + rounding)

    def accepted(self, after: Vector) -> Vector:
        """Go on from `after`, with the columns of `x`, to which the errors of the step are added."""
        if self.accuracy is not None:
            self._largest = np.maximum(self._largest, np.abs(after[:, : self.count]))
            self.accuracy.largest = np.maximum(self._largest, self.accuracy.largest)
        if self.missed is not None and self.accuracy is not None:
            self.accuracy.noted = True
        if self.missed is not None and after.shape[1] > self.count:
            after = after + np.hstack([np.zeros_like(self.missed), self.missed])
        return after

    def shorter(self, factor: float) -> float:
        """The factor by which a refused step is shortened, instead of `factor`."""
        return factor if self.probed is None else PROBE

    def judged(
        self, t: float, h: float, ratio: float, moved: Vector, errors: Vector, whole: float | None = None
    ) -> float:
        """The error of a step from `t` [s] in what is allowed: `ratio`, or less where shorter steps would be no better.

        `moved`, shape (nx, k), is what the step adds to the variations, `errors` those of it. All of a step that is as
        short as the ends of the interval are known is uncertain. `whole` is the ratio before rounding is allowed for.
        """
        assert self.accuracy is not None, "errors are asked for where they are controlled"
        self.missed = None
        if self.probed is not None:
            (before, larger), self.probed = self.probed, None
            if NOISE * larger < ratio < UNRESOLVED * larger:
                self.noise = max(self.noise, 2 * larger / before)
        is_noise = 0 < ratio <= self.noise * h
        if is_noise or ratio <= 1:
            if (ratio if whole is None else whole) > 1:
                self.missed = errors
            # below one, too: steps would hover where rounding is what is allowed
            return float(min(ratio, (ratio / (self.noise * h)) ** 4)) if is_noise else ratio
        self.refused += 1
        short = h <= self.accuracy.shortest
        if not short and self.refused < MOST_REFUSED:
            # at the start of an interval a power of time has the same relative error in steps of every length
            if self.refused >= self.due and ratio < LARGE and h < 0.1 * (t - self.start):
                self.probed, self.due = (h, ratio), 2 * self.due
            return ratio
        self.missed = moved if short else errors
        return 0.1 if short else 0.0  # the next one is longer, or as long as the states allow
