"""What some signals were, as polynomials over panels of time; before the run they are constant."""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from acausal.arrays import Vector
from acausal.lower.chebyshev import value


class Panel(NamedTuple):
    """A polynomial of all signals on [a, b], of which [low, high] counts; coefficients of shape (degree + 1, n)."""

    low: float
    high: float
    a: float
    b: float
    coefficients: Vector


class History:
    """Panels in order, without gaps, from the start of the run on; the first one stands for all that was before."""

    def __init__(self, start: float, values: Vector) -> None:
        self.start = start
        self.panels = [Panel(-np.inf, start, start - 1.0, start, values[None, :].copy())]
        self._lows = [-np.inf]

    @property
    def end(self) -> float:
        """How far it reaches."""
        return self.panels[-1].high

    def put(self, panels: list[Panel]) -> None:
        """Take panels in, in place of whatever was there."""
        a, b = panels[0].low, panels[-1].high
        before = [p if p.high <= a else p._replace(high=a) for p in self.panels if p.low < a]
        after = [p if p.low >= b else p._replace(low=b) for p in self.panels if p.high > b]
        if before[-1].high < a:  # an instant found once more, by rounding
            before[-1] = before[-1]._replace(high=a)
        self.panels = [*before, *panels, *after]
        self._lows = [p.low for p in self.panels]

    def cut(self, t: float) -> None:
        """Forget what lies after `t`: it was tried and did not happen."""
        self.panels = [p if p.high <= t else p._replace(high=t) for p in self.panels if p.low < t]
        self._lows = [p.low for p in self.panels]

    def forget(self, t: float) -> None:
        """Forget what lies before `t`, but for the first panel."""
        k = bisect_right(self._lows, t) - 1
        if k > 16:
            self.panels = self.panels[k:]
            self._lows = [p.low for p in self.panels]

    def values(self, k: int, times: Vector) -> tuple[Vector, bool]:
        """Signal k at ascending times, those at the ends as they are inside; and whether one panel holds them all."""
        margin = 1e-9 * float(times[-1] - times[0])
        low = max(0, bisect_right(self._lows, float(times[0]) + margin) - 1)
        high = max(low, bisect_right(self._lows, float(times[-1]) - margin) - 1)
        found = np.empty(len(times))
        place = np.clip(np.searchsorted(self._lows, times, side="right") - 1, low, high)
        for j in range(low, high + 1):
            here = place == j
            if here.any():
                p = self.panels[j]
                s = np.clip((2.0 * times[here] - p.a - p.b) / (p.b - p.a), -1.0, 1.0)
                found[here] = value(p.coefficients[:, k], s)
        return found, low == high

    def sides(self, t: float) -> tuple[Vector, Vector]:
        """All signals just before and just after an instant."""
        k = bisect_right(self._lows, t) - 1
        after = self.panels[k]
        before = self.panels[k - 1] if k > 0 and after.low == t else after
        found = []
        for p in (before, after):
            s = np.clip(np.array([(2.0 * t - p.a - p.b) / (p.b - p.a)]), -1.0, 1.0)
            found.append(np.array([value(p.coefficients[:, j], s)[0] for j in range(p.coefficients.shape[1])]))
        return found[0], found[1]
