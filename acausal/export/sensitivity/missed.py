"""Detection of relations that a run missed by less than their error: for slightly different parameters they are events.

A relation that is barely crossed is refused where its event is differentiated (`Saltation`); one that is barely missed
makes no event. Where a guard approaches zero and recedes within a stretch, its minimum is searched: first among points
of the stretch, then more densely where the parabola through three of them comes close to zero.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.sensitivity.chain import Chain, Stretch
from acausal.simulate.events.guards import Guards, Moment

# Least number of points of a stretch, and number of points between two of them around a minimum.
_FEWEST, _CLOSER = 17, 16
# A parabola is close to zero below this fraction of the guard beside; a guard counts as approaching if it comes from,
# and recedes to, more than this many times its error.
_NEAR, _AWAY = 0.1, 10.0


def refuse_missed(chain: Chain) -> None:
    """Raise ExportError AC615 if a relation was missed by less than its error."""
    guards, watched = chain.hybrid.guards, chain.compiled.state_events.watched
    rows, x, z, _ = chain.hybrid.recorder.rows()
    for k in range(len(chain.passages)):
        stretch = chain.stretch(k)
        own = [
            j
            for j, (relation, side) in enumerate(stretch.regime.active_set.owners)
            if side < 0 and relation not in watched
        ]
        if not own or stretch.end <= stretch.start:
            continue
        inside = (rows > stretch.start) & (rows < stretch.end)
        if np.count_nonzero(inside) < _FEWEST:
            times, _, values = _along(
                chain, guards, stretch, np.linspace(stretch.start, stretch.end, _FEWEST + 2)[1:-1]
            )
        else:
            times, values = rows[inside], _guards(guards, stretch, rows[inside], np.vstack([x, z])[:, inside].T)
        for i, j in _turns(times, values[:, own]):
            _refuse(
                chain,
                guards,
                stretch,
                own[j],
                (float(times[i - 1]), float(times[i + 1])),
                values[:, own[j]][i - 1 : i + 2],
            )


def _along(chain: Chain, guards: Guards, stretch: Stretch, stops: Vector) -> tuple[Vector, Vector, Vector]:
    """Times (n,), variables (n, nx + nz), guards (n, n_guards) at the start, `stops` and end of a stretch."""
    nothing = np.zeros((chain.size, 0))
    known = [(stretch.start, np.concatenate([stretch.x, stretch.z]))]
    known += [(t, variables) for t, variables, _ in stretch.carry(stops, nothing, parameters=False)]
    times, found = np.array([t for t, _ in known]), np.array([v for _, v in known])
    return times, found, _guards(guards, stretch, times, found)


def _guards(guards: Guards, stretch: Stretch, times: Vector, found: Vector) -> Vector:
    """Guards, shape (n, n_guards), at n `times` of a stretch, with variables `found`, (n, nx + nz)."""
    nx = len(stretch.x)
    return guards.along(times, found[:, :nx].T, found[:, nx:].T, stretch.m, stretch.regime)


def _turns(times: Vector, values: Vector) -> Iterator[tuple[int, int]]:
    """(Row, guard) of minima whose parabola through three rows comes close to zero; `values`: shape (n, n_guards)."""
    before, here, behind = values[:-2], values[1:-1], values[2:]
    lowest = (here < before) & (here <= behind) & (here > 0.0)
    for i, j in zip(*np.nonzero(lowest), strict=True):
        if _vertex(times[i : i + 3], values[i : i + 3, j]) < _NEAR * min(before[i, j], behind[i, j]):
            yield int(i) + 1, int(j)


def _vertex(times: Vector, values: Vector) -> float:
    """Minimum of the parabola through three points, shapes (3,), of which the middle one is the lowest."""
    before, behind = (times - times[1])[[0, 2]]
    down, up = (values[0] - values[1]) / before, (values[2] - values[1]) / behind  # slopes of both sides
    bend = (up - down) / (behind - before)
    slope = up - bend * behind
    return float(values[1] - slope * slope / (4.0 * bend)) if bend > 0.0 else float(values[1])


def _refuse(
    chain: Chain, guards: Guards, stretch: Stretch, place: int, around: tuple[float, float], beside: Vector
) -> None:
    """Raise ExportError AC615 for a guard whose minimum between two instants is within its error of zero."""
    stops = np.linspace(*around, 2 * _CLOSER + 1)[1:-1]
    times, x, values = _along(chain, guards, stretch, stops)
    near = np.flatnonzero((times > around[0]) & (times < around[1]))
    k = int(near[np.argmin(values[near, place])])
    at = Moment(x[k, : chain.nx], x[k, chain.nx :], stretch.m, stretch.regime)
    noise = float(guards.rates(float(times[k]), at)[1][place])
    low = _vertex(times[k - 1 : k + 2], values[k - 1 : k + 2, place])
    if low > noise or min(beside[0], beside[2]) <= _AWAY * noise:
        return
    cause = guards.causes[stretch.regime.active_set.owners[place][0]]
    raise ExportError(
        "AC615",
        f"sensitivities do not take {chain.compiled.name}: at t = {times[k]:.9g} s a relation is only just missed",
        where=() if cause.where is None else (cause.where,),
        evidence=[f"{cause.text}: nearer than {noise:.3g} in SI units, by which it may be wrong"],
        help="a tighter tolerance where it is missed by more than the error of a run; else it is passed with hardly "
        "other parameters: choose some by which it is passed clearly or not at all",
    )
