"""Estimate of the error of a step: how far a curve through it is from being a solution.

The curve is the cubic through the states and rates at both ends of the step. Its defect, its slope less the rates on
it, is the disturbance of the equations whose exact solution the computed states are (W. H. Enright, Applied Mathematics
and Computation 31 (1989) 288-301; L. F. Shampine, Computers and Mathematics with Applications 49 (2005) 1541-1549). So
the defects of all steps, by their lengths, sum up to the error of a run, but for what the model makes of errors.

The difference to an embedded formula would cost two evaluations less, and is blind where it matters: the fourth stage
of the classical method against the rates at its end is 0 for every y' = f(t), kinks included, and no method here has a
formula that sees inside its step. Two points off the middle leave no place of a single kink unseen: what Simpson's rule
makes of it is off by at most 1.35 times the defect. What is shorter than a quarter of a step can lie between the
points. For the classical method the estimate falls with the fourth power of a step or faster, its error with the fifth;
for the other methods the powers are the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

# Inner points of Lobatto's formula with four points.
_INSIDE = (0.5 - 0.05**0.5, 0.5 + 0.05**0.5)
# Ratio of the bends at both ends of a step beyond which the larger one is that of a transient.
_UNEVEN = 3.0
_UNKNOWN = float("inf")


def bends(h: Any, x: Any, first: Any, x1: Any, last: Any) -> tuple[Any, Any]:
    """Rates at both ends of a step of length `h`, each shape (nx,), less the slope between, times `h`."""
    return h * first - (x1 - x), h * last - (x1 - x)


def even(first: Any, last: Any) -> tuple[Any, Any]:
    """Bends without those of transients: a rate that is large at one end only does not bend the solution."""
    most = _UNEVEN * ca.fmin(ca.fabs(first), ca.fabs(last))
    return ca.fmax(-most, ca.fmin(first, most)), ca.fmax(-most, ca.fmin(last, most))


def defect(
    x: Any, x1: Any, bend: tuple[Any, Any], defect_at: Callable[[Any, Any, Any], Any], nominal: Any, share: Any = 1
) -> Any:
    """Largest defect in the first `share` of a step from `x` to `x1`, times its length, by the sizes of the states.

    `defect_at(s, x, slope)`, shape (nx,), is the defect at a relative position and point of the curve, all by the
    length of the step. Infinite where there is a point at which it is unknown.
    """
    worst: Any = 0
    first, last = bend
    sized = largest(x.numel())
    for part in _INSIDE:
        s = share * part
        point = x + s * (x1 - x) + s * (1 - s) * ((1 - s) * first - s * last)
        slope = x1 - x + (1 - s) * (1 - 3 * s) * first + s * (3 * s - 2) * last
        worst = ca.fmax(worst, sized(defect_at(s, point, slope) / nominal))
    return ca.if_else(share > 0, share * worst, 0)


def largest(size: int) -> Any:
    """Function of the largest magnitude in a vector of this size; infinite if one is nan, which a maximum ignores."""
    v = ca.SX.sym("v", size)
    most: Any = ca.SX(0)
    for entry in ca.vertsplit(ca.fabs(v)):
        most = ca.fmax(most, entry)
    return ca.Function("largest", [v], [ca.if_else(ca.sum1(ca.fabs(v)) < _UNKNOWN, most, _UNKNOWN)])


def unsolved(failed: Any) -> Any:
    """To be added to a defect: infinite where algebraic variables could not be found."""
    return ca.if_else(failed, _UNKNOWN, 0)
