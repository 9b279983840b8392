"""Between the mesh points of one integration: rows, and lower bounds of guards.

Mesh points are a few steps apart, so that a polynomial of degree seven through the nearest eight is as good as they
are. Where it is not, the one of degree five through six of them is another one: their difference is the error of the
latter (J. Stoer and R. Bulirsch, Introduction to Numerical Analysis, section 2.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.events.guards import LOCATED

_FINE, _COARSE, _FEWEST = 8, 6, 4
# Errors at the mesh points grow by the sum of the weights, which is 2 in the middle of evenly spaced ones.
_LARGEST = 16.0
# Where only rounding errors grow; evenly spaced nodes have 11 near the ends.
_WILD = 1e3
# Instants that are worth a look for those near zero, and how many are looked at together.
_MANY, _BLOCK = 250, 64


def between(nodes: Vector, values: Vector, times: Vector, allowed: Vector) -> tuple[Vector, Truth]:
    """Values at m times between n nodes, shape (m, k), and whether all k are as good as `allowed`, shape (m,).

    `nodes`, `values`: Ascending instants, and k values at each; shapes (n,) and (n, k).
    `times`: Ascending instants inside; shape (m,).
    `allowed`: How far each of the values may be off; shape (m, k).
    """
    count = min(_FINE, len(nodes))
    fine, grown = interpolated(nodes, values, times, count)
    exact = nodes[np.minimum(np.searchsorted(nodes, times), len(nodes) - 1)] == times
    if count < _FEWEST:
        return fine, np.asarray(exact)
    coarse, _ = interpolated(nodes, values, times, min(_COARSE, count - 1))
    good = (np.abs(fine - coarse) <= allowed).all(axis=1) & (grown <= _LARGEST)  # false for nan
    return fine, np.asarray(good | exact)


def interpolated(nodes: Vector, values: Vector, times: Vector, count: int) -> tuple[Vector, Vector]:
    """Values by Lagrange's formula through the nearest nodes, and the sums of the magnitudes of its weights.

    `nodes`, `values`: Ascending instants, shape (n,), and the values there, shape (n, k).
    `times`, `count`: Where values are wanted, shape (m,), and the number of nodes for each.
    Returns arrays of shapes (m, k) and (m,).
    """
    low = np.clip(np.searchsorted(nodes, times) - count // 2, 0, len(nodes) - count)
    chosen = low[:, None] + np.arange(count)
    near = nodes[chosen]
    gaps = near[:, :, None] - near[:, None, :]
    away = np.repeat((times[:, None] - near)[:, None, :], count, axis=1)
    same = np.arange(count)
    gaps[:, same, same] = away[:, same, same] = 1.0
    weights = np.prod(away / gaps, axis=2)
    # from one of them on: what does not change is the same to the last digit
    base = values[chosen[:, 0]]
    found = base + np.einsum("mc,mck->mk", weights, values[chosen] - base[:, None, :])
    return found, np.abs(weights).sum(axis=1)


def steady(nodes: Vector, values: Vector, times: Vector, count: int) -> Vector:
    """Values as of `interpolated`, through fewer nodes where those would enlarge rounding errors; shape (m, k).

    Between nodes of which some are next to each other, such as an output just before a mesh point, the polynomial of
    high degree swings by the rounding errors of these.
    """
    found, grown = interpolated(nodes, values, times, count)
    while count > 2 and (swings := grown > _WILD).any():
        count -= 2
        found[swings], grown[swings] = interpolated(nodes, values, times[swings], max(count, 2))
    return found


def newton_form(nodes: list[float], values: list[float]) -> Callable[[float], float]:
    """The polynomial through some points, by divided differences (section 2.1.3 of the same book).

    On numbers, not arrays: a root takes a hundredth of the time that SciPy needs to be imported for it.
    """
    weights = list(values)
    for j in range(1, len(nodes)):
        for i in range(len(nodes) - 1, j - 1, -1):
            weights[i] = (weights[i] - weights[i - 1]) / (nodes[i] - nodes[i - j])

    def value(t: float) -> float:
        found = 0.0
        for node, weight in zip(reversed(nodes), reversed(weights), strict=True):
            found = found * (t - node) + weight
        return found

    return value


def root(times: Vector, values: Vector, row: int) -> float:
    """Where the polynomial through some values, shape (n,), falls through zero behind the instant of a row.

    That instant itself where it does not before the next one.
    """
    origin = float(times[row])
    if not np.isfinite(values[row + 1]):  # a pole: what follows begins where it is still finite
        return origin
    known = np.isfinite(values)
    curve = newton_form((times[known] - origin).tolist(), values[known].tolist())
    left, right = 0.0, float(times[row + 1]) - origin
    if not curve(left) > 0.0 > curve(right):
        return origin
    while left < (middle := 0.5 * (left + right)) < right and right - left > 1e-15 * right:
        left, right = (middle, right) if curve(middle) > 0.0 else (left, middle)
    return origin + left


def lowest(times: Vector, g: Vector) -> tuple[NDArray[np.intp], Vector]:
    """Intervals between n + 1 instants that may hold a zero, shape (m,), and lower bounds there, shape (m, guards).

    `g` has shape (n + 1, guards). Where there are many instants, blocks of them in which a guard moves by less than it
    is away from zero are not looked at, and its bounds are inf: with the largest change r between neighbours and the
    largest ratio q of two intervals that meet, parabolas of `_bounds` go below the least value by no more than 3/4 q r,
    and lines by no more than q r.
    """
    if len(g) < _MANY:
        return np.arange(len(g) - 1), _bounds(times, g)
    starts = np.arange(0, len(g) - 1, _BLOCK)
    h = np.diff(times)
    uneven = np.ones(len(h))
    uneven[1:] = np.maximum(h[1:] / h[:-1], h[:-1] / h[1:])
    ratio = _around(np.maximum, uneven, starts)[:, None]
    least, most = _around(np.minimum, g, starts), _around(np.maximum, g, starts)
    with np.errstate(invalid="ignore"):  # nan is near
        near = ~(least > ratio * (most - least))
    ends = np.flatnonzero(np.diff(near.any(axis=1), prepend=False, append=False)).reshape(-1, 2)
    rows, found = [np.zeros(0, dtype=np.intp)], [np.zeros((0, g.shape[1]))]
    for first, last in ends.tolist():
        left, right = first * _BLOCK, min(last * _BLOCK, len(h))
        before, behind = max(left - 1, 0), min(right + 2, len(g))
        columns = np.flatnonzero(near[first:last].any(axis=0))
        bounds = _bounds(times[before:behind], g[before:behind, columns])
        rows.append(np.arange(left, right))
        found.append(np.full((right - left, g.shape[1]), np.inf))
        found[-1][:, columns] = bounds[left - before : right - before]
    return np.concatenate(rows), np.vstack(found)


def _around(extreme: np.ufunc, values: Vector, starts: NDArray[np.intp]) -> Vector:
    """The least or largest values of blocks and the two beside each: intervals are bounded by what is around them."""
    own = extreme.reduceat(values, starts, axis=0)
    found = own.copy()
    extreme(found[1:], own[:-1], out=found[1:])
    extreme(found[:-1], own[1:], out=found[:-1])
    return found


def _bounds(times: Vector, g: Vector) -> Vector:
    """The same, of all guards.

    Two parabolas share an interval, through three neighbours each. They differ by as much as either may be wrong (the
    interpolation error of third differences, J. Stoer and R. Bulirsch, Introduction to Numerical Analysis, section
    2.1), so that the lower one is lowered once more by this difference.

    A kink is no parabola: `abs(x) - 1e-3` seen from afar at both sides of x = 0 looks as if it turned back high above
    zero. Where the lines through the neighbours on both sides meet in the interval, the bound is no higher than there;
    without a neighbour on one side the line is taken to be as steep as on the other.
    """
    a, b = g[:-1], g[1:]
    if len(g) < 3:
        return np.asarray(np.minimum(a, b))
    h = np.diff(times)[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # beyond a pole nothing is known: nan
        rise = b - a
        curve = np.diff(rise / h, axis=0) / (h[1:] + h[:-1])
        left, right = np.concatenate([curve[:1], curve]), np.concatenate([curve, curve[-1:]])
        # a + rise*s - depth*s*(1 - s) for s from 0 to 1
        depth = h * h * (np.maximum(np.maximum(left, right), 0.0) + np.abs(left - right))
        s = np.where(depth > np.abs(rise), 0.5 * (1.0 - rise / depth), np.where(rise > 0, 0.0, 1.0))
        bound: Vector = np.minimum(a + rise * s - depth * s * (1.0 - s), _meeting(g, h, rise / h))
    return bound


def _meeting(g: Vector, h: Vector, slope: Vector) -> Vector:
    """Where the lines through the neighbours of each interval meet in it, inf where they do not."""
    before, behind = np.concatenate([-slope[1:2], slope[:-1]]), np.concatenate([slope[1:], -slope[-2:-1]])
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (behind - slope) / (behind - before)
        inside = (before < 0.0) & (behind > 0.0) & (s >= 0.0) & (s <= 1.0)
        return np.where(inside, g[:-1] + before * s * h, np.inf)


@dataclass(frozen=True, eq=False)
class LeftGuards:
    """Guards at the start of a stretch: those that leave zero are judged by their mean rate since then.

    `values`, `leaving`, `rates`, `noises`: Of each guard its value at `time` [s], whether it leaves zero there, its
    rate, and how far it can be wrong; shape (guards,).
    """

    time: float
    values: Vector
    leaving: Truth
    rates: Vector
    noises: Vector

    @cached_property
    def is_left(self) -> bool:
        """Whether there are such guards."""
        return bool(self.leaving.any())

    @cached_property
    def _nothing(self) -> Vector:
        return np.zeros((0, len(self.noises)))

    @cached_property
    def _until(self) -> float:
        """When the last of them has left what it may be off by rounding [s]."""
        longest = float((self.noises[self.leaving] / self.rates[self.leaving]).max()) / LOCATED
        return self.time + 1.001 * longest

    def near(self, times: Vector) -> Vector:
        """How far below zero guards may be by rounding, as they have just left it, at the first r of n instants.

        `times` ascend; shape (r, guards). From the next one on it is nothing.
        """
        first = int(np.searchsorted(times, self._until, side="right")) if self.is_left else 0
        with np.errstate(divide="ignore", invalid="ignore"):
            gone = (
                LOCATED * (times[:first] - self.time)[:, None] * np.where(self.leaving, self.rates / self.noises, 1.0)
            )
        return np.asarray(self.noises * np.clip(1.0 - gone, 0.0, 1.0))

    def judged(self, times: Vector, values: Vector) -> Vector:
        """What must not be negative, at n instants; shape (n, guards)."""
        if not self.is_left:
            return values
        found, since = values.copy(order="K"), times - self.time
        for k in np.flatnonzero(self.leaving).tolist():
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = (values[:, k] - self.values[k]) / since
            found[:, k] = np.where(since > 0.0, mean, self.rates[k])
        return found
