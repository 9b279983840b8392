"""The past values of signals, as polynomials over panels of time; before the run they are constant."""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from acausal.arrays import Vector
from acausal.lower.chebyshev import value


class Panel(NamedTuple):
    """A polynomial of n signals on [a, b] that is valid on [low, high] within it [s].

    `coefficients` are those of Chebyshev polynomials, shape (degree + 1, n).
    """

    low: float
    high: float
    a: float
    b: float
    coefficients: Vector


class History:
    """Panels in order and without gaps; the first one holds the constant values before the start of the run."""

    def __init__(self, start: float, values: Vector) -> None:
        self.start = start
        self.panels = [Panel(-np.inf, start, start - 1.0, start, values[None, :].copy())]
        self._lows = [-np.inf]

    @property
    def end(self) -> float:
        """The last instant for which values are stored [s]."""
        return self.panels[-1].high

    def put(self, panels: list[Panel]) -> None:
        """Insert panels, which replace those of the same time."""
        a, b = panels[0].low, panels[-1].high
        before = [p if p.high <= a else p._replace(high=a) for p in self.panels if p.low < a]
        after = [p if p.low >= b else p._replace(low=b) for p in self.panels if p.high > b]
        if before[-1].high < a:  # a gap due to rounding, where an instant was computed a second time
            before[-1] = before[-1]._replace(high=a)
        self.panels = [*before, *panels, *after]
        self._lows = [p.low for p in self.panels]

    def cut(self, t: float) -> None:
        """Drop the values after `t`, which belong to a trial that was rejected."""
        self.panels = [p if p.high <= t else p._replace(high=t) for p in self.panels if p.low < t]
        self._lows = [p.low for p in self.panels]

    def forget(self, t: float) -> None:
        """Drop panels that end before `t`, from time to time."""
        k = bisect_right(self._lows, t) - 1
        if k > 16:  # not at each call, which would copy the list
            self.panels = self.panels[k:]
            self._lows = [p.low for p in self.panels]

    def values(self, k: int, times: Vector) -> tuple[Vector, bool]:
        """Return signal k at ascending times, shape (n,), and whether a single panel holds all of them.

        At both ends the values are those just inside the interval.
        """
        margin = 1e-9 * float(times[-1] - times[0])
        low = max(0, bisect_right(self._lows, float(times[0]) + margin) - 1)
        high = max(low, bisect_right(self._lows, float(times[-1]) - margin) - 1)
        values = np.empty(len(times))
        panel_of = np.clip(np.searchsorted(self._lows, times, side="right") - 1, low, high)
        for j in range(low, high + 1):
            inside = panel_of == j
            if inside.any():
                p = self.panels[j]
                s = np.clip((2.0 * times[inside] - p.a - p.b) / (p.b - p.a), -1.0, 1.0)
                values[inside] = value(p.coefficients[:, k], s)
        return values, low == high

    def sides(self, t: float) -> tuple[Vector, Vector]:
        """All signals just before and just after an instant, each of shape (n,)."""
        k = bisect_right(self._lows, t) - 1
        after = self.panels[k]
        before = self.panels[k - 1] if k > 0 and after.low == t else after
        values = []
        for p in (before, after):
            s = np.clip(np.array([(2.0 * t - p.a - p.b) / (p.b - p.a)]), -1.0, 1.0)
            values.append(np.array([value(p.coefficients[:, j], s)[0] for j in range(p.coefficients.shape[1])]))
        return values[0], values[1]
