"""Chebyshev polynomials of a signal over one stretch of a run; their coefficients are numeric arguments."""

from __future__ import annotations

from typing import Any

import casadi as ca

INPUT_DEGREE = 7
"""Degree of the polynomial of an input over one stretch."""

INPUT_WIDTH = INPUT_DEGREE + 3
"""Number of modes that hold one input over time, in the same order as those of a delay."""

SLACK = 1e-3
"""How far a polynomial is extrapolated beyond its window, in half widths."""


def polynomial(window: Any, instant: Any) -> Any:
    """The signal at an instant, by Clenshaw's recurrence.

    `window`: column of degree + 3 entries: the middle of the stretch, the reciprocal of its half width, the
    coefficients.
    """
    s = ca.fmin(ca.fmax((instant - window[0]) * window[1], -1 - SLACK), 1 + SLACK)
    high, higher = ca.SX(0), ca.SX(0)
    for k in range(window.numel() - 3, 0, -1):
        high, higher = window[2 + k] + 2 * s * high - higher, high
    return window[2] + s * high - higher
