"""Models with delays, and an independent method of steps to compare them with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from acausal import Component, Equations, Real, delay, der, fixed, parameter, variable

Vector = NDArray[np.float64]


def by_steps(
    rate: Callable[[float, Vector, Vector], Sequence[float]], start: Sequence[float], length: float, stop: float
) -> Callable[[float], Vector]:
    """The solution of x' = rate(t, x, x(t - length)) by SciPy's DOP853 at its tightest, from one delay to the next."""
    pieces: list[tuple[float, Any]] = []
    first = np.array(start, dtype=float)

    def past(t: float) -> Vector:
        if t <= 0.0:
            return first
        return np.asarray(next(s for a, s in reversed(pieces) if t >= a - 1e-13)(t))

    x = first
    for a, b in pairwise([*np.arange(0.0, stop - 1e-9, length).tolist(), stop]):
        found = solve_ivp(
            lambda t, x: rate(t, x, past(t - length)),
            (a, b),
            x,
            method="DOP853",
            rtol=2.3e-14,
            atol=1e-14,
            dense_output=True,
            max_step=(b - a) / 20,
        )
        pieces.append((a, found.sol))
        x = found.y[:, -1]
    return past


class Decay(Component):
    """x' = -x(t - T), x = 1 before."""

    T: Real = parameter(default=1.0, unit="s")
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -delay(self.x, self.T)


class MackeyGlass(Component):
    """M. C. Mackey, L. Glass, Oscillation and chaos in physiological control systems, Science 197 (1977)."""

    x: Real = variable(default=fixed(1.2))

    def equations(self) -> Equations:
        past = delay(self.x, 17.0)
        yield der(self.x) == 0.2 * past / (1.0 + past**10) - 0.1 * self.x


class DeadTime(Component):
    """A PI controller and a lag with a dead time of 0.4 s in its sensor."""

    x: Real = variable(default=fixed(0.0))
    i: Real = variable(default=fixed(0.0))
    e: Real = variable()

    def equations(self) -> Equations:
        yield self.e == 1.0 - delay(self.x, 0.4)
        yield der(self.i) == self.e
        yield der(self.x) == 1.2 * self.e + 0.8 * self.i - self.x


class Regenerative(Component):
    """x'' + 2 d x' + x = -k (x - x(t - T)): a tool that cuts where it cut one turn ago, in its own time scale."""

    d: Real = parameter(default=0.03)
    k: Real = parameter(default=0.06)
    T: Real = parameter(default=3.0, unit="s")
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -2.0 * self.d * self.v - self.x - self.k * (self.x - delay(self.x, self.T))
