"""Estimate of the error of a step from its defect: how far an interpolant of the step is from being a solution.

The interpolant is the cubic through the states and rates at both ends of the step. Its defect, the difference between
its slope and the rates on it, is the disturbance of the equations whose exact solution it is (W. H. Enright, Applied
Mathematics and Computation 31 (1989) 288-301; L. F. Shampine, Computers and Mathematics with Applications 49 (2005)
1541-1549). Therefore the defects of all steps, multiplied by their lengths, sum to the error of a run, except for how
the model propagates errors.

The difference from an embedded formula would cost two evaluations less, but misses kinks: for the classical method, the
difference between the fourth stage and the rates at the end is 0 for every y' = f(t), and no method here has a formula
that sees the interior of its step. Two points beside the middle detect a single kink wherever it is: the error of
Simpson's rule is at most 1.35 times the defect. A feature shorter than a quarter of a step can lie between the points.
For the classical method the estimate falls with the fourth power of the step or faster, its error with the fifth; for
the other methods both have the same power.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

# Inner points of the four-point Gauss-Lobatto formula.
_INSIDE = (0.5 - 0.05**0.5, 0.5 + 0.05**0.5)
# If the bends at both ends of a step differ by more than this ratio, the larger one is due to a transient.
_UNEVEN = 3.0
_UNKNOWN = float("inf")


def bends(h: Any, x: Any, first: Any, x1: Any, last: Any) -> tuple[Any, Any]:
    """Deviations of the rates at both ends of a step of length `h` from its mean rate, times `h`; each shape (nx,)."""
    return h * first - (x1 - x), h * last - (x1 - x)


def even(first: Any, last: Any) -> tuple[Any, Any]:
    """Bends limited to leave out transients: a rate that is large at one end only does not bend the solution."""
    limit = _UNEVEN * ca.fmin(ca.fabs(first), ca.fabs(last))
    return ca.fmax(-limit, ca.fmin(first, limit)), ca.fmax(-limit, ca.fmin(last, limit))


def defect(
    x: Any, x1: Any, bend: tuple[Any, Any], defect_at: Callable[[Any, Any, Any], Any], nominal: Any, share: Any = 1
) -> Any:
    """Largest defect in the first fraction `share` of a step from `x` to `x1`, times its length, relative to `nominal`.

    `defect_at(s, x, slope)`, shape (nx,), is the defect at the relative position `s`, where the interpolant has the
    value `x` and the slope `slope`; slopes and defects are multiplied by the length of the step. The result is infinite
    if a defect is nan.
    """
    worst: Any = 0
    first, last = bend
    norm = largest(x.numel())
    for position in _INSIDE:
        s = share * position
        point = x + s * (x1 - x) + s * (1 - s) * ((1 - s) * first - s * last)
        slope = x1 - x + (1 - s) * (1 - 3 * s) * first + s * (3 * s - 2) * last
        worst = ca.fmax(worst, norm(defect_at(s, point, slope) / nominal))
    return ca.if_else(share > 0, share * worst, 0)


def largest(size: int) -> Any:
    """Function of a vector of this size: its largest magnitude; infinite if an entry is nan, which fmax ignores."""
    v = ca.SX.sym("v", size)
    maximum: Any = ca.SX(0)
    for entry in ca.vertsplit(ca.fabs(v)):
        maximum = ca.fmax(maximum, entry)
    return ca.Function("largest", [v], [ca.if_else(ca.sum1(ca.fabs(v)) < _UNKNOWN, maximum, _UNKNOWN)])


def unsolved(failed: Any) -> Any:
    """Term to add to a defect: infinite if the algebraic variables could not be solved for."""
    return ca.if_else(failed, _UNKNOWN, 0)
