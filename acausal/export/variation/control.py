"""Error control of variations: the error that a step may have in them.

A step that is short enough for the states need not be short enough for their derivatives. From touch on, a force
k d**1.5 enters the velocity as t**2.5 and its derivative as t**1.5: with steps controlled by the states alone, at a
tolerance of 1e-10, the derivative was off by 1e-5, and by 6e-4 for a power of 1.2. Also, a term that a small factor
hides from the states appears in the derivatives by that factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.export.variation.element import SMALL, Accuracy

# Below this fraction of its largest value over the run, the error of a variation is controlled absolutely.
LEAST_SHARE = 1e-5
# Rounding error of a step, relative to the largest variation by the same parameter. A variation that cancels, or is
# zero by symmetry, cannot be more accurate.
ROUNDING = 1e-15
# Maximum number of steps of an interval rejected because of their variations. Variations that leave zero as a power of
# time need a few dozen; where slopes have rounding errors, shorter steps are no better.
MOST_REFUSED = 150
# Now and then a rejected step is followed by one shortened by the factor `PROBE`. The error of a smooth solution then
# falls by at least the fourth power of this factor, the error due to rounding in slopes by its first power: by a factor
# above `NOISE`. An error that falls by less than half is due to a pulse that neither step resolves; one above `LARGE`
# may be, and is not probed.
PROBE, NOISE, UNRESOLVED, LARGE = 1 / 16, 1e-3, 0.5, 20.0
# So is an accepted one after so many of about the same length, which errors above `LIMITING` have kept from growing.
STREAK, LIMITING = 10, 0.1
# Avoids division by zero.
_TINY = 1e-290


@dataclass
class Control:
    """Error control of variations, which are `x`, shape (nx, k), at the `start` [s] of an interval.

    `x` may have k more columns, see `Interval`.

    An error is controlled relative to the variation, and absolutely below the fraction `SMALL` of its largest value
    since the start and the fraction `LEAST_SHARE` of its largest value over the run: where a variation leaves zero as a
    power of time, the first step has the same relative error, however short it is, and before a burst a variation may
    be a rounding error. Where slopes have rounding errors, shorter steps do not reduce the total error: it is noted,
    and the steps are longer.
    """

    accuracy: Accuracy | None
    tolerance: float
    x: Vector
    start: float
    refused: int = 0
    """Number of steps that were rejected because of their variations."""
    due: int = 2
    """Value of `refused` at which the next rejected step is followed by a probe."""
    noise: float = 0.0
    """Error due to rounding, in units of the allowed error, per second of a step [1/s]."""
    probed: tuple[float, float] | None = None
    """Length [s] and error of the step before a probe."""
    steady: float = 0.0
    """Length [s] of the steps of late."""
    streak: int = 0
    """Number of accepted steps of about this length, limited by their variations."""
    patience: int = STREAK
    """Value of `streak` at which the next accepted step is followed by a probe."""
    missed: Vector | None = None
    """Errors, shape (nx, k), of the last step that shorter ones would not reduce."""

    def __post_init__(self) -> None:
        self.count = self.x.shape[1] if self.accuracy is None else self.accuracy.scale.shape[1]
        self._largest = np.abs(self.x[:, : self.count])

    def allowed(self, before: Vector, after: Vector) -> Vector:
        """Allowed errors of variations that go from `before` to `after` in a step, shapes (nx, k)."""
        assert self.accuracy is not None, "errors are requested only if they are controlled"
        scale = self.accuracy.scale
        size = np.maximum(np.abs(before), np.abs(after))
        rounding = ROUNDING * scale.max(axis=0, initial=0.0) + _TINY
        least = SMALL * np.maximum(self._largest, size) + LEAST_SHARE * scale
        return np.asarray(self.accuracy.loose * self.tolerance * (least + size) + rounding)

    def accepted(self, after: Vector) -> Vector:
        """Continue from `after`; return it with the errors of the step added to its columns of errors."""
        if self.accuracy is not None:
            self._largest = np.maximum(self._largest, np.abs(after[:, : self.count]))
            self.accuracy.largest = np.maximum(self._largest, self.accuracy.largest)
        if self.missed is not None and self.accuracy is not None:
            self.accuracy.noted = True
        if self.missed is not None and after.shape[1] > self.count:
            after = after + np.hstack([np.zeros_like(self.missed), self.missed])
        return after

    def longer(self, h: float, whole: float, growth: float) -> float:
        """Length [s] of the step after an accepted one of length `h`, which the end of the interval may have cut."""
        if self.probed is not None:
            return h * PROBE
        return max(h * min(max(growth, 0.3), 8.0), whole if h < whole else 0.0)

    def shorter(self, factor: float) -> float:
        """Factor by which a rejected step is shortened: that of a probe if one is due, else `factor`."""
        return factor if self.probed is None else PROBE

    def judged(
        self, t: float, h: float, ratio: float, moved: Vector, errors: Vector, whole: float | None = None
    ) -> float:
        """Error of a step from `t` [s], in units of the allowed error: `ratio`, or less if shorter steps are no better.

        `moved`, shape (nx, k), is the change of the variations in the step, `errors` its errors. If a step is as short
        as the uncertainty of the interval's ends, all of its change is uncertain. `whole` is the ratio without the
        allowance for rounding.
        """
        assert self.accuracy is not None, "errors are requested only if they are controlled"
        self.missed = None
        if self.probed is not None:
            (before, larger), self.probed = self.probed, None
            if NOISE * larger < ratio < UNRESOLVED * larger:
                self.noise = max(self.noise, 2 * larger / before)
        is_noise = 0 < ratio <= self.noise * h
        if is_noise or ratio <= 1:
            if (ratio if whole is None else whole) > 1:
                self.missed = errors
            if not is_noise and self._is_stuck(t, h, ratio):
                self.probed = h, ratio
            # also for ratios below one: otherwise the step size would stay where rounding is the allowed error
            return float(min(ratio, (ratio / (self.noise * h)) ** 4)) if is_noise else ratio
        self.refused += 1
        short = h <= self.accuracy.shortest
        if not short and self.refused < MOST_REFUSED:
            # at the start of an interval, a power of time has the same relative error for steps of any length
            if self.refused >= self.due and ratio < LARGE and h < 0.1 * (t - self.start):
                self.probed, self.due = (h, ratio), 2 * self.due
            return ratio
        self.missed = moved if short else errors
        return 0.1 if short else 0.0  # the next step is longer, or as long as the states allow

    def _is_stuck(self, t: float, h: float, ratio: float) -> bool:
        """Whether an accepted step with this error is to be followed by a probe, as steps have not grown for long."""
        if ratio < LIMITING or not 0.5 * self.steady < h < 2.0 * self.steady:
            self.steady, self.streak = h, 0
            return False
        self.streak += 1
        if self.streak < self.patience or h >= 0.1 * (t - self.start):
            return False
        self.streak, self.patience = 0, 2 * self.patience
        return True
