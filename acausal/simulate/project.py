"""Recorded points are put onto the constraints that the integration only stabilises.

The stabilised equations keep the distance to the constraints near the tolerance; the shortest way onto them (in units
of the nominal magnitudes) moves a point by no more than that distance. Source: E. Hairer, G. Wanner, Solving Ordinary
Differential Equations II (1996), section VII.2, projection methods.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acausal.lower.compiled import CompiledModel

Vector = NDArray[np.float64]


def projected(compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector) -> Vector:
    """States nearest to `x`, shape (nx, n), that satisfy all stabilised constraints; `x` itself without any."""
    return projection(compiled, times, x, z, u, p, m)[0]


def projection(
    compiled: CompiledModel, times: Vector, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector
) -> tuple[Vector, float | None]:
    """The same, and the largest residual of the constraints before it; None without constraints."""
    if not compiled.solution.structure.invariants or not len(times):
        return x, None
    scale = compiled.nominal_x
    x, drift = x.copy(), None
    for _ in range(3):
        g, slope = constraints(compiled, times, x, z, u, p, m)
        drift = float(np.abs(g).max()) if drift is None else drift
        if np.abs(g).max() < 1e-14:
            break
        slope = slope * scale[None, None, :]
        step = np.einsum("kji,kj->ki", slope, _solved(slope @ slope.transpose(0, 2, 1), g))
        if not np.isfinite(step).all():
            break
        x -= scale[:, None] * step.T
    return x, drift


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
