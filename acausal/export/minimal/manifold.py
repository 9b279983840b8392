"""Minimal coordinates on stabilised constraints: as many states as the model has degrees of freedom, two for each.

The constraints g(t, x, u) = 0 of all levels bind as many states as they are. Those states follow the others by the
implicit function theorem; along such a motion the stabilisation rests, so that none of its poles is seen. Source: E.
Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), VII.2, local state space form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.linalg

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.lower.compiled import CompiledModel
from acausal.lower.symbols import Symbols
from acausal.simulate.start.initialize import Start
from acausal.simulate.start.nearest import nearest_on_constraints

_RANK = 1e-9  # smallest pivot that counts, by the largest
_WORST = 100.0  # how much worse conditioned the followers of wished coordinates may be than those of the best


@dataclass(frozen=True, eq=False)
class Minimal:
    """Places of the minimal coordinates among n states, and how all states follow them and the inputs.

    `of_coordinates` has shape (nx, n), `of_inputs` (nx, nu).
    """

    places: tuple[int, ...]
    of_coordinates: Vector
    of_inputs: Vector


def minimal(compiled: CompiledModel, t: float, start: Start, u: Vector, p: Vector, m: Vector) -> Minimal:
    """The coordinates that determine all states best at a point; all of them without stabilised constraints."""
    nx = len(start.x)
    if not compiled.solution.structure.invariants:
        return Minimal(tuple(range(nx)), np.eye(nx), np.zeros((nx, len(u))))
    s = Symbols(compiled)
    g = compiled.constraints(*s.inputs)[0]
    slopes = ca.Function("slopes", s.inputs, [ca.densify(ca.jacobian(g, v)) for v in (s.x, s.u)])
    by_x, by_u = (np.array(v, dtype=float) for v in slopes(t, start.x, start.z, u, p, m))
    followers = _followers(compiled, by_x * compiled.nominal_x)
    if not np.isfinite(by_x).all() or not _is_regular(by_x * compiled.nominal_x):
        raise _singular(compiled, t)
    rest = [k for k in range(nx) if k not in followers]
    inverse = np.linalg.pinv(by_x[:, followers] * compiled.nominal_x[followers], rcond=_RANK)
    of_coordinates, of_inputs = np.zeros((nx, len(rest))), np.zeros((nx, len(u)))
    of_coordinates[rest] = np.eye(len(rest))
    of_coordinates[followers] = -compiled.nominal_x[followers, None] * (inverse @ by_x[:, rest])
    of_inputs[followers] = -compiled.nominal_x[followers, None] * (inverse @ by_u)
    return Minimal(tuple(rest), of_coordinates, of_inputs)


def _followers(compiled: CompiledModel, slope: Vector) -> list[int]:
    """States that the constraints determine: rather those without a fixed start, where these do nearly as well."""
    wished = np.array([0.01 if v in compiled.start.direct else 1.0 for v in compiled.state_variables])
    best = _pivots(slope, np.ones(len(wished)))
    found = _pivots(slope, wished)
    if _condition(slope, found) <= _WORST * _condition(slope, best):
        return found
    return best


def _is_regular(slope: Vector) -> bool:
    """Whether the constraints have the rank that they have beside the point: no singular value is merely small."""
    sizes = np.linalg.svd(slope, compute_uv=False)
    small = (sizes <= 1e-6 * sizes[0]) & (sizes > 1e-13 * sizes[0])
    return len(slope) <= slope.shape[1] and not small.any()


def _pivots(slope: Vector, weight: Vector) -> list[int]:
    """Columns of largest pivots in a QR factorisation, as many as the rank."""
    *_, order = scipy.linalg.qr(slope * weight, mode="economic", pivoting=True)
    triangle, *_ = scipy.linalg.qr(slope, mode="r", pivoting=True)
    plain = np.abs(np.diag(triangle))
    rank = int(np.sum(plain > _RANK * plain[0])) if len(plain) else 0
    return sorted(order[:rank].tolist())


def _condition(slope: Vector, columns: Sequence[int]) -> float:
    return float(np.linalg.cond(slope[:, list(columns)]))


def on_constraints(
    compiled: CompiledModel, t: float, start: Start, u: Vector, p: Vector, m: Vector, held: Sequence[int]
) -> Start:
    """The point on the constraints nearest to a point; states at the places `held` stay, those with a fixed start if
    that is possible.

    Raises ExportError: AC609 where there is none.
    """
    if not compiled.solution.structure.invariants:
        return start
    fixed = {k for k, v in enumerate(compiled.state_variables) if v in compiled.start.direct}
    found = nearest_on_constraints(compiled, t, start.x, start.z, u, p, m, {*held, *fixed})
    if found is None:
        found = nearest_on_constraints(compiled, t, start.x, start.z, u, p, m, held)
    if found is None:
        names = [f"{compiled.states[k]} = {start.x[k]:g}" for k in held]
        raise ExportError(
            "AC609",
            f"{compiled.name}: the states given do not lie on the constraints at t = {t:g} s",
            evidence=[f"given: {', '.join(names)}"] if names else [],
            cause="more states are given than the degrees of freedom, or the mechanism does not reach there",
            help="give as many states as there are degrees of freedom, and their rates; the others follow",
        )
    return Start(found, start.z, start.notes)


def _singular(compiled: CompiledModel, t: float) -> ExportError:
    return ExportError(
        "AC604",
        f"{compiled.name} has no linearization at t = {t:g} s: its constraints depend on each other there",
        cause="a mechanism that is stretched out or folds back exactly at this point",
        help="linearize at a time or states beside it",
    )
