"""The states nearest to given ones that satisfy conditions which do not determine all of them.

In other cases the structure decides which states keep their guesses (`analyse/start.py`). It does not show that a rod
between two ball joints rotates about itself independently of its other coordinates, or that the length of a quaternion
is arbitrary, and the remaining system is then singular. Here no states are selected: steps of Newton's method are the
shortest ones that satisfy the conditions to first order, in units of the nominal magnitudes.

Source: P. Deuflhard, Newton Methods for Nonlinear Problems (2004), section 4.4, Gauss-Newton for underdetermined
systems.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import casadi as ca
import numpy as np

from acausal.arrays import Vector
from acausal.lower.build import Symbols
from acausal.lower.compiled import CompiledModel

Conditions = Callable[[Vector], tuple[Vector, Vector]]
"""`(x) -> (values, slope)`, shapes (k,) and (k, nx)."""

_MOST_STEPS = 80
_CONVERGED, _SATISFIED = 1e-12, 1e-10
_RANK = 1e-10  # smallest singular value that counts, relative to the largest
_INCONSISTENT = 1e-6  # error of a condition, relative to its terms, that rounding does not explain
_LEAST_FRACTION = 1e-4  # smallest fraction of a step that is tried
# The fraction by which a step has to reduce the residual, and the number of successive steps that do not before the
# search ends, because no root is near.
_LEAST_REDUCTION, _MOST_STALLED = 1e-3, 10
_LONGEST_STEP = 3.0  # longest step relative to the largest value, so that angles do not make whole turns on the way


def nearest_start(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
) -> Vector | None:
    """States that satisfy all start conditions and are nearest to `x`; shape (nx,).

    States with a fixed start, and those at the indices `held`, do not change. None if the conditions involve algebraic
    variables, or if no such states are found.
    """
    s = Symbols(compiled)
    values = ca.vertcat(*compiled.conditions(*s.inputs))
    if not values.numel() or ca.jacobian_sparsity(values, s.z).nnz():
        return None
    function = ca.Function("conditions", s.inputs, [values, ca.densify(ca.jacobian(values, s.x))])
    fixed = [k for k, v in enumerate(compiled.state_variables) if v in compiled.start.direct]
    return _nearest(compiled, _conditions(function, t, z, u, p, m), x, {*fixed, *held})


def nearest_on_constraints(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
) -> Vector | None:
    """States on the stabilised constraints that are nearest to `x`, shape (nx,); those at indices `held` stay."""
    return _nearest(compiled, _conditions(compiled.constraints, t, z, u, p, m), x, held)


def unreachable(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, free: Collection[int]
) -> tuple[int, float] | None:
    """The first start condition of states alone that cannot be satisfied, and its residual; None if all of them can.

    The residuals are those of a local least-squares solution, from the guesses `x`. Conditions are left out that
    contain all states of another one and more: conditions of rates follow those of positions, and have no finite
    solution if these have none.
    """
    from scipy.optimize import least_squares  # an import of 0.1 s, needed only by starts that fail

    s, indices = Symbols(compiled), sorted(free)
    values = compiled.conditions(*s.inputs)[0]
    of_z, by_x = set(ca.jacobian_sparsity(values, s.z).row()), ca.jacobian_sparsity(values, s.x)
    states_of: dict[int, set[int]] = {k: set() for k in range(values.numel()) if k not in of_z}
    for row, column in zip(by_x.row(), by_x.get_col(), strict=True):
        if row in states_of and column in indices:
            states_of[row].add(column)
    rows = [
        k
        for k, states in states_of.items()
        if states and not any(other and other < states for other in states_of.values())
    ]
    if not rows:
        return None
    function = ca.Function("conditions", s.inputs, [values[rows], ca.densify(ca.jacobian(values[rows], s.x))])
    conditions, scale = _conditions(function, t, z, u, p, m), compiled.nominal_x[indices]

    def at(y: Vector) -> tuple[Vector, Vector]:
        here = x.copy()
        here[indices] = scale * y
        left, slope = conditions(here)
        return left, slope[:, indices] * scale

    first = x[indices] / scale
    if not all(np.isfinite(part).all() for part in at(first)):
        return None

    options: dict[str, Any] = {"jac": lambda y: at(y)[1], "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    solution = least_squares(lambda y: at(y)[0], first, **options)
    violated = np.flatnonzero(np.abs(solution.fun) > _INCONSISTENT * (1.0 + np.abs(solution.jac) @ np.abs(solution.x)))
    if not violated.size:
        return None
    texts = [compiled.start.conditions[k].text for k in rows]
    elements = [k for k, text in enumerate(texts) if text == texts[violated[0]]]
    return rows[violated[0]], float(np.linalg.norm(solution.fun[elements]))


def _conditions(function: Any, t: float, z: Vector, u: Vector, p: Vector, m: Vector) -> Conditions:
    def conditions(x: Vector) -> tuple[Vector, Vector]:
        values, slope = (np.array(ca.densify(part), dtype=float) for part in function(t, x, z, u, p, m))
        return values.ravel(), slope

    return conditions


def _nearest(compiled: CompiledModel, conditions: Conditions, x: Vector, held: Collection[int]) -> Vector | None:
    free = [k for k in range(len(x)) if k not in held]
    return shortest(conditions, x, free, compiled.nominal_x[free])


def shortest(conditions: Conditions, x: Vector, free: list[int], scale: Vector) -> Vector | None:
    """Values that satisfy the conditions, shape (n,), by shortest steps from `x` of those at the indices `free`.

    Conditions may be redundant if they are consistent. None if no such values are found.

    `scale`: Magnitudes of the free values, in units of which the lengths of steps are measured; shape (len(free),).
    """
    x = x.copy()
    values, slope = _at(conditions, x, free, scale)
    stalled = 0
    for _ in range(_MOST_STEPS if free else 0):
        if not (np.isfinite(values).all() and np.isfinite(slope).all()):
            return None
        step = np.linalg.lstsq(slope, -values, rcond=_RANK)[0]
        longest = float(np.abs(step).max(initial=0.0))
        reach = _LONGEST_STEP * (1.0 + float(np.abs(x[free] / scale).max(initial=0.0)))
        size, length, before = min(1.0, reach / max(longest, 1e-300)), float(np.linalg.norm(values)), x[free]
        first = size
        while True:
            x[free] = before + size * scale * step
            values, slope = _at(conditions, x, free, scale)
            if not length or np.linalg.norm(values) < (1.0 - 0.1 * size) * length or size < _LEAST_FRACTION * first:
                break
            size /= 2
        stalled = stalled + 1 if np.linalg.norm(values) > (1.0 - _LEAST_REDUCTION) * length > _INCONSISTENT else 0
        if stalled == _MOST_STALLED:
            return None
        largest = float(np.abs(x[free] / scale).max(initial=0.0))
        if float(np.abs(step).max(initial=0.0)) <= _CONVERGED * (1.0 + largest):
            break
    allowed = _SATISFIED * (1.0 + float(np.abs(x).max(initial=0.0)))
    return x if float(np.abs(values).max(initial=0.0)) < allowed else None


def _at(conditions: Conditions, x: Vector, free: list[int], scale: Vector) -> tuple[Vector, Vector]:
    """Conditions and their slopes by the scaled free states, each row divided by its size."""
    values, slope = conditions(x)
    slope = slope[:, free] * scale
    size = sizes_of(slope)
    return values / size, slope / size[:, None]


def sizes_of(slope: Vector) -> Vector:
    """Sizes of conditions from the rows of their slope, limited below because tiny rows may be rounding errors."""
    length = np.linalg.norm(slope, axis=1)
    least = 1e-3 * min(1.0, float(length.max(initial=0.0)) or 1.0)
    return np.asarray(np.maximum(length, least))
