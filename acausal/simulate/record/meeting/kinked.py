"""Kinks of algebraic equations at which their solutions meet.

Solutions of |y| == |x| meet at x = 0, where y changes its sign. The determinant does not approach zero there, but jumps
from -1 to 1. If an equation is continuous across a kink of its own unknowns, the determinant has equal signs on both
sides; otherwise there are two solutions more on one side than on the other (the index of a solution, see
`branches.py`). Equations that jump (`where(blocks, i, v) == 0`) may have any signs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.recent import once_per_owner
from acausal.simulate.equations.calls.buffered import BufferedFunction
from acausal.simulate.equations.problem import Problem
from acausal.simulate.record.record import Recorder

_MOST, _JUDGED = 1000, 24  # most events and most kinks that are examined
_NEAR, _ASIDE = 1e-5, 1e-6  # distances from a kink: largest one of the run, and that of the points on both sides
_CHANGES = 1e-3  # least relative change of the slopes of the equations across a kink
_JUMPS = 1e-2  # largest change along the kink, as a fraction of that across it, of continuous equations


@dataclass(frozen=True, eq=False)
class _Kinks:
    """Relations of algebraic variables in algebraic equations, and functions of `(t, x, z, u, p, m)`."""

    relations: tuple[int, ...]
    distances: BufferedFunction  # their distance functions
    slopes: Any  # Jacobians of distances and equations by states and unknowns, in nominal magnitudes


@once_per_owner
def _kinks(compiled: CompiledModel) -> _Kinks | None:
    """The kinks of a model that owns its functions (`common`); None if it has none."""
    s, count = Symbols(compiled), len(compiled.state_events.relations)
    alg, known = compiled.rhs(*s.inputs)[1], ca.vertcat(s.x, s.z)
    distances = compiled.events.distances(*s.inputs)
    moved = set(ca.jacobian_sparsity(distances, s.z).row())
    modes = {j - compiled.n_modes + count for j in ca.jacobian_sparsity(alg, s.m).get_col()}
    own = [k for k in sorted(moved) if k in modes or compiled.events.ties[k] < 0]
    if not own:
        return None
    scale = ca.diag(ca.DM(np.concatenate([compiled.nominal_x, compiled.nominal_z])))
    both = [ca.densify(ca.jacobian(v, known) @ scale) for v in (distances[own], alg)]
    here = BufferedFunction(ca.Function("distances", s.inputs, [ca.densify(distances[own])]))
    return _Kinks(tuple(own), here, ca.Function("slopes", s.inputs, both))


def meeting_at_kinks(problem: Problem, recorder: Recorder) -> list[tuple[float, tuple[int, ...]]]:
    """Return the first kink of a run at which solutions meet, and the unknowns that pass it; none or one."""
    kinks = _kinks(problem.compiled.common) if problem.compiled.algebraic and problem.compiled.state_events else None
    if kinks is None:
        return []
    t, x, z, m = recorder.rows()
    events = np.append(0, 1 + np.flatnonzero((m[:, 1:] != m[:, :-1]).any(axis=0)))[:_MOST]
    t, x, z, m = t[events], x[:, events].T.copy(), z[:, events].T.copy(), m[:, events].T.copy()
    distances = kinks.distances.many(t[:, None], x, z, problem.u, problem.p, m)
    judged = 0
    for k in range(len(events)):
        at = float(t[k]), x[k], z[k], problem.u, problem.p, m[k]
        for j in np.flatnonzero(np.abs(distances[k]) < _NEAR * problem.scale_z.max()).tolist():
            judged += 1
            moved = _meeting(problem, kinks, j, at) if judged <= _JUDGED else ()
            if moved:
                return [(float(t[k]), moved)]
    return []


def meeting_relations(problem: Problem, t: float, x: Vector, z: Vector, m: Vector) -> tuple[str, ...]:
    """Return the texts of the relations at whose change solutions meet, by the slopes at this point."""
    compiled = problem.compiled
    kinks = _kinks(compiled.common) if compiled.algebraic and compiled.state_events else None
    at, own = (t, x, z, problem.u, problem.p, m), kinks.relations if kinks else ()
    texts = compiled.events.texts
    return tuple(texts[k] for j, k in enumerate(own) if kinks and _meeting(problem, kinks, j, at, np.inf))


def _meeting(problem: Problem, kinks: _Kinks, j: int, at: tuple[Any, ...], near: float = _NEAR) -> tuple[int, ...]:
    """Return the unknowns of a kink at which the determinant changes sign; none without, or beyond `near`."""
    t, x, z, u, p, m = at
    nx, first = len(x), len(m) - len(problem.compiled.state_events.relations)
    normal = np.array(kinks.slopes(*at)[0])[j]
    size = float(np.linalg.norm(normal[nx:]))
    if not size > 0.0 or abs(float(kinks.distances(*at)[0][j])) > near * size:
        return ()
    sides: list[Vector] = []
    for truth in (0.0, 1.0):
        modes = m.copy()
        modes[first + kinks.relations[j]] = truth
        aside = z + (2 * truth - 1) * _ASIDE * problem.scale_z * normal[nx:] / size
        sides.append(np.array(kinks.slopes(t, x, aside, u, p, modes)[1]))
    reach = np.maximum(np.abs(sides[0]), np.abs(sides[1])).max(axis=1, keepdims=True)
    change = (sides[1] - sides[0]) / np.where(reach > 0.0, reach, 1.0)
    along = change - np.outer(change @ normal, normal) / (normal @ normal)
    if not _CHANGES < np.abs(change).max() or np.abs(along).max() > _JUMPS * np.abs(change).max():
        return ()
    signs = [float(np.linalg.slogdet(side[:, nx:])[0]) for side in sides]
    passing = np.flatnonzero(np.abs(normal[nx:]) > 0.1 * np.abs(normal[nx:]).max())
    return tuple(passing.tolist()) if signs[0] * signs[1] < 0.0 else ()
