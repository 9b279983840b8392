"""Projection of recorded points onto the constraints, which the integration only stabilises.

The stabilised equations keep the distance to the constraints near the tolerance, and the shortest projection (in units
of the nominal magnitudes) moves a point by no more than that distance. If it moves a point by more than ten tolerances,
the run ends, because the cause is something else than the accuracy of the steps. Source: E. Hairer, G. Wanner, Solving
Ordinary Differential Equations II (1996), section VII.2, projection methods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import line
from acausal.errors import IntegrationError, counted
from acausal.flatten.flat import span_of
from acausal.lower.compiled import CompiledModel

_MOST_ITERATIONS = 6  # of Newton's method
_CONVERGED = 1e-9  # residual of a constraint after them, relative to the size of its terms


@dataclass(frozen=True, eq=False)
class Projection:
    """Points on the constraints."""

    x: Vector  # states, shape (nx, n)
    drift: float  # largest residual of the constraints before the projection
    moved: Vector  # change of each state, shape (nx, n); infinite if Newton's method did not converge


def projected(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """States nearest to `x`, shape (nx, n), that satisfy all stabilised constraints; `x` itself if there are none."""
    projection_of_x = projection(compiled, times, x, z, u, p, m)
    return x if projection_of_x is None else projection_of_x.x


def projection(
    compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> Projection | None:
    """Project n rows of a run onto the constraints; None without constraints.

    `times`, `x`, `z` and `m` have shapes (n,), (nx, n), (nz, n) and (nm, n), or (nm,) if modes do not change.
    """
    if not compiled.solution.structure.invariants or not len(times):
        return None
    scale, before, drift = compiled.nominal_x, x, None
    x = x.copy()
    residual = np.full(len(times), np.inf)
    for _ in range(_MOST_ITERATIONS):
        g, jacobian = constraints(compiled, times, x, z, u, p, m)
        drift = float(np.abs(g).max()) if drift is None else drift
        residual = _relative_residual(g, jacobian, np.abs(x) + scale[:, None])
        if not (residual > 1e-14).any():
            break
        jacobian = jacobian * scale[None, None, :]
        step = np.einsum("kji,kj->ki", jacobian, _solved(jacobian @ jacobian.transpose(0, 2, 1), g))
        if not np.isfinite(step).all():
            break
        x -= scale[:, None] * step.T
    assert drift is not None, "constraints are evaluated at least once"
    return Projection(x, drift, np.where(residual < _CONVERGED, np.abs(x - before), np.inf))


def _relative_residual(g: Vector, jacobian: Vector, size: Vector) -> Vector:
    """Residuals of constraints relative to the size of their terms, the largest at each instant, shape (n,)."""
    terms = np.einsum("nki,in->nk", np.abs(jacobian), size)
    return np.asarray(np.max(np.abs(g) / np.maximum(terms, 1e-300), axis=1, initial=0.0))


def off_constraints(
    compiled: CompiledModel, t: float, before: Vector, after: Vector, moved: Vector, most: float
) -> IntegrationError:
    """Build error AC407 for states so far from the constraints that the run is not reliable.

    `before` and `after` are the integrated states, and the nearest ones on the constraints; shape (nx,). `moved` is the
    change of each, relative to its magnitude in the run, and `most` the allowed one.
    """
    structure = compiled.solution.structure
    worst = np.argsort(-moved, kind="stable")[:3].tolist()
    equations = list(dict.fromkeys(structure.flat_equation(e) for e, _ in structure.invariants))
    equation = compiled.flat.equations[equations[0]]
    off = float(moved[worst[0]])
    fact = f"states are {off:.2g} off the constraints" if np.isfinite(off) else "no states satisfy the constraints"
    return IntegrationError(
        "AC407",
        f"{compiled.name}: {fact} at t = {t:.9g} s; {most:.2g} is allowed at this tolerance",
        where=span_of(equation),
        evidence=[
            f"{counted(len(equations), 'equation')} kept by stabilisation, among them",
            line(compiled.flat, equation).strip(),
            *(f"{compiled.states[k]} = {before[k]:.9g}, on the constraints {after[k]:.9g}" for k in worst),
        ],
        cause="a mechanism is fully stretched out or folds back there, or moves too fast for the tolerance",
        help="ask for a smaller tolerance or another solver (--solver rosenbrock), or end the run earlier",
    )


def constraints(
    compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> tuple[Vector, Vector]:
    """Values, shape (n, k), and Jacobians, shape (n, k, nx), of the stabilised constraints at n instants."""
    n = len(times)
    wide = [v if v.ndim == 2 else np.tile(v[:, None], (1, n)) for v in (u, p, m)]
    function = compiled.constraints.map(n)
    g, slope = function(times[None, :], x, z, *wide)
    count = g.shape[0]
    return np.array(g).T, np.array(slope.full() if hasattr(slope, "full") else slope).reshape(count, n, -1).transpose(
        1, 0, 2
    )


def _solved(matrices: Vector, right: Vector) -> Vector:
    """Solutions of small symmetric systems; those of least norm if constraints depend on each other."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrices, hermitian=True) @ right[:, :, None])[:, :, 0], dtype=np.float64)
