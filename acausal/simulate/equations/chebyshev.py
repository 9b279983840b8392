"""Polynomials in Chebyshev's basis through their values at Lobatto's points.

Source: L. N. Trefethen, Approximation Theory and Approximation Practice (2013), chapters 2 to 4 and 19.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from acausal.arrays import Vector


@cache
def points(degree: int) -> Vector:
    """The extrema of the polynomial of that degree on [-1, 1], ascending, shape (degree + 1,)."""
    found = -np.cos(np.pi * np.arange(degree + 1) / degree)
    found[0], found[-1] = -1.0, 1.0
    return found


@cache
def transform(degree: int) -> Vector:
    """The matrix from values at `points` to coefficients, shape (degree + 1, degree + 1)."""
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(points(degree), degree)), dtype=np.float64)


def fitted(values: Vector) -> Vector:
    """Coefficients from values at `points`, column by column; those of a constant are exact."""
    found = transform(len(values) - 1) @ values
    still = (values == values[0]).all(axis=0)
    if np.ndim(still) == 0:
        return np.append(values[0], np.zeros(len(values) - 1)) if still else np.asarray(found, dtype=np.float64)
    found[:, still] = 0.0
    found[0, still] = values[0, still]
    return np.asarray(found, dtype=np.float64)


def between(a: float, b: float, degree: int) -> Vector:
    """The points on [a, b], shape (degree + 1,); both ends are exact."""
    found = 0.5 * (a + b) + 0.5 * (b - a) * points(degree)
    found[0], found[-1] = a, b
    return found


def tail(coefficients: Vector) -> Vector:
    """Size of the last coefficients, by column: what further ones would change is smaller."""
    return np.asarray(np.abs(coefficients[-3:]).max(axis=0), dtype=np.float64)


def value(coefficients: Vector, s: Vector) -> Vector:
    """Values at points of [-1, 1]; `coefficients` has shape (degree + 1,)."""
    return np.asarray(np.polynomial.chebyshev.chebval(s, coefficients), dtype=np.float64)
