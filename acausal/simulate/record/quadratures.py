"""Quadratures: integrals of functions of time that act on nothing, solved separately from the other states.

They neither cost steps of the solver nor lose accuracy. Their rates become Chebyshev series on panels, which are halved
until the series have converged; integrated term by term, the series give all output times at once. Source: J. P. Boyd,
Chebyshev and Fourier Spectral Methods (2001), chapter 2. An integrator for each segment costs three times as much, most
of it for its construction.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from acausal.arrays import Indices, Vector

if TYPE_CHECKING:  # solvers import this module
    from acausal.simulate.solvers.segment import Tolerances

_ORDER = 16
_POINTS = np.cos(np.pi * (np.arange(_ORDER + 1) + 0.5) / (_ORDER + 1))
_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _ORDER)).T
"""A row of values at the points times this matrix gives the coefficients of the series."""
_INTEGRAL = chebyshev.chebint(np.eye(_ORDER + 1), lbnd=-1, axis=1)
"""A row of coefficients times this matrix gives the coefficients of the integral from the left end."""
_ROUNDING = 1e-17
"""Coefficients below this fraction of the largest one do not affect the sum."""
_NARROWEST = 1e-12
"""Panels narrower than this fraction of their stretch are not halved further, even if the rate jumps in them."""


def integrals(
    rates: Callable[[Vector, Indices], Vector],
    starts: Vector,
    times: Vector,
    stretches: Indices,
    tolerances: Tolerances,
    breaks: Vector | None = None,
) -> Vector:
    """Integrals over k stretches, at n instants; shape (nq, n).

    Raises RuntimeError: a rate is not finite.

    Parameters
    ----------
    rates
        A function of instants and of the stretches to which they belong, both of shape (m,), that returns the rates,
        shape (nq, m).
    starts
        Start of each stretch [s]; shape (k,).
    times, stretches
        The instants [s], ascending in each stretch, and the stretch of each, ascending; shape (n,). Each stretch has
        an instant.
    tolerances
        Accuracy of each integral, relative to its change, and absolute.
    breaks
        Instants at which rates may jump or have a kink, ascending [s]: panels end there.
    """
    a, b = starts, times[np.searchsorted(stretches, np.arange(len(starts)), side="right") - 1]
    whole, stretch = b - a, np.arange(len(starts))
    if breaks is not None and len(breaks):
        a, b, stretch = _broken(a, b, breaks)
    accepted: list[tuple[Vector, Vector, Indices, Vector]] = []
    while len(a):
        half = 0.5 * (b - a)
        nodes = a[:, None] + half[:, None] * (1.0 + _POINTS)
        values = rates(nodes.ravel(), np.repeat(stretch, len(_POINTS))).reshape(-1, *nodes.shape)
        if not np.isfinite(values).all():
            raise RuntimeError("the solution is not finite")
        series = values @ _SERIES
        tail = 2.0 * half * np.abs(series[:, :, -3:]).max(axis=2)
        size = 2.0 * half * np.abs(values).max(axis=2)
        unresolved = (tail > tolerances.of(size)).any(axis=0) & (b - a > _NARROWEST * whole[stretch])
        done = ~unresolved
        accepted.append((a[done], b[done], stretch[done], (half[:, None] * series @ _INTEGRAL)[:, done]))
        middle = (a + half)[unresolved]
        a, b = np.concatenate([a[unresolved], middle]), np.concatenate([middle, b[unresolved]])
        stretch = np.concatenate([stretch[unresolved], stretch[unresolved]])
    inside: Indices | slice
    if len(accepted) == 1 and len(accepted[0][0]) == len(starts):  # one panel for each stretch, in order
        left, right, _, panels = accepted[0]
        inside, before = stretches if len(starts) > 1 else slice(0, 1), np.zeros((len(panels), 1))
    else:
        left, right, inside, panels, before = _assembled(accepted, len(starts), times, stretches)
    width = (right - left)[inside]  # 0 if an event is located at the very start of its stretch
    at = 2.0 * (times - left[inside]) / np.where(width > 0.0, width, 1.0) - 1.0
    return np.asarray(before + _sums(panels, inside, np.clip(at, -1.0, 1.0)))


def _sums(panels: Vector, inside: Indices | slice, at: Vector) -> Vector:
    """Evaluate series, shape (nq, panels, degrees), of the panels `inside` at n points in [-1, 1]; shape (nq, n).

    `inside` is a slice of one panel if it contains all points.

    Clenshaw's recurrence is used: a cosine for each degree and point takes ten times as long.
    """
    sizes = np.abs(panels).max(axis=(0, 1), initial=0.0)
    degree = int(np.flatnonzero(sizes > _ROUNDING * sizes.max(initial=0.0)).max(initial=0))
    later = last = np.zeros((len(panels), len(at)))
    for k in range(degree, 0, -1):
        last, later = panels[:, inside, k] + 2.0 * at * last - later, last
    return np.asarray(panels[:, inside, 0] + at * last - later)


def _broken(a: Vector, b: Vector, breaks: Vector) -> tuple[Vector, Vector, Indices]:
    """Divide stretches from `a` to `b` at `breaks`; returns starts and ends of the pieces, and the stretch of each."""
    first, last = np.searchsorted(breaks, a, side="right"), np.searchsorted(breaks, b, side="left")
    inside = np.maximum(last - first, 0)
    stretch = np.repeat(np.arange(len(a)), inside + 1)
    number = np.arange(len(stretch)) - np.repeat(np.cumsum(inside + 1) - inside - 1, inside + 1)
    is_last = number == inside[stretch]
    ends = b[stretch].copy()
    ends[~is_last] = breaks[(first[stretch] + number)[~is_last]]
    starts = a[stretch].copy()
    starts[number > 0] = ends[np.flatnonzero(number > 0) - 1]
    return starts, ends, stretch


def _assembled(
    accepted: list[tuple[Vector, Vector, Indices, Vector]], count: int, times: Vector, stretches: Indices
) -> tuple[Vector, Vector, Indices, Vector, Vector]:
    """Sort all panels: their ends, the panel of each instant, the series, and the integral up to that panel."""
    left, right = np.concatenate([f[0] for f in accepted]), np.concatenate([f[1] for f in accepted])
    owner = np.concatenate([f[2] for f in accepted])
    order = np.lexsort((left, owner))
    left, right, owner = left[order], right[order], owner[order]
    panels = np.concatenate([f[3] for f in accepted], axis=1)[:, order]
    # from the start of its stretch; Chebyshev polynomials are 1 at the right end of a panel
    total = np.cumsum(panels.sum(axis=2), axis=1)
    before = np.hstack([np.zeros((len(total), 1)), total[:, :-1]])
    first = np.searchsorted(owner, np.arange(count))
    before -= before[:, first[owner]]
    inside = first[stretches]
    ends = np.append(first[1:], len(left))
    for k in np.flatnonzero(ends - first > 1).tolist():  # the last panel that begins before the instant
        of_stretch = slice(*np.searchsorted(stretches, [k, k + 1]))
        inside[of_stretch] += np.maximum(np.searchsorted(left[first[k] : ends[k]], times[of_stretch]) - 1, 0)
    return left, right, inside, panels, before[:, inside]
