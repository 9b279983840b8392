"""Chebyshev interpolation at Lobatto points, for past signals and for inputs over one stretch of a run.

Source: L. N. Trefethen, Approximation Theory and Approximation Practice (2013), chapters 2 to 4 and 19.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector

INPUT_DEGREE = 7
"""Degree of the polynomial of an input over one stretch."""

INPUT_WIDTH = INPUT_DEGREE + 3
"""Number of modes for one input over time, in the same order as those of a delay."""

SLACK = 1e-3
"""Distance up to which a polynomial is extrapolated beyond its window, in half widths."""


def polynomial(window: Any, instant: Any) -> Any:
    """The signal at an instant, by Clenshaw's recurrence.

    `window` is a column of degree + 3 entries: the centre of the stretch, the reciprocal of its half width, and the
    coefficients.
    """
    s = ca.fmin(ca.fmax((instant - window[0]) * window[1], -1 - SLACK), 1 + SLACK)
    high, higher = ca.SX(0), ca.SX(0)
    for k in range(window.numel() - 3, 0, -1):
        high, higher = window[2 + k] + 2 * s * high - higher, high
    return window[2] + s * high - higher


@cache
def points(degree: int) -> Vector:
    """The extrema on [-1, 1] of the polynomial of this degree, ascending, shape (degree + 1,)."""
    nodes = -np.cos(np.pi * np.arange(degree + 1) / degree)
    nodes[0], nodes[-1] = -1.0, 1.0
    return nodes


@cache
def transform(degree: int) -> Vector:
    """The matrix from values at `points` to coefficients, shape (degree + 1, degree + 1)."""
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(points(degree), degree)), dtype=np.float64)


def fitted(values: Vector) -> Vector:
    """Coefficients from values at `points`, shape (degree + 1,) or (degree + 1, n); those of a constant are exact."""
    coefficients = transform(len(values) - 1) @ values
    is_constant = (values == values[0]).all(axis=0)
    if np.ndim(is_constant) == 0:
        return (
            np.append(values[0], np.zeros(len(values) - 1))
            if is_constant
            else np.asarray(coefficients, dtype=np.float64)
        )
    coefficients[:, is_constant] = 0.0
    coefficients[0, is_constant] = values[0, is_constant]
    return np.asarray(coefficients, dtype=np.float64)


def between(a: float, b: float, degree: int) -> Vector:
    """The points on [a, b], shape (degree + 1,); both ends are exact."""
    nodes = 0.5 * (a + b) + 0.5 * (b - a) * points(degree)
    nodes[0], nodes[-1] = a, b
    return nodes


def tail(coefficients: Vector) -> Vector:
    """Largest magnitude of the last three coefficients, by column: further ones would contribute less."""
    return np.asarray(np.abs(coefficients[-3:]).max(axis=0), dtype=np.float64)


def value(coefficients: Vector, s: Vector) -> Vector:
    """Values at points of [-1, 1]; `coefficients` has shape (degree + 1,)."""
    return np.asarray(np.polynomial.chebyshev.chebval(s, coefficients), dtype=np.float64)
