"""A delayed signal over one stretch of a run: a polynomial in Chebyshev's basis, whose coefficients are numbers."""

from __future__ import annotations

from typing import Any

import casadi as ca

DEGREE = 24
"""Degree of the polynomial of one delayed signal over one stretch."""

WIDTH = DEGREE + 3
"""Numbers of one delay: centre of the window in the past [s], one over half its width [1/s], coefficients."""

SLACK = 1e-3
"""How far beyond its window a polynomial is followed, in half widths."""


def delayed(window: Any, instant: Any) -> Any:
    """A delayed signal at an instant of the past, by Clenshaw's recurrence; `window` are its numbers."""
    s = ca.fmin(ca.fmax((instant - window[0]) * window[1], -1 - SLACK), 1 + SLACK)
    high, higher = ca.SX(0), ca.SX(0)
    for k in range(DEGREE, 0, -1):
        high, higher = window[2 + k] + 2 * s * high - higher, high
    return window[2] + s * high - higher
