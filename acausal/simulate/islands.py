"""Integrals of functions of time that act on nothing: solved apart, so that they neither cost steps nor lose accuracy.

Their rates are Chebyshev series on panels, halved until the series ends; integrated term by term, they give every
output time at once. Source: J. P. Boyd, Chebyshev and Fourier Spectral Methods (2001), chapter 2. An integrator per
segment costs three times as much, most of it to be made.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_ORDER = 16
_POINTS = np.cos(np.pi * (np.arange(_ORDER + 1) + 0.5) / (_ORDER + 1))
_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _ORDER)).T
"""Values at the points, as a row, times this are the coefficients of the series."""
_INTEGRAL = chebyshev.chebint(np.eye(_ORDER + 1), lbnd=-1, axis=1)
"""Coefficients times this are those of the integral from the left end."""
_SMALLEST = 1e-12
"""Width of a panel, relative to the whole, below which a jump of the rate is left as it is."""


def integrals(
    rates: Callable[[Vector], Vector], start: float, times: Vector, tolerance: float, absolute: float
) -> Vector:
    """Integrals from `start` to each of the ascending `times`, shape (nq, n).

    Parameters
    ----------
    rates
        Of instants of shape (m,), the rates, shape (nq, m).
    tolerance, absolute
        Accuracy of each integral, relative to its change and as it is.

    Raises
    ------
    RuntimeError
        A rate is not finite.
    """
    end = float(times[-1])
    found: list[Vector] = []
    total: Vector | float = 0.0
    # Last in, first out: panels leave the stack in the order of time.
    panels = [(start, end)]
    while panels:
        a, b = panels.pop()
        half = 0.5 * (b - a)
        values = rates(a + half * (1.0 + _POINTS))
        if not np.isfinite(values).all():
            raise RuntimeError("the solution is not finite")
        series = values @ _SERIES
        tail = 2.0 * half * np.abs(series[:, -3:]).max(axis=1)
        size = 2.0 * half * np.abs(values).max(axis=1)
        if (tail > absolute + tolerance * size).any() and b - a > _SMALLEST * (end - start):
            panels += [(a + half, b), (a, a + half)]
            continue
        integral = half * series @ _INTEGRAL
        at = (times[(times > a) & (times <= b)] - a) / half - 1.0
        found.append(total + integral @ chebyshev.chebvander(at, _ORDER + 1).T)
        # Every Chebyshev polynomial is 1 at the right end.
        total = total + integral.sum(axis=1, keepdims=True)
    return np.hstack(found)
