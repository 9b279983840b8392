"""Detection of relations that a run missed by less than their error: for slightly different parameters they are events.

A relation that is barely crossed is refused where its event is differentiated (`Saltation`); one that is barely missed
causes no event. Where a guard approaches zero and recedes within a stretch, its minimum is searched for: first among
points of the stretch, then more densely where the parabola through three of them comes close to zero.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.sensitivity.chain import Chain, Stretch
from acausal.simulate.events.guards import Guards, Moment

# Minimum number of points of a stretch, and number of points between two of them around a minimum.
_FEWEST, _CLOSER = 17, 16
# A parabola is close to zero if its minimum is below this fraction of the guard at the neighbouring points. A guard
# counts as approaching and receding if it exceeds this many times its error on both sides of the minimum.
_NEAR, _AWAY = 0.1, 10.0


def refuse_missed(chain: Chain) -> None:
    """Raise ExportError AC615 if a relation was missed by less than its error."""
    guards, watched = chain.hybrid.guards, chain.compiled.state_events.watched
    rows, x, z, _ = chain.hybrid.recorder.rows()
    for k in range(len(chain.passages)):
        stretch = chain.stretch(k)
        candidates = [
            j
            for j, (relation, side) in enumerate(stretch.regime.active_set.owners)
            if side < 0 and relation not in watched
        ]
        if not candidates or stretch.end <= stretch.start:
            continue
        inside = (rows > stretch.start) & (rows < stretch.end)
        if np.count_nonzero(inside) < _FEWEST:
            times, _, values = _along(
                chain, guards, stretch, np.linspace(stretch.start, stretch.end, _FEWEST + 2)[1:-1]
            )
        else:
            times, values = rows[inside], _guards(guards, stretch, rows[inside], np.vstack([x, z])[:, inside].T)
        for i, j in _minima(times, values[:, candidates]):
            guard = candidates[j]
            around = float(times[i - 1]), float(times[i + 1])
            _refuse(chain, guards, stretch, guard, around, values[:, guard][i - 1 : i + 2])


def _along(chain: Chain, guards: Guards, stretch: Stretch, stops: Vector) -> tuple[Vector, Vector, Vector]:
    """Times (n,), variables (n, nx + nz), guards (n, n_guards) at the start, `stops` and end of a stretch."""
    no_variations = np.zeros((chain.size, 0))
    points = [(stretch.start, np.concatenate([stretch.x, stretch.z]))]
    points += [(t, variables) for t, variables, _ in stretch.carry(stops, no_variations, parameters=False)]
    times, w = np.array([t for t, _ in points]), np.array([v for _, v in points])
    return times, w, _guards(guards, stretch, times, w)


def _guards(guards: Guards, stretch: Stretch, times: Vector, w: Vector) -> Vector:
    """Guards, shape (n, n_guards), at n `times` of a stretch, with variables `w`, (n, nx + nz)."""
    nx = len(stretch.x)
    return guards.along(times, w[:, :nx].T, w[:, nx:].T, stretch.m, stretch.regime)


def _minima(times: Vector, values: Vector) -> Iterator[tuple[int, int]]:
    """(Row, guard) of minima whose parabola through three rows comes close to zero; `values`: shape (n, n_guards)."""
    before, here, after = values[:-2], values[1:-1], values[2:]
    lowest = (here < before) & (here <= after) & (here > 0.0)
    for i, j in zip(*np.nonzero(lowest), strict=True):
        if _vertex(times[i : i + 3], values[i : i + 3, j])[1] < _NEAR * min(before[i, j], after[i, j]):
            yield int(i) + 1, int(j)


def _vertex(times: Vector, values: Vector) -> tuple[float, float]:
    """Time and minimum of the parabola through three points, shapes (3,), of which the middle one is the lowest."""
    before, after = (times - times[1])[[0, 2]]
    down, up = (values[0] - values[1]) / before, (values[2] - values[1]) / after  # slopes of both sides
    curvature = (up - down) / (after - before)
    slope = up - curvature * after
    if not curvature > 0.0:
        return float(times[1]), float(values[1])
    return float(times[1] - slope / (2.0 * curvature)), float(values[1] - slope * slope / (4.0 * curvature))


def _refuse(
    chain: Chain, guards: Guards, stretch: Stretch, place: int, around: tuple[float, float], beside: Vector
) -> None:
    """Raise ExportError AC615 if the minimum of a guard between two instants is zero within its error.

    `beside`: values of the guard at the points before, at and after the minimum, shape (3,).
    """
    stops = np.linspace(*around, 2 * _CLOSER + 1)[1:-1]
    times, x, values = _along(chain, guards, stretch, stops)
    near = np.flatnonzero((times > around[0]) & (times < around[1]))
    k = int(near[np.argmin(values[near, place])])
    at = Moment(x[k, : chain.nx], x[k, chain.nx :], stretch.m, stretch.regime)
    noise = float(guards.rates(float(times[k]), at)[1][place])
    lowest_at, low = _vertex(times[k - 1 : k + 2], values[k - 1 : k + 2, place])
    if low > noise or min(beside[0], beside[2]) <= _AWAY * noise:
        return
    cause = guards.causes[stretch.regime.active_set.owners[place][0]]
    raise ExportError(
        "AC615",
        f"sensitivities do not take {chain.compiled.name}: at t = {lowest_at:.9g} s a relation is only just missed",
        where=() if cause.where is None else (cause.where,),
        evidence=[f"{cause.text}: missed by less than {noise:.3g} in SI units, its error"],
        help="use a tighter tolerance, if it is missed by more than the error of a run; otherwise slightly different "
        "parameters cross it: choose values with which it is clearly crossed or missed",
    )
