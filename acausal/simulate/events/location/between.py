"""Rows between the looks of one integration.

Looks are a few steps apart, so that a polynomial of degree seven through the nearest eight is as good as they are.
Where it is not, the one of degree five through six of them is another one: their difference is the error of the latter
(J. Stoer and R. Bulirsch, Introduction to Numerical Analysis, section 2.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Truth = NDArray[np.bool_]
_FINE, _COARSE, _FEWEST = 8, 6, 4
# Errors of the looks grow by the sum of the weights, which is 2 in the middle of evenly spaced ones.
_LARGEST = 16.0


def between(nodes: Vector, values: Vector, times: Vector, allowed: Vector) -> tuple[Vector, Truth]:
    """Values at m times between n nodes, shape (m, k), and whether all k are as good as `allowed`, shape (m,).

    Parameters
    ----------
    nodes, values
        Ascending instants, and k values at each; shapes (n,) and (n, k).
    times
        Ascending instants inside; shape (m,).
    allowed
        How far each of the values may be off; shape (m, k).
    """
    count = min(_FINE, len(nodes))
    fine, grown = _interpolated(nodes, values, times, count)
    exact = nodes[np.minimum(np.searchsorted(nodes, times), len(nodes) - 1)] == times
    if count < _FEWEST:
        return fine, np.asarray(exact)
    coarse, _ = _interpolated(nodes, values, times, min(_COARSE, count - 1))
    good = (np.abs(fine - coarse) <= allowed).all(axis=1) & (grown <= _LARGEST)  # false for nan
    return fine, np.asarray(good | exact)


def _interpolated(nodes: Vector, values: Vector, times: Vector, count: int) -> tuple[Vector, Vector]:
    """Values by Lagrange's formula through the nearest nodes, and the sums of the sizes of its weights."""
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
