"""Monotone nonlinear blocks: one unknown solved inside the equations by unrolled, safeguarded Newton steps.

A variable declared `monotone_above=low` guarantees that the residual of its block, with all other unknowns eliminated,
is monotone in it above `low`, and convex or concave. Newton's method started at `low` then converges monotonically
from one side (J. M. Ortega, W. C. Rheinboldt, Iterative Solution of Nonlinear Equations in Several Variables, 1970,
theorem 13.3.4). The block needs no algebraic variable, and an ordinary differential equation remains.

The steps are unrolled, and their number is determined at the sample points. Differentiating the last step gives the
derivatives of the implicit function theorem, since the residual before it is a rounding error. A run that needs more
steps gets nan, which every solver rejects, instead of a wrong number.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.blocks.linear import linear_in
from acausal.flatten.pool import Pool
from acausal.flatten.reduced import nominal
from acausal.flatten.scalars.differentiate import partial
from acausal.numeric.evaluate import values
from acausal.numeric.samples import SamplePoints

MOST_STEPS = 24
"""Blocks that need more steps are left to the solver, which starts from the last point and therefore needs fewer."""

_POINTS = 2000
_DECADES = (-8.0, 3.0)
_MARGIN = 2
"""Steps in excess of those that the sample points need, for points of a run where convergence is slower."""
_ACCEPTED = 1e-7
"""Allowed ratio of the residual before the last step to that at `low`; the last step roughly squares this ratio."""

Definitions = list[tuple[int, int]]


def causal(pool: Pool, residuals: Sequence[int], unknowns: Sequence[int], torn: int) -> tuple[Definitions, int] | None:
    """(Definitions of all other unknowns by `torn`, in evaluation order, remaining residual); None if that fails."""
    remaining = list(range(len(residuals)))
    missing = set(unknowns) - {torn}
    definitions: Definitions = []
    progress = True
    while missing and progress:
        progress = False
        for i in list(remaining):
            unknown = pool.variables_in(residuals[i]) & missing
            if len(unknown) != 1:
                continue
            (variable,) = unknown
            form = linear_in(pool, residuals[i], variable)
            # Divide by nonzero constants only: a coefficient of variables or parameters might vanish.
            if form is None or pool.value(form[1].get(variable, pool.zero)) in (None, 0.0):
                continue
            definitions.append((variable, pool.div(pool.neg(form[0]), form[1][variable])))
            missing.discard(variable)
            remaining.remove(i)
            progress = True
    return (definitions, residuals[remaining[0]]) if not missing and len(remaining) == 1 else None


def newton(points: SamplePoints, residual: int, definitions: Definitions, variable: int, low: float) -> int | None:
    """The node of the solution for `variable`; None if Newton's method does not converge at the sample points.

    `definitions` express the other unknowns of the residual by `variable`.
    """
    pool = points.reduced.pool
    image: dict[int, int] = {}

    def at(root: int, images: dict[int, int]) -> int:
        done: dict[int, int] = {}
        pool.rewrite([root], lambda v: images.get(v, pool.var(v)), done)
        return done[root]

    for unknown, node in definitions:
        image[unknown] = at(node, image)
    rest = at(residual, image)
    correction = pool.div(rest, partial(pool, rest, variable))
    newton_step = pool.sub(pool.var(variable), correction)
    next_iterate = pool.make("max", newton_step, pool.const(low))
    count = _steps(points, (rest, partial(pool, rest, variable)), variable, low)
    if count is None:
        return None
    first = here = before = pool.const(low)
    for _ in range(count):
        here, before = at(next_iterate, {variable: here}), here
    last_residual, first_residual = (pool.make("fabs", at(rest, {variable: z})) for z in (before, first))
    is_small = pool.make("noevent", pool.make("le", last_residual, pool.mul(pool.const(_ACCEPTED), first_residual)))
    return pool.div(here, pool.where(is_small, pool.one, pool.zero))


def _steps(points: SamplePoints, residual_and_slope: tuple[int, int], variable: int, low: float) -> int | None:
    """Number of steps that suffices for solutions over many orders of magnitude; None for more than MOST_STEPS.

    `residual_and_slope` are the nodes of the residual and its derivative by `variable`. Random values of the other
    variables span the range between a light touch and a hard impact of a contact. The residual is then shifted so that
    a random value of `variable` solves it.
    """
    pool = points.reduced.pool
    random = np.random.default_rng(20090507)

    def scattered() -> NDArray[np.float64]:
        return 10.0 ** random.uniform(*_DECADES, _POINTS)

    samples_of = {
        v: np.resize(points.everywhere(pool.var(v)), _POINTS) * scattered()
        for v in sorted(pool.variables_in(residual_and_slope[0]))
        if v != variable
    }

    def values_at(z: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        value_of = values(
            pool,
            residual_and_slope,
            {
                "var": lambda v: z if v == variable else samples_of[v],
                "par": points.parameters.__getitem__,
                "time": lambda _: np.zeros(_POINTS),
            },
        )
        return [np.broadcast_to(np.asarray(value_of[n], dtype=float), (_POINTS,)) for n in residual_and_slope]

    distance = nominal(points.reduced, variable) * scattered()
    solution = low + distance
    z, first_residual, usable = np.full(_POINTS, low), np.zeros(_POINTS), np.zeros(_POINTS, dtype=bool)
    shift = values_at(solution)[0]
    with np.errstate(all="ignore"):
        # Ignore points that contradict the declaration, such as an inner diameter larger than the outer one.
        slopes = np.array([values_at(low + distance * part)[1] for part in (0.0, 1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0)])
        slope_change = np.diff(np.abs(slopes), axis=0) / np.abs(slopes).max(axis=0)
        is_convex_or_concave = (slope_change <= 1e-9).all(axis=0) | (slope_change >= -1e-9).all(axis=0)
        is_monotone = (np.sign(slopes) == np.sign(slopes[0])).all(axis=0) & (slopes[0] != 0.0) & is_convex_or_concave
        for k in range(1, MOST_STEPS - _MARGIN + 1):
            height, slope = values_at(z)
            residual = height - shift
            step = residual / slope
            if k == 1:
                first_residual = np.abs(residual)  # a smaller residual would be lost in the rounding of the shift
                usable = (
                    np.isfinite(step)
                    & is_monotone
                    & (first_residual > 1e-6 * np.maximum(np.abs(height), np.abs(shift)))
                )
                if usable.sum() < 0.25 * _POINTS:
                    return None
            if (np.abs(residual) <= _ACCEPTED * first_residual)[usable].all():
                return k + _MARGIN
            z = np.maximum(z - step, low)
    return None
