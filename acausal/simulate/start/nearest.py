"""States nearest to given ones that satisfy conditions which leave some of them open.

Which states are left at their guesses is otherwise decided by structure (`analyse/start.py`), which does not see
that a rod between two ball joints turns about itself whatever its other coordinates are, or that the length of a
quaternion is nobody's business: what is left to be solved for is then singular. Here no state is singled out: steps of
Newton's method are the shortest that satisfy the conditions to first order, in units of the nominal magnitudes.

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

_MOST = 80
_CONVERGED, _SATISFIED = 1e-12, 1e-10
_RANK = 1e-10  # smallest singular value that counts, by the largest
_OFF = 1e-6  # what a condition is off by, relative to its terms, that no rounding explains
_SHORTEST = 1e-4  # share of a step that is still tried
_STILL, _MOST_STILL = 1e-3, 10  # what a step must take off at least, and how many in a row may not: no root is near
_REACH = 3.0  # longest step, by the largest of the values: an angle is not turned round and round on the way


def nearest_start(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, held: Collection[int]
) -> Vector | None:
    """States (nx,) that satisfy all start conditions, as near to `x` as possible.

    States with a fixed start, and those at the indices `held`, stay. None where the conditions involve algebraic
    variables, or no such states are found.
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
    """States (nx,) on the stabilised constraints, as near to `x` as possible; those at the indices `held` stay."""
    return _nearest(compiled, _conditions(compiled.constraints, t, z, u, p, m), x, held)


def unreachable(
    compiled: CompiledModel, t: float, x: Vector, z: Vector, u: Vector, p: Vector, m: Vector, free: Collection[int]
) -> tuple[int, float] | None:
    """The first start condition of states alone that stays off, and its length, where all of them are off least.

    Conditions are left out that hold the states of another one and more: those of rates follow those of positions,
    and have no finite answer where these have none. The search ends at the first place where no small step is better,
    from the guesses `x`. None where the conditions can be satisfied.
    """
    from scipy.optimize import least_squares  # a tenth of a second, which only a start that fails has to wait for

    s, places = Symbols(compiled), sorted(free)
    values = compiled.conditions(*s.inputs)[0]
    of_z, by_x = set(ca.jacobian_sparsity(values, s.z).row()), ca.jacobian_sparsity(values, s.x)
    held: dict[int, set[int]] = {k: set() for k in range(values.numel()) if k not in of_z}
    for row, column in zip(by_x.row(), by_x.get_col(), strict=True):
        if row in held and column in places:
            held[row].add(column)
    rows = [k for k, own in held.items() if own and not any(other and other < own for other in held.values())]
    if not rows:
        return None
    function = ca.Function("conditions", s.inputs, [values[rows], ca.densify(ca.jacobian(values[rows], s.x))])
    conditions, scale = _conditions(function, t, z, u, p, m), compiled.nominal_x[places]

    def at(y: Vector) -> tuple[Vector, Vector]:
        here = x.copy()
        here[places] = scale * y
        left, slope = conditions(here)
        return left, slope[:, places] * scale

    first = x[places] / scale
    if not all(np.isfinite(part).all() for part in at(first)):
        return None

    options: dict[str, Any] = {"jac": lambda y: at(y)[1], "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12}
    near = least_squares(lambda y: at(y)[0], first, **options)
    off = np.flatnonzero(np.abs(near.fun) > _OFF * (1.0 + np.abs(near.jac) @ np.abs(near.x)))
    if not off.size:
        return None
    texts = [compiled.start.conditions[k].text for k in rows]
    elements = [k for k, text in enumerate(texts) if text == texts[off[0]]]
    return rows[off[0]], float(np.linalg.norm(near.fun[elements]))


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

    `scale`: Their magnitudes, shape of `free`, by which lengths of steps are measured.
    Conditions may depend on each other where they agree. Returns None where no such values are found.
    """
    x = x.copy()
    values, slope = _at(conditions, x, free, scale)
    still = 0
    for _ in range(_MOST if free else 0):
        if not (np.isfinite(values).all() and np.isfinite(slope).all()):
            return None
        step = np.linalg.lstsq(slope, -values, rcond=_RANK)[0]
        longest = float(np.abs(step).max(initial=0.0))
        reach = _REACH * (1.0 + float(np.abs(x[free] / scale).max(initial=0.0)))
        size, length, before = min(1.0, reach / max(longest, 1e-300)), float(np.linalg.norm(values)), x[free]
        first = size
        while True:
            x[free] = before + size * scale * step
            values, slope = _at(conditions, x, free, scale)
            if not length or np.linalg.norm(values) < (1.0 - 0.1 * size) * length or size < _SHORTEST * first:
                break
            size /= 2
        still = still + 1 if np.linalg.norm(values) > (1.0 - _STILL) * length > _OFF else 0
        if still == _MOST_STILL:
            return None
        largest = float(np.abs(x[free] / scale).max(initial=0.0))
        if float(np.abs(step).max(initial=0.0)) <= _CONVERGED * (1.0 + largest):
            break
    allowed = _SATISFIED * (1.0 + float(np.abs(x).max(initial=0.0)))
    return x if float(np.abs(values).max(initial=0.0)) < allowed else None


def _at(conditions: Conditions, x: Vector, free: list[int], scale: Vector) -> tuple[Vector, Vector]:
    """Conditions and their slopes by the scaled free states, each row by its size."""
    values, slope = conditions(x)
    slope = slope[:, free] * scale
    size = sizes_of(slope)
    return values / size, slope / size[:, None]


def sizes_of(slope: Vector) -> Vector:
    """Sizes of conditions, by the rows of their slope: a row much smaller than others may be rounding."""
    length = np.linalg.norm(slope, axis=1)
    least = 1e-3 * min(1.0, float(length.max(initial=0.0)) or 1.0)
    return np.asarray(np.maximum(length, least))
