"""Interpolation between the mesh points of one integration: rows, and lower bounds and roots of guards.

Mesh points are a few steps apart, so that a polynomial of degree seven through the nearest eight is usually as accurate
as they are. Its difference from the polynomial of degree five through six of them estimates the error of the latter (J.
Stoer and R. Bulirsch, Introduction to Numerical Analysis, section 2.1); if that is large, rows are not interpolated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.simulate.events.guards import FAR, LATE, LEAST, STILL, Guards, Moment, same_instant

_FINE, _COARSE, _FEWEST = 8, 6, 4
# The limit of the sum of the magnitudes of the weights, by which errors at the mesh points are amplified; the sum is 2
# in the middle of evenly spaced points.
_MOST_AMPLIFIED = 16.0
# The limit where only rounding errors are amplified; evenly spaced points have 11 near the ends.
_MOST_ROUNDED = 1e3
# The number of instants from which on blocks of them are tested first, because most guards are far from zero; and the
# size of a block.
_MANY, _BLOCK = 250, 64


def between(nodes: Vector, values: Vector, times: Vector, allowed: Vector) -> tuple[Vector, Truth]:
    """Values at m times between n nodes, shape (m, k), and whether all k are accurate enough, shape (m,).

    `nodes`, `values`: Ascending instants, and k values at each; shapes (n,) and (n, k).
    `times`: Ascending instants between the nodes; shape (m,).
    `allowed`: The largest error of each value; shape (m, k).
    """
    count = min(_FINE, len(nodes))
    fine, amplified = interpolated(nodes, values, times, count)
    exact = nodes[np.minimum(np.searchsorted(nodes, times), len(nodes) - 1)] == times
    if count < _FEWEST:
        return fine, np.asarray(exact)
    coarse, _ = interpolated(nodes, values, times, min(_COARSE, count - 1))
    good = (np.abs(fine - coarse) <= allowed).all(axis=1) & (amplified <= _MOST_AMPLIFIED)  # false for nan
    return fine, np.asarray(good | exact)


def interpolated(nodes: Vector, values: Vector, times: Vector, count: int) -> tuple[Vector, Vector]:
    """Values by Lagrange's formula through the nearest nodes, and the sums of the magnitudes of its weights.

    Returns arrays of shapes (m, k) and (m,).

    `nodes`, `values`: Ascending instants, shape (n,), and the values there, shape (n, k).
    `times`, `count`: Where to interpolate, shape (m,), and the number of nodes for each.
    """
    low = np.clip(np.searchsorted(nodes, times) - count // 2, 0, len(nodes) - count)
    chosen = low[:, None] + np.arange(count)
    near = nodes[chosen]
    gaps = near[:, :, None] - near[:, None, :]
    away = np.repeat((times[:, None] - near)[:, None, :], count, axis=1)
    same = np.arange(count)
    gaps[:, same, same] = away[:, same, same] = 1.0
    weights = np.prod(away / gaps, axis=2)
    # relative to one of them, so that constant values are reproduced to the last digit
    base = values[chosen[:, 0]]
    found = base + np.einsum("mc,mck->mk", weights, values[chosen] - base[:, None, :])
    return found, np.abs(weights).sum(axis=1)


def steady(nodes: Vector, values: Vector, times: Vector, count: int) -> Vector:
    """Interpolate through at most `count` nodes, and fewer where rounding errors would be amplified; shape (m, k).

    If some of the nodes are next to each other, such as an output just before a mesh point, a polynomial of high degree
    amplifies their rounding errors. The arguments are those of `interpolated`.
    """
    found, amplified = interpolated(nodes, values, times, count)
    while count > 2 and (swings := amplified > _MOST_ROUNDED).any():
        count -= 2
        found[swings], amplified[swings] = interpolated(nodes, values, times[swings], max(count, 2))
    return found


def newton_form(nodes: list[float], values: list[float]) -> Callable[[float], float]:
    """The polynomial through some points, by divided differences (section 2.1.3 of the same book).

    It takes numbers instead of arrays: SciPy would take a hundred times as long to import as a root takes here.
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
    """The zero at which the polynomial through some values, shape (n,), becomes negative between a row and the next.

    The instant of the row if there is none.
    """
    origin = float(times[row])
    if not np.isfinite(values[row + 1]):  # a pole: the event is at the last instant with a finite value
        return origin
    # between instants that are a few rounding errors apart, points of a mesh coincide
    known = np.isfinite(values) & (np.diff(times, prepend=-np.inf) > 0.0)
    curve = newton_form((times[known] - origin).tolist(), values[known].tolist())
    left, right = 0.0, float(times[row + 1]) - origin
    if not curve(left) > 0.0 > curve(right):
        return origin
    while left < (middle := 0.5 * (left + right)) < right and right - left > 1e-15 * right:
        left, right = (middle, right) if curve(middle) > 0.0 else (left, middle)
    return origin + left


def lowest(times: Vector, g: Vector) -> tuple[NDArray[np.intp], Vector]:
    """Intervals between n + 1 instants that may contain a zero, shape (m,), and lower bounds there, shape (m, guards).

    `times`, `g`: The instants, and the guards there; shapes (n + 1,) and (n + 1, guards).

    If there are many instants, blocks of them in which a guard is not near zero are left out, or the guard gets the
    bound inf.
    """
    if len(g) < _MANY:
        return np.arange(len(g) - 1), lower_bounds(times, g)
    h, near = np.diff(times), _near_blocks(times, g)
    ends = np.flatnonzero(np.diff(near.any(axis=1), prepend=False, append=False)).reshape(-1, 2)
    rows, found = [np.zeros(0, dtype=np.intp)], [np.zeros((0, g.shape[1]))]
    for first, last in ends.tolist():
        left, right = first * _BLOCK, min(last * _BLOCK, len(h))
        before, after = max(left - 2, 0), min(right + 3, len(g))
        columns = np.flatnonzero(near[first:last].any(axis=0))
        lows = lower_bounds(times[before:after], g[before:after, columns])
        rows.append(np.arange(left, right))
        found.append(np.full((right - left, g.shape[1]), np.inf))
        found[-1][:, columns] = lows[left - before : right - before]
    return np.concatenate(rows), np.vstack(found)


def near_zero(times: Vector, g: Vector) -> NDArray[np.intp]:
    """Intervals between the instants, without blocks of many of them in which no guard is near zero."""
    if len(g) < _MANY:
        return np.arange(len(g) - 1)
    return np.flatnonzero(np.repeat(_near_blocks(times, g).any(axis=1), _BLOCK)[: len(g) - 1])


def _near_blocks(times: Vector, g: Vector) -> Truth:
    """Whether a guard may have a zero in each block of intervals; shape (blocks, guards).

    It has none where it moves by less than its distance from zero. With the largest change r between neighbours and the
    largest ratio q of the lengths of adjacent intervals, parabolas of `lower_bounds` are below the least value by at
    most 3/4 q r, lines by q r, lines with their curvature by (q + 2 q^3) r, and a value at the rate of the interval
    before by q r.
    """
    starts, h = np.arange(0, len(g) - 1, _BLOCK), np.diff(times)
    uneven = np.ones(len(h))
    with np.errstate(divide="ignore", invalid="ignore"):  # far from zero, times coincide: infinitely uneven
        uneven[1:] = np.maximum(h[1:] / h[:-1], h[:-1] / h[1:])
    ratio = _around(np.maximum, uneven, starts)[:, None]
    least, most = _around(np.minimum, g, starts), _around(np.maximum, g, starts)
    with np.errstate(invalid="ignore"):  # nan counts as near zero
        return np.asarray(~(least > (ratio + 2.0 * ratio**3) * (most - least)))


def _around(extreme: np.ufunc, values: Vector, starts: NDArray[np.intp]) -> Vector:
    """The least or largest values of each block and its two neighbours, on which the bounds of its intervals depend."""
    block_values = extreme.reduceat(values, starts, axis=0)
    extrema = block_values.copy()
    extreme(extrema[1:], block_values[:-1], out=extrema[1:])
    extreme(extrema[:-1], block_values[1:], out=extrema[:-1])
    return extrema


def lower_bounds(times: Vector, g: Vector) -> Vector:
    """Lower bounds of all guards in all n intervals; shape (n, guards).

    Each interval has two parabolas, through three neighbouring instants each. Their difference estimates their error
    (that of interpolation by third differences, J. Stoer and R. Bulirsch, Introduction to Numerical Analysis, section
    2.1), and is subtracted once more from the lower one.

    Parabolas do not show kinks: that of `abs(x) - 1e-3` through distant points on both sides of x = 0 turns back high
    above zero. Where the lines through the neighbours on both sides meet in the interval, the bound is no higher than
    their intersection, less what the curvature of the neighbours makes of it; without a neighbour on one side, the line
    is taken to be as steep, and as curved, as on the other.
    """
    a, b = g[:-1], g[1:]
    if len(g) < 3:
        return np.asarray(np.minimum(a, b))
    h = (times[1:] - times[:-1])[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # nan beyond a pole
        rise = b - a
        slope = rise / h
        curve = (slope[1:] - slope[:-1]) / (h[1:] + h[:-1])
        left, right = np.concatenate([curve[:1], curve]), np.concatenate([curve, curve[-1:]])
        # a + rise*s - depth*s*(1 - s) for s from 0 to 1
        depth = h * h * (np.maximum(np.maximum(left, right), 0.0) + np.abs(left - right))
        s = np.where(depth > np.abs(rise), 0.5 * (1.0 - rise / depth), np.where(rise > 0, 0.0, 1.0))
        bound: Vector = np.minimum(a + rise * s - depth * s * (1.0 - s), _meeting(g, h, slope, curve))
    return bound


def _meeting(g: Vector, h: Vector, slope: Vector, curve: Vector) -> Vector:
    """The least height at which lines through the neighbours of each interval may meet in it; inf where they do not.

    `slope`, `curve`: Divided differences of first and second order; shapes (n, guards) and (n - 1, guards).
    """
    before, after = np.concatenate([-slope[1:2], slope[:-1]]), np.concatenate([slope[1:], -slope[-2:-1]])
    turns = (before < 0.0) & (after > 0.0)
    columns = np.flatnonzero(turns.any(axis=0))  # lines of most guards meet nowhere
    heights = np.full_like(slope, np.inf)
    if not len(columns):
        return heights
    turns, before, after = turns[:, columns], before[:, columns], after[:, columns]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (after - slope[:, columns]) / (after - before)
        inside = turns & (s >= 0.0) & (s <= 1.0)
        # of the neighbours on each side, without the instants of the interval
        none, bends = np.zeros((2, len(columns))), np.abs(curve[:, columns])
        left, right = np.concatenate([none, bends[:-1]]), np.concatenate([bends[1:], none])
        left[:2], right[-2:] = right[:2], left[-2:]
        if len(slope) <= 3:  # all neighbours belong to the interval, too
            left[:] = right[:] = bends.max(axis=0)
        a, b = s * h, (1.0 - s) * h
        wide_before, wide_after = np.concatenate([h[-1:], h[:-1]]), np.concatenate([h[1:], h[:1]])
        bend = np.maximum(left * a * (a + wide_before), right * b * (b + wide_after))
        heights[:, columns] = np.where(inside, g[:-1, columns] + before * a - bend, np.inf)
    return heights


@dataclass(frozen=True, eq=False)
class LeftGuards:
    """Guards at the start of a stretch; those that leave zero there are judged by their mean rate since then.

    `values`, `leaving`, `rates`, `noises`: For each guard its value at `time` [s], whether it leaves zero there, its
    rate, and its largest error; shape (guards,).
    """

    time: float
    values: Vector
    leaving: Truth
    rates: Vector
    noises: Vector

    @cached_property
    def is_left(self) -> bool:
        """Whether any guard leaves zero."""
        return bool(self.leaving.any())

    @cached_property
    def _until(self) -> float:
        """When the last of them exceeds its error [s]."""
        longest = float((self.noises[self.leaving] / self.rates[self.leaving]).max()) / STILL
        return self.time + 1.001 * longest

    def near(self, times: Vector) -> Vector:
        """How far below zero guards that have just left it may be, by rounding errors; shape (r, guards).

        At the first r of the ascending `times`, shape (n,); from then on the allowance is zero.
        """
        first = int(np.searchsorted(times, self._until, side="right")) if self.is_left else 0
        if not first:
            return np.zeros((0, len(self.noises)))
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = STILL * (times[:first] - self.time)[:, None] * np.where(self.leaving, self.rates / self.noises, 1.0)
        return np.asarray(self.noises * np.clip(1.0 - moved, 0.0, 1.0))

    def judged(self, times: Vector, values: Vector) -> Vector:
        """Quantities at n instants that are negative once a guard is passed; shape (n, guards).

        The values themselves, or the mean rates of guards that have left zero.
        """
        if not self.is_left:
            return values
        found, since = values.copy(order="K"), times - self.time
        for k in np.flatnonzero(self.leaving).tolist():
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = (values[:, k] - self.values[k]) / since
            found[:, k] = np.where(since > 0.0, mean, self.rates[k])
        return found


def left_guards(guards: Guards, t: float, moment: Moment, band: Vector) -> tuple[LeftGuards, Vector]:
    """Guards at the start of a stretch, and how far below zero those that do not leave it may be; shape (guards,)."""
    count = len(moment.regime.active_set.owners)
    if not count:
        zeros = np.zeros(0)
        return LeftGuards(t, zeros, np.zeros(0, dtype=bool), zeros, zeros), band
    g, rates, noise = guards.state(t, moment)
    leaving = (g <= noise) & (rates > noise)
    # a guard that leaves zero may be negative by rounding errors for a while, but not later on
    allowed = guards.located(t, moment, noise) if leaving.any() else noise
    noises = np.where(leaving, np.maximum.reduce([allowed, -2.0 * g, band]), 0.0)
    poles = leaving & ~(rates < FAR)
    if poles.any():  # beyond it, nothing is known of the error
        noises[poles] = np.maximum(-2.0 * g[poles], LEAST)
        rates = np.where(poles, noises / (LATE * same_instant(guards.span, t)), rates)
    band = np.where(leaving, 0.0, band)
    return LeftGuards(t, np.maximum(g + band, 0.0), leaving, rates, noises), band
