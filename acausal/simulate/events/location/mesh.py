"""Where a solver is asked for what it has, between its start and its next event."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.segment import Segment

# Mesh points at once: fewer when there are many numbers to each.
_POINTS, _FEWEST, _NUMBERS = 512, 4, 4e6
# The same between fixed steps: a search costs as much as some hundred of them.
_STEPS = 4096
# Mesh points move apart by this factor: evenly spaced they could fall in with an oscillation.
_GROWTH = 1.02
# The first mesh point is so many first steps away, the next ones are so many times as far: a multistep method begins
# with a tiny step and doubles it.
_FIRST, _RAMP, _MOST_RAMPS = 16.0, 4.0, 15
_ROUNDINGS = 64


def first_step(problem: Problem, segment: Segment, horizon: float) -> float:
    """The step in which the states change by half their tolerance, at most a thousandth of the horizon.

    As IDAS has it (`IDASolve`), but for the distance of the first output: nothing may depend on outputs.
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
    """What two mesh points must be apart at least."""
    return float(_ROUNDINGS * np.spacing(max(abs(t), span)))


def most(problem: Problem, fixed: bool = False) -> int:
    """Mesh points at once, of a solver with `fixed` steps or one that chooses them."""
    return int(np.clip(_NUMBERS / (1 + problem.n_dynamic + len(problem.scale_z)), 32, _STEPS if fixed else _POINTS))


@cache
def shares(ramps: int, count: int) -> Vector:
    """Mesh points that move apart, as shares of the time from their start to the last.

    `ramps` of them are ever four times as far from the start as the one before, up to a spacing; then come `count`, the
    first one spacing away, each a little farther from the one before. An integrator for these is kept over stretches
    and runs, and so there are few.
    """
    ramp = _RAMP ** np.arange(-ramps, 0.0)
    spaced = _total(np.arange(1, count + 1))
    return np.asarray(np.append(ramp, spaced) / spaced[-1])


@cache
def even(count: int) -> Vector:
    """Mesh points that are as far apart, as shares of the time to the last."""
    return np.linspace(0.0, 1.0, count + 1, dtype=np.float64)[1:]


def _total(count: NDArray[np.int64]) -> Vector:
    """How far so many mesh points reach, in spacings."""
    return np.asarray((_GROWTH**count - 1.0) / (_GROWTH - 1.0), dtype=np.float64)


@cache
def _reaches(most: int) -> tuple[NDArray[np.int64], Vector]:
    """Numbers of looks, up to so many, and how far each reaches, in spacings."""
    counts = _FEWEST * 2 ** np.arange(1 + int(math.log2(most // _FEWEST)))
    return counts, _total(counts)


def growing(length: float, first: float, spacing: float, most: int, least: float) -> tuple[float, Vector]:
    """How far mesh points reach, at most over a length, and their shares of it (`shares`).

    `first` is the first step of the solver, inf where it begins with steps of any length; `least` what mesh points must
    be apart.
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
    return min(float(reach[k]), length), shares(min(ramps, _MOST_RAMPS), int(counts[k]))


def begun(shares: Vector, length: float, first: float) -> float:
    """The first step with such mesh points: one for each grid that begins with it, else `first`."""
    own = float(shares[0]) * length / _FIRST
    return own if 0.99 * first <= _RAMP * own <= _RAMP * first else min(first, length)


def stepped(start: float, outputs: Vector, end: float, step: float, count: int) -> Vector:
    """Mesh points for fixed steps: every other step of those that outputs are apart by, so that they cost no further
    ones."""
    first = int(np.searchsorted(outputs, start, side="right"))
    last = min(int(np.searchsorted(outputs, end)), first + count)  # each is one mesh point at least
    stops = np.append(outputs[first:last], end)
    gaps = np.diff(stops, prepend=start)
    counts = np.maximum(1, np.ceil(gaps / (2.0 * step) - 1e-9)).astype(np.int64)
    reached = np.cumsum(counts)
    kept = int(np.searchsorted(reached, count)) + 1
    stops, gaps, counts, reached = stops[:kept], gaps[:kept], counts[:kept], reached[:kept]
    place = np.arange(1, int(reached[-1]) + 1) - np.repeat(reached - counts, counts)
    mesh = np.repeat(stops - gaps, counts) + np.repeat(gaps, counts) * place / np.repeat(counts, counts)
    mesh[reached - 1] = stops
    return np.asarray(mesh[: max(count, 1)])


def merged(mesh: Vector, outputs: Vector) -> tuple[Vector, Vector]:
    """Mesh points, moved onto outputs that are all but there, and both together up to the last one."""
    outputs = outputs[: np.searchsorted(outputs, mesh[-1], side="right")]
    if not len(outputs) or np.array_equal(outputs, mesh):
        return mesh, mesh
    place = np.clip(np.searchsorted(outputs, mesh), 0, len(outputs) - 1)
    below = np.maximum(place - 1, 0)
    near = np.where(np.abs(outputs[place] - mesh) < np.abs(outputs[below] - mesh), outputs[place], outputs[below])
    gaps = np.diff(mesh, prepend=min(mesh[0], outputs[0]) if len(mesh) == 1 else 2 * mesh[0] - mesh[1])
    close = np.abs(near - mesh) <= 1e-3 * np.abs(gaps)
    close[-1] = False
    moved = np.unique(np.where(close, near, mesh))
    return moved, np.union1d(moved, outputs)
