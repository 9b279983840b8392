"""Minimal coordinates on stabilised constraints: two states for each degree of freedom.

The constraints g(t, x, u) = 0 of all levels (positions and velocities) determine as many states as there are
constraints. These dependent states are functions of the others by the implicit function theorem. For motions on the
constraints the stabilisation terms vanish, so that their poles do not appear. Source: E. Hairer, G. Wanner, Solving
Ordinary Differential Equations II (1996), VII.2, local state space form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.linalg

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel
from acausal.simulate.start.initialize import Start
from acausal.simulate.start.nearest import nearest_on_constraints

_RANK = 1e-9  # pivots below this fraction of the largest one do not count for the rank
_WORST = 100.0  # preferred coordinates may have a condition number this many times that of the best ones


@dataclass(frozen=True, eq=False)
class Minimal:
    """Indices `places` of n minimal coordinates among the states, and derivatives of all states by these and by inputs.

    `of_coordinates` has shape (nx, n), `of_inputs` (nx, nu).
    """

    places: tuple[int, ...]
    of_coordinates: Vector
    of_inputs: Vector


def minimal(compiled: CompiledModel, t: float, start: Start, u: Vector, p: Vector, m: Vector) -> Minimal:
    """The best-conditioned minimal coordinates at a point; all states if there are no stabilised constraints.

    Discrete variables are always among them: no constraint determines a variable that only events change.

    `u`, `p`, `m`: shapes (nu,), (np,), (nm,). Raises ExportError: AC604 where the constraints are dependent.
    """
    nx = len(start.x)
    if not compiled.solution.structure.invariants:
        return Minimal(tuple(range(nx)), np.eye(nx), np.zeros((nx, len(u))))
    s = Symbols(compiled)
    g = compiled.constraints(*s.inputs)[0]
    slopes = ca.Function("slopes", s.inputs, [ca.densify(ca.jacobian(g, v)) for v in (s.x, s.u)])
    by_x, by_u = (np.array(v, dtype=float) for v in slopes(t, start.x, start.z, u, p, m))
    dependent = _dependent_states(compiled, by_x * compiled.nominal_x)
    if not np.isfinite(by_x).all() or not _is_regular(by_x * compiled.nominal_x):
        raise _singular(compiled, t)
    rest = [k for k in range(nx) if k not in dependent]
    inverse = np.linalg.pinv(by_x[:, dependent] * compiled.nominal_x[dependent], rcond=_RANK)
    of_coordinates, of_inputs = np.zeros((nx, len(rest))), np.zeros((nx, len(u)))
    of_coordinates[rest] = np.eye(len(rest))
    of_coordinates[dependent] = -compiled.nominal_x[dependent, None] * (inverse @ by_x[:, rest])
    of_inputs[dependent] = -compiled.nominal_x[dependent, None] * (inverse @ by_u)
    return Minimal(tuple(rest), of_coordinates, of_inputs)


def _dependent_states(compiled: CompiledModel, slope: Vector) -> list[int]:
    """Indices of the dependent states, preferably without a fixed start; `slope` is dg/dx scaled, shape (n_g, nx)."""
    continuous = compiled.state_variables[: len(compiled.state_variables) - compiled.discretes]
    slope = slope[:, : len(continuous)]
    weight = np.array([0.01 if v in compiled.start.direct else 1.0 for v in continuous])
    best = _pivots(slope, np.ones(len(weight)))
    preferred = _pivots(slope, weight)
    if _condition(slope, preferred) <= _WORST * _condition(slope, best):
        return preferred
    return best


def _is_regular(slope: Vector) -> bool:
    """Whether the rank of the constraints is clear: no singular value is small without being zero up to rounding."""
    sizes = np.linalg.svd(slope, compute_uv=False)
    small = (sizes <= 1e-6 * sizes[0]) & (sizes > 1e-13 * sizes[0])
    return len(slope) <= slope.shape[1] and not small.any()


def _pivots(slope: Vector, weight: Vector) -> list[int]:
    """Columns of the largest pivots of a QR factorisation, as many as the rank."""
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
    """The point on the constraints nearest to `start`.

    States at the indices `held` and discrete variables keep their values, and so do states with a fixed start if
    possible.

    Raises ExportError: AC609 if there is no such point.
    """
    if not compiled.solution.structure.invariants:
        return start
    fixed = {k for k, v in enumerate(compiled.state_variables) if v in compiled.start.direct}
    constant = {*held, *range(len(start.x) - compiled.discretes, len(start.x))}
    nearest = nearest_on_constraints(compiled, t, start.x, start.z, u, p, m, {*constant, *fixed})
    if nearest is None:
        nearest = nearest_on_constraints(compiled, t, start.x, start.z, u, p, m, constant)
    if nearest is None:
        names = [f"{compiled.states[k]} = {start.x[k]:g}" for k in held]
        raise ExportError(
            "AC609",
            f"{compiled.name}: the states given do not lie on the constraints at t = {t:g} s",
            evidence=[f"given: {', '.join(names)}"] if names else [],
            cause="more states are given than the degrees of freedom, or the mechanism does not reach there",
            help="give as many states as there are degrees of freedom, and their rates; the others follow",
        )
    return Start(nearest, start.z, start.notes)


def _singular(compiled: CompiledModel, t: float) -> ExportError:
    return ExportError(
        "AC604",
        f"{compiled.name} has no linearization at t = {t:g} s: its constraints depend on each other there",
        cause="a mechanism that is stretched out or folds back exactly at this point",
        help="linearise slightly before or after it, or at other states",
    )
