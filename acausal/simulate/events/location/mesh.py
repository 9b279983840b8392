"""Mesh points: the instants between the start of a stretch and its event at which a solver returns its solution."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.segment import Segment

# The most and the fewest mesh points of one call of a solver, and the most numbers that it returns.
_POINTS, _FEWEST, _NUMBERS = 512, 4, 4e6
# The most mesh points of a call with fixed steps, because a search costs as much as some hundred of them.
_STEPS = 4096
# Each distance of mesh points is larger than the one before by this factor; even ones could alias with an oscillation.
_GROWTH = 1.02
# The distance of the first mesh point in first steps, the ratio of the distances of the next ones, and their largest
# number: a multistep method begins with a tiny step and doubles it.
_FIRST, _RAMP, _MOST_RAMPS = 16.0, 4.0, 15
# The least distance of two mesh points, in rounding errors of the time.
_ROUNDINGS = 64


def first_step(problem: Problem, segment: Segment, horizon: float) -> float:
    """The step in which the states change by half their tolerance, at most a thousandth of the horizon [s].

    IDAS chooses its first step in this way (`IDASolve`), but with the distance of the first output as the horizon; here
    no step may depend on outputs.
    """
    n = problem.n_dynamic
    x = segment.x[:n] / problem.scale_x
    numbers = problem.vector(segment.p, segment.x, segment.start)
    rate = problem.scaled.buffered(0.0, x, segment.z / problem.scale_z, numbers, [])[0]
    weighted = np.asarray(rate).ravel() / segment.tolerances.of(x)
    size = float(np.sqrt(np.mean(weighted**2))) if n else 0.0
    step = 1e-3 * horizon
    return min(step, 0.5 / size) if np.isfinite(size) and size > 0.0 else step


def resolution(t: float, span: float) -> float:
    """The least distance of two mesh points at time `t` of a run of length `span` [s]."""
    return float(_ROUNDINGS * np.spacing(max(abs(t), span)))


def most_points(problem: Problem, fixed: bool = False) -> int:
    """The most mesh points of one call of a solver, with `fixed` steps or with steps that it chooses."""
    return int(np.clip(_NUMBERS / (1 + problem.n_dynamic + len(problem.scale_z)), 32, _STEPS if fixed else _POINTS))


@cache
def grid(ramps: int, count: int) -> Vector:
    """Mesh points at growing distances, as fractions of the time from their start to the last.

    Each of the first `ramps` is four times as far from the start as the one before; then come `count` more, the first
    of them one spacing away from the start, at distances that grow slowly. There are few such grids, because an
    integrator is cached for each of them.
    """
    ramp = _RAMP ** np.arange(-ramps, 0.0)
    spaced = _total(np.arange(1, count + 1))
    return np.asarray(np.append(ramp, spaced) / spaced[-1])


@cache
def even(count: int) -> Vector:
    """Mesh points at equal distances, as fractions of the time from their start to the last."""
    return np.linspace(0.0, 1.0, count + 1, dtype=np.float64)[1:]


def _total(count: NDArray[np.int64]) -> Vector:
    """The distance of the last of `count` mesh points from their start, in spacings."""
    return np.asarray((_GROWTH**count - 1.0) / (_GROWTH - 1.0), dtype=np.float64)


@cache
def _reaches(most: int) -> tuple[NDArray[np.int64], Vector]:
    """Numbers of mesh points, powers of two up to `most`, and how far each reaches, in spacings."""
    counts = _FEWEST * 2 ** np.arange(1 + int(math.log2(most // _FEWEST)))
    return counts, _total(counts)


def growing(length: float, first: float, spacing: float, most: int, least: float) -> tuple[float, Vector]:
    """How far mesh points reach, at most over a `length` [s], and their fractions of that (`grid`).

    `first`: The first step of the solver [s]; inf if it begins with steps of any length.
    `spacing`, `most`: The distance of mesh points after the ramp [s], and the largest number of them.
    `least`: The least distance of mesh points [s].
    """
    spacing = max(spacing, least)
    counts, spacings = _reaches(most)
    reach = spacing * spacings
    k = int(np.argmax(reach >= length)) if reach[-1] >= length else len(counts) - 1
    if reach[k] >= length:
        spacing *= length / float(reach[k])
    d = max(min(_FIRST * first, spacing), least)
    ramps = math.ceil(math.log(max(spacing / d, 1.0), _RAMP) - 1e-9)
    while ramps > 0 and spacing * _RAMP**-ramps < least:
        ramps -= 1
    return min(float(reach[k]), length), grid(min(ramps, _MOST_RAMPS), int(counts[k]))


def first_step_on(fractions: Vector, length: float, first: float) -> float:
    """The first step on a grid of mesh points: that of the grid if it is close to `first`, so that few steps differ."""
    grid_step = float(fractions[0]) * length / _FIRST
    return grid_step if 0.99 * first <= _RAMP * grid_step <= _RAMP * first else min(first, length)


def stepped(start: float, outputs: Vector, end: float, step: float, count: int) -> Vector:
    """Mesh points for fixed steps, at every other step between two outputs, so that they cost no further steps.

    Outputs up to the last mesh point are among them.
    """
    first = int(np.searchsorted(outputs, start, side="right"))
    last = min(int(np.searchsorted(outputs, end)), first + count)  # at least one mesh point for each
    stops = np.append(outputs[first:last], end)
    gaps = np.diff(stops, prepend=start)
    counts = np.maximum(1, np.ceil(gaps / (2.0 * step) - 1e-9)).astype(np.int64)
    reached = np.cumsum(counts)
    kept = int(np.searchsorted(reached, count)) + 1
    stops, reached = stops[:kept], reached[:kept]
    if reached[-1] == len(stops):  # outputs are as close as that
        return np.asarray(stops[: max(count, 1)])
    mesh = np.interp(np.arange(1, int(reached[-1]) + 1), np.append(0, reached), np.append(start, stops))
    return np.asarray(mesh[: max(count, 1)])


def merged(mesh: Vector, outputs: Vector) -> tuple[Vector, Vector]:
    """Mesh points, moved onto outputs that almost coincide with them, and both together up to the last mesh point."""
    outputs = outputs[: np.searchsorted(outputs, mesh[-1], side="right")]
    if not len(outputs) or np.array_equal(outputs, mesh):
        return mesh, mesh
    above = np.clip(np.searchsorted(outputs, mesh), 0, len(outputs) - 1)
    below = np.maximum(above - 1, 0)
    near = np.where(np.abs(outputs[above] - mesh) < np.abs(outputs[below] - mesh), outputs[above], outputs[below])
    gaps = np.diff(mesh, prepend=min(mesh[0], outputs[0]) if len(mesh) == 1 else 2 * mesh[0] - mesh[1])
    close = np.abs(near - mesh) <= 1e-3 * np.abs(gaps)
    close[-1] = False
    moved = np.unique(np.where(close, near, mesh))
    return moved, np.union1d(moved, outputs)
