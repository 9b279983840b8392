"""Columns of values over rows: their slopes, their zeros, and values predicted between rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector

# The numbers of nearest rows from which a zero is located, and from which a value is predicted.
_NODES, _FEW = 8, 4
# A zero is located when the value is this fraction of the larger one at the ends; and the most iterations.
_ZERO, _ITERATIONS = 1e-13, 30
# A row closer than this fraction of the distance between rows almost coincides with an instant.
_BESIDE = 0.2


def nearest(times: Vector, instants: Vector) -> NDArray[np.intp]:
    """Indices of the ascending times, shape (n,), that are nearest to each of the instants, shape (m,)."""
    k = np.clip(np.searchsorted(times, instants), 1, len(times) - 1)
    return np.asarray(k - (instants - times[k - 1] <= times[k] - instants))


def slopes(times: Vector, values: Vector) -> Vector:
    """Slopes of values at all of their times, of the polynomials through the nearest five; shape of the values."""
    count = min(5, len(times))
    low = np.clip(np.arange(len(times)) - count // 2, 0, len(times) - count)
    near = low[:, None] + np.arange(count)
    gaps = times[near][:, :, None] - times[near][:, None, :]
    same = np.arange(count)
    scale = times[near[:, -1]] - times[near[:, 0]]
    gaps /= scale[:, None, None]
    gaps[:, same, same] = 1.0
    inverse = np.prod(gaps, axis=2)
    node = np.arange(len(times)) - low
    away = (times[:, None] - times[near]) / scale[:, None]
    away[np.arange(len(times)), node] = 1.0
    with np.errstate(divide="ignore", invalid="ignore"):  # rows after a start may be 1e-15 of the others apart
        weights = np.nan_to_num(inverse[np.arange(len(times)), node][:, None] / inverse / away, posinf=0.0, neginf=0.0)
    weights[np.arange(len(times)), node] = 0.0
    with np.errstate(over="ignore"):
        return np.asarray(np.einsum("nc,nck->nk", weights, values[near] - values[:, None]) / scale[:, None])


def predicted(times: Vector, values: Vector, instants: Vector, columns: NDArray[np.int64]) -> Vector:
    """Values at m instants of the cubics through the four rows around each; shape (m, 2).

    A row that almost coincides with the instant is not used, because the function may be active just there.

    `values`, `columns`: Two values of k functions at n times, shape (n, 2, k), and the function for each instant.
    """
    if len(times) < _FEW + 1:
        return np.asarray(values[np.zeros(len(instants), dtype=np.int64), :, columns])
    low = np.clip(nearest(times, instants) - _FEW // 2, 0, len(times) - _FEW - 1)
    near = low[:, None] + np.arange(_FEW + 1)
    away = instants[:, None] - times[near]
    closest = np.abs(away).min(axis=1)
    is_close = closest < _BESIDE * (times[near[:, -1]] - times[near[:, 0]]) / _FEW
    omitted = np.where(is_close, np.abs(away).argmin(axis=1), np.abs(away).argmax(axis=1))
    near = near[np.arange(_FEW + 1) != omitted[:, None]].reshape(-1, _FEW)
    nodes = times[near]
    gaps = nodes[:, :, None] - nodes[:, None, :]
    parts = np.repeat((instants[:, None] - nodes)[:, None, :], _FEW, axis=1)
    gaps[:, np.arange(_FEW), np.arange(_FEW)] = parts[:, np.arange(_FEW), np.arange(_FEW)] = 1.0
    weights = np.prod(parts / gaps, axis=2)
    return np.asarray(np.einsum("nc,ncs->ns", weights, values[near, :, columns[:, None]]))


def roots(
    times: Vector,
    values: Vector,
    columns: NDArray[np.intp],
    rows: NDArray[np.intp],
    ends: tuple[Vector, Vector] | None = None,
) -> Vector:
    """Zeros of `columns[j]` of the values after `rows[j]`, by the Illinois method on interpolants; shape of `rows`.

    Values change their sign between the row and the next one, or between other `ends`: each a time and a value there,
    shape (2, m).
    """
    if not len(rows):  # as for most pieces: thirty iterations over empty arrays take as long as a short piece
        return np.zeros(0)
    count = min(_NODES, len(times))
    low = np.clip(rows + 1 - count // 2, 0, len(times) - count)
    near = low[:, None] + np.arange(count)
    origin, width = times[rows], times[rows + 1] - times[rows]
    nodes = (times[near] - origin[:, None]) / width[:, None]
    known = values[near, columns[:, None]]
    gaps = nodes[:, :, None] - nodes[:, None, :]
    gaps[:, np.arange(count), np.arange(count)] = 1.0
    with np.errstate(divide="ignore", invalid="ignore"):  # rows after a start may be 1e-15 of the others apart
        weights = known / np.prod(gaps, axis=2)

    def at(s: Vector) -> Vector:
        away = s[:, None] - nodes
        away[away == 0.0] = 1e-300
        with np.errstate(over="ignore", invalid="ignore"):
            value = np.prod(away, axis=1) * (weights / away).sum(axis=1)
        return np.where(np.isfinite(value), value, 0.0)

    a, at_a = np.zeros(len(rows)), values[rows, columns]
    b, at_b, s = np.ones(len(rows)), values[rows + 1, columns], a
    if ends is not None:
        (a, at_a), (b, at_b) = ends
        a, b = (a - origin) / width, (b - origin) / width
    small = _ZERO * np.maximum(np.abs(at_a), np.abs(at_b))
    before, done = np.full(len(rows), 2), np.zeros(len(rows), dtype=bool)
    for _ in range(_ITERATIONS):
        s = np.where(done, s, a + (b - a) * at_a / np.where(at_a == at_b, np.inf, at_a - at_b))
        here = at(s)
        done |= np.abs(here) <= small
        if done.all():
            break
        same = here * at_a > 0.0
        again = same == before  # the value of an end that is retained twice in succession is halved (Illinois)
        a, at_a = np.where(same, s, a), np.where(same, here, np.where(again, 0.5, 1.0) * at_a)
        b, at_b = np.where(same, b, s), np.where(same, np.where(again, 0.5, 1.0) * at_b, here)
        before = same
    return np.asarray(origin + s * width)
