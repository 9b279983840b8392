"""The first crossing of any guard between two points of a solution, bracketed by points that are all ends of steps.

At each point the distances of the guards and their rates are known. Between two points a guard is passed if its sign
changes. It may be passed there and back if the tangents at both ends meet near zero (a kink, `abs(x) < 1e-3`), or if
the Hermite cubic goes below zero. Such an interval gets another point, at the crossing or at the minimum of the cubic,
until no crossing is possible elsewhere. If a guard has a kink, `maximum(u, 1e-9)`, cubics may shorten the interval by
only a thousandth at a time. So if an interval was not halved, the next point is at the zero of the right-hand tangent,
and the one after that is the middle (R. P. Brent, Algorithms for Minimization without Derivatives, 1973, chapter 4).
New points are integrated and not interpolated, because dense output of stiff components is wrong by thousands of
tolerances. `native/bracketing.c` and `event_loop.c` do the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

# A dip gets a point if its tangents meet below this fraction of the sum of their fall and rise.
_LOW = 0.05
_MOST_POINTS = 400
# An interval in which a guard jumps is not divided if it is no longer than this multiple of the resolution of instants.
_FEW_INSTANTS = 2.0


@dataclass(frozen=True, eq=False)
class Node:
    """A point of the solution at time `t`: states, and of k guards the distances, their rates, and what counts as zero.

    `above`, `rate`, `near`: A guard is passed where `above` is negative, and on zero up to a distance of `near`; shape
    (k,).
    """

    t: float
    x: Vector
    above: Vector
    rate: Vector
    near: Vector


def first_crossing(left: Node, right: Node, instant: float, integrate: Callable[[Node, float], Node]) -> Node | None:
    """The node at which the first guard is reached between two nodes, or None.

    Raises RuntimeError if a guard oscillates faster than the points can follow.

    `instant`: Two times coincide if they are no farther apart than this [s].
    `integrate`: Returns the node at a time after another node.
    """
    start, pending = left, [right]
    earlier, last = np.inf, np.inf  # widths of the intervals that got the last two points
    for _ in range(_MOST_POINTS):
        right = pending[-1]
        passed = right.above < 0.0
        if (passed & (left.above <= left.near) & (left.rate < 0.0)).any() and left is not start:
            return left
        width = right.t - left.t
        wide = width > instant
        is_there = bool(passed.any()) and (not wide or bool((right.above >= -right.near)[passed].all()))
        # before one guard is reached, others may have been passed there and back
        possible = _possible(left, right, passed, is_there, by_tangent=width > 0.5 * last) if wide else iter(())
        trial = min(possible, default=None)
        if trial is None:
            if is_there:
                return right
            left = pending.pop()
            if not pending:
                return None
            continue
        if width > 0.5 * earlier:
            trial = 0.5 * (left.t + right.t)
        earlier, last = last, width
        if trial - left.t <= instant:
            if passed.any() and not is_there and width <= _FEW_INSTANTS * instant:
                return left
            trial = left.t + instant  # for a guard that jumps, a cubic through both sides crosses zero at once
        node = integrate(left, min(trial, right.t - 0.5 * instant))
        pending = [node] if (node.above < 0.0).any() else [*pending, node]  # in the first case the event is before it
    raise RuntimeError("no first crossing was found")


def is_clear(
    widths: Vector, left: tuple[Vector, Vector, Vector], right: tuple[Vector, Vector, Vector]
) -> NDArray[np.bool_]:
    """Whether no guard is passed in an interval, nor may be; shape (n,). The first test of `first_crossing`.

    `widths`: The lengths of n intervals [s]; shape (n,).
    `left`, `right`: Distances, rates and what counts as zero at their ends; shapes (n, guards).
    """
    near = np.maximum(left[2], right[2])
    a, b = left[1] * widths[:, None], right[1] * widths[:, None]
    may_pass = (left[0] + a / 3 < -near) | (right[0] - b / 3 < -near) | ((a < 0.0) & (b > 0.0)) | (right[0] < 0.0)
    return np.asarray(~may_pass.any(axis=1))


def _possible(
    left: Node, right: Node, passed: NDArray[np.bool_], is_there: bool, *, by_tangent: bool
) -> Iterator[float]:
    """Times in an interval at which a guard may be passed.

    Guards that are `passed` at its end are searched unless the end is their crossing, `is_there`: where their cubics
    fall below zero or, `by_tangent`, where their tangents at the end are zero.
    """
    width = right.t - left.t
    near = np.maximum(left.near, right.near)
    p0, p1, a, b = left.above, right.above, left.rate * width, right.rate * width
    for k in np.flatnonzero(passed).tolist() if not is_there else ():
        s = 1.0 - p1[k] / b[k] if by_tangent and b[k] < 0.0 else 0.0
        yield left.t + width * (float(s) if s > _LOW else _drop(*_numbers(p0, a, p1, b, k)))
    if not ((p0 + a / 3 < -near) | (p1 - b / 3 < -near) | ((a < 0.0) & (b > 0.0)))[~passed].any():
        return
    turning = ~passed & (a < 0.0) & (b > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        where = (p1 - p0 - b) / (a - b)
        low = p0 + a * where
        kinks = turning & ((low < -near) | ((low < _LOW * (b - a)) & (np.minimum(p0, p1) > near)))
    for k in np.flatnonzero(kinks).tolist():
        yield left.t + width * min(max(float(where[k]), 0.02), 0.98)
    # a cubic is nowhere below its Bezier control points
    for k in np.flatnonzero(~passed & ~kinks & ((p0 + a / 3 < -near) | (p1 - b / 3 < -near))).tolist():
        at, value = _lowest(*_numbers(p0, a, p1, b, k))
        if value < -near[k]:
            yield left.t + width * at


def _numbers(p0: Vector, a: Vector, p1: Vector, b: Vector, k: int) -> tuple[float, float, float, float]:
    """The values of one guard as Python floats: calculations with NumPy scalars take five times as long."""
    return float(p0[k]), float(a[k]), float(p1[k]), float(b[k])


def _cubic(p0: float, a: float, p1: float, b: float) -> tuple[float, float]:
    """Coefficients of s**2 and s**3 of the cubic from p0 with slope a at s = 0 to p1 with slope b at s = 1."""
    return 3 * (p1 - p0) - 2 * a - b, a + b - 2 * (p1 - p0)


def _turns(p0: float, a: float, p1: float, b: float) -> list[float]:
    """Where the slope of that cubic is zero inside (0, 1), ascending."""
    square, cube = _cubic(p0, a, p1, b)
    # the coefficients are scaled, because a frozen mode may lead to numbers whose squares overflow
    size = max(abs(square), abs(cube), abs(a), 1e-300)
    square, cube, a = square / size, cube / size, a / size
    inside = square * square - 3 * a * cube
    if not inside > 0.0:
        return []
    q = -(square + math.copysign(inside**0.5, square))
    found = [q / (3 * cube) if cube else 2.0, a / q if q else 2.0]
    return sorted(float(s) for s in found if 0.0 < s < 1.0)


def _value(p0: float, a: float, p1: float, b: float, s: float) -> float:
    square, cube = _cubic(p0, a, p1, b)
    return float(p0 + s * (a + s * (square + s * cube)))


def _lowest(p0: float, a: float, p1: float, b: float) -> tuple[float, float]:
    """Where the cubic is lowest inside (0, 1), and its value there; (0.5, inf) if its slope is zero nowhere."""
    found = [(_value(p0, a, p1, b, s), s) for s in _turns(p0, a, p1, b)]
    value, at = min(found, default=(np.inf, 0.5))
    return at, value


def _drop(p0: float, a: float, p1: float, b: float) -> float:
    """Where the cubic from p0 >= 0 to p1 < 0 falls below zero for the first time."""
    low, high = 0.0, 1.0
    for turn in _turns(p0, a, p1, b):
        if _value(p0, a, p1, b, turn) < 0.0:
            high = turn
            break
        low = turn
    square, cube = _cubic(p0, a, p1, b)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if p0 + middle * (a + middle * (square + middle * cube)) < 0.0:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)
