"""Recorded points are put onto the constraints that the integration only stabilises.

The stabilised equations keep the distance to the constraints near the tolerance; the shortest way onto them (in units
of the nominal magnitudes) moves a point by no more than that distance. Where it is more than ten tolerances, the run
ends: something else than the accuracy of steps has gone wrong. Source: E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II (1996), section VII.2, projection methods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acausal.arrays import Vector
from acausal.diagnose.words import line
from acausal.errors import IntegrationError, counted
from acausal.flatten.flat import span_of
from acausal.lower.compiled import CompiledModel

_MOST = 6  # steps of Newton's method
_LEFT = 1e-9  # how far off a point may be after them, by the size of what moves it


@dataclass(frozen=True, eq=False)
class Projection:
    """Points on the constraints."""

    x: Vector  # states, shape (nx, n)
    drift: float  # largest residual of the constraints before
    moved: Vector  # how far each state was moved, shape (nx, n); infinite where no point on the constraints was found


def projected(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """States nearest to `x`, shape (nx, n), that satisfy all stabilised constraints; `x` itself without any."""
    found = projection(compiled, times, x, z, u, p, m)
    return x if found is None else found.x


def projection(
    compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> Projection | None:
    """Rows of a run moved onto the constraints, with the changes that this took; None without constraints.

    `times`, `x`, `z`, `m`: Of n rows, shapes (n,), (nx, n), (nz, n) and (nm, n), or (nm,) where modes stay.
    """
    if not compiled.solution.structure.invariants or not len(times):
        return None
    scale, before, drift = compiled.nominal_x, x, None
    x = x.copy()
    off = np.full(len(times), np.inf)
    for _ in range(_MOST):
        g, slope = constraints(compiled, times, x, z, u, p, m)
        drift = float(np.abs(g).max()) if drift is None else drift
        off = _off(g, slope, np.abs(x) + scale[:, None])
        if not (off > 1e-14).any():
            break
        slope = slope * scale[None, None, :]
        step = np.einsum("kji,kj->ki", slope, _solved(slope @ slope.transpose(0, 2, 1), g))
        if not np.isfinite(step).all():
            break
        x -= scale[:, None] * step.T
    assert drift is not None, "constraints are evaluated at least once"
    return Projection(x, drift, np.where(off < _LEFT, np.abs(x - before), np.inf))


def _off(g: Vector, slope: Vector, size: Vector) -> Vector:
    """Residuals by what could make them, the largest of each instant, shape (n,)."""
    could = np.einsum("nki,in->nk", np.abs(slope), size)
    return np.asarray(np.max(np.abs(g) / np.maximum(could, 1e-300), axis=1, initial=0.0))


def off_constraints(
    compiled: CompiledModel, t: float, before: Vector, after: Vector, moved: Vector, most: float
) -> IntegrationError:
    """AC407: states so far from the constraints that the run cannot be believed any more.

    `before`, `after`: States as they were integrated, and nearest to these on the constraints.
    `moved`, `most`: How far each of them that is, by its magnitude in the run, and how far it may be.
    """
    structure = compiled.solution.structure
    worst = np.argsort(-moved, kind="stable")[:3].tolist()
    equations = list(dict.fromkeys(structure.flat_equation(e) for e, _ in structure.invariants))
    equation = compiled.flat.equations[equations[0]]
    far = float(moved[worst[0]])
    fact = f"states are {far:.2g} off the constraints" if np.isfinite(far) else "no states satisfy the constraints"
    return IntegrationError(
        "AC407",
        f"{compiled.name}: {fact} at t = {t:.9g} s; {most:.2g} is allowed at this tolerance",
        where=span_of(equation),
        evidence=[
            f"{counted(len(equations), 'equation')} kept by stabilisation, among them",
            line(compiled.flat, equation).strip(),
            *(f"{compiled.states[k]} = {before[k]:.9g}, on the constraints {after[k]:.9g}" for k in worst),
        ],
        cause="a mechanism that is stretched out or folds back there, or moves faster than the tolerance follows",
        help="ask for a smaller tolerance or another solver (--solver rosenbrock), or end the run before",
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
    """Solutions of small symmetric systems; the shortest where constraints depend on each other."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrices, hermitian=True) @ right[:, :, None])[:, :, 0], dtype=np.float64)
