"""Numerical damping or growth of an oscillation by BDF of order 1 to 5, at the steps of its error control."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

ORDERS = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class BdfEffect:
    """Effect of one order on one mode."""

    order: int
    step: float  # the step [s] whose local error is the tolerance
    # `per_period`, `over_run`: factors on the amplitude, in addition to the damping of the mode itself, over one period
    # and over the run.
    per_period: float
    over_run: float

    @property
    def effect(self) -> str:
        """`damps`, `grows` or `keeps`, within a thousandth over the run."""
        return "keeps" if abs(self.over_run - 1.0) < 1e-3 else "grows" if self.over_run > 1.0 else "damps"

    def content(self) -> dict[str, object]:
        """For JSON."""
        return {**vars(self), "effect": self.effect}


def bdf_effects(eigenvalue: complex, span: float, tolerance: float) -> tuple[BdfEffect, ...]:
    """Effects of all orders on an oscillating mode [1/s] over `span` seconds.

    The local error of order k is (h*|lambda|)**(k+1)/(k+1) of the amplitude; the step at which it is `tolerance`
    follows. The numerical solution is the root of sum((1 - 1/q)**j/j, j=1..k) = h*lambda next to exp(h*lambda).
    Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section V.1.
    """
    found = []
    period = 2.0 * math.pi / abs(eigenvalue.imag)
    for order in ORDERS:
        angle = min(((order + 1) * tolerance) ** (1.0 / (order + 1)), 1.0)
        step = angle / abs(eigenvalue)
        q = principal_root(order, step * eigenvalue)
        rate = (math.log(abs(q)) - step * eigenvalue.real) / step
        found.append(BdfEffect(order, step, _factor(rate * period), _factor(rate * span)))
    return tuple(found)


def principal_root(order: int, z: complex) -> complex:
    """The root of the characteristic equation of BDF that approximates exp(z)."""
    # in w = 1 - 1/q: w + w**2/2 + ... + w**k/k - z = 0, and w is small with z
    roots = np.roots([*(1.0 / j for j in range(order, 0, -1)), -z])
    wanted = 1.0 - np.exp(-z)
    w = complex(roots[int(np.argmin(np.abs(roots - wanted)))])
    return 1.0 / (1.0 - w)


def _factor(exponent: float) -> float:
    return math.exp(min(exponent, 700.0))
