"""One unknown of a nonlinear block, solved inside the equations: safeguarded Newton steps, as many as it takes.

A variable declared `monotone_above=low` promises that what is left of its block, once all else follows from it, rises
or falls steadily with it from `low` on, along a curve that bends to one side. Newton's method from `low` then comes
nearer from one side without ever leaving it, for it follows tangents that lie beyond the curve (J. M. Ortega, W. C.
Rheinboldt, Iterative Solution of Nonlinear Equations in Several Variables, 1970, theorem 13.3.4). So the block needs no
algebraic variable, and an ordinary differential equation is left over.

The steps are written out: the derivatives of the last one are those of the implicit function theorem, since what is
left of the residual is rounding. How many they are is measured at the sample points. A run that needs more gets no
number at all, which every solver refuses, rather than a wrong one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acausal.analyse.blocks.linear import LinearForm
from acausal.flatten.pool import Pool
from acausal.flatten.reduced import nominal
from acausal.flatten.scalars.differentiate import partial
from acausal.numeric.evaluate import values
from acausal.numeric.samples import SamplePoints

MOST_STEPS = 24
"""Blocks that need more are left to the solver: it starts from the last point, which is cheaper."""

_POINTS = 2000
_DECADES = (-8.0, 3.0)
_MARGIN = 2
"""Steps beyond those that the sample points need: a run may come to places that are harder."""
_ACCEPTED = 1e-7
"""Part of the residual at `low` that may be left before the last step of a run; after it, it is about the square."""

Definitions = list[tuple[int, int]]


def causal(pool: Pool, residuals: Sequence[int], unknowns: Sequence[int], torn: int) -> tuple[Definitions, int] | None:
    """All other unknowns as expressions of `torn`, in order, and the one residual that is left; None without them."""
    waiting = list(range(len(residuals)))
    missing = set(unknowns) - {torn}
    definitions: Definitions = []
    progress = True
    while missing and progress:
        progress = False
        for i in list(waiting):
            here = pool.variables_in(residuals[i]) & missing
            if len(here) != 1:
                continue
            (variable,) = here
            form = LinearForm(pool, (variable,)).of(residuals[i])
            # Definitions divide by what cannot vanish: by numbers other than zero, and by them alone.
            if form is None or pool.value(form[1].get(variable, pool.zero)) in (None, 0.0):
                continue
            definitions.append((variable, pool.div(pool.neg(form[0]), form[1][variable])))
            missing.discard(variable)
            waiting.remove(i)
            progress = True
    return (definitions, residuals[waiting[0]]) if not missing and len(waiting) == 1 else None


def newton(points: SamplePoints, residual: int, definitions: Definitions, variable: int, low: float) -> int | None:
    """The node of the solution for `variable`; None where the steps do not reach it at the sample points.

    `definitions` are what else the residual needs, as expressions of `variable`.
    """
    pool = points.reduced.pool
    image: dict[int, int] = {}

    def at(root: int, place: dict[int, int]) -> int:
        done: dict[int, int] = {}
        pool.rewrite([root], lambda v: place.get(v, pool.var(v)), done)
        return done[root]

    for known, node in definitions:
        image[known] = at(node, image)
    rest = at(residual, image)
    correction = pool.div(rest, partial(pool, rest, variable))
    free = pool.sub(pool.var(variable), correction)
    following = pool.make("max", free, pool.const(low))
    count = _steps(points, (rest, partial(pool, rest, variable)), variable, low)
    if count is None:
        return None
    first = here = before = pool.const(low)
    for _ in range(count):
        here, before = at(following, {variable: here}), here
    left, load = (pool.make("fabs", at(rest, {variable: z})) for z in (before, first))
    is_small = pool.make("noevent", pool.make("le", left, pool.mul(pool.const(_ACCEPTED), load)))
    return pool.div(here, pool.where(is_small, pool.one, pool.zero))


def _steps(points: SamplePoints, curve: tuple[int, int], variable: int, low: float) -> int | None:
    """How many steps reach solutions over many orders of magnitude; None for more than MOST_STEPS.

    What the residual depends on is scattered over all that a contact sees between a touch and a blow; then the residual
    is shifted so that a scattered value solves it.
    """
    pool = points.reduced.pool
    random = np.random.default_rng(20090507)

    def scattered() -> NDArray[np.float64]:
        return 10.0 ** random.uniform(*_DECADES, _POINTS)

    known = {
        v: np.resize(points.everywhere(pool.var(v)), _POINTS) * scattered()
        for v in sorted(pool.variables_in(curve[0]))
        if v != variable
    }

    def curve_at(z: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        found = values(
            pool,
            curve,
            {
                "var": lambda v: z if v == variable else known[v],
                "par": points.parameters.__getitem__,
                "time": lambda _: np.zeros(_POINTS),
            },
        )
        return [np.broadcast_to(np.asarray(found[n], dtype=float), (_POINTS,)) for n in curve]

    reach = nominal(points.reduced, variable) * scattered()
    solution = low + reach
    z, load, usable = np.full(_POINTS, low), np.zeros(_POINTS), np.zeros(_POINTS, dtype=bool)
    shift = curve_at(solution)[0]
    with np.errstate(all="ignore"):
        # Where scattered values break the promise, such as an inner diameter beyond the outer one, they say nothing.
        slopes = np.array([curve_at(low + reach * part)[1] for part in (0.0, 1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0)])
        turning = np.diff(np.abs(slopes), axis=0) / np.abs(slopes).max(axis=0)
        bends = (turning <= 1e-9).all(axis=0) | (turning >= -1e-9).all(axis=0)
        kept = (np.sign(slopes) == np.sign(slopes[0])).all(axis=0) & (slopes[0] != 0.0) & bends
        for k in range(1, MOST_STEPS - _MARGIN + 1):
            height, slope = curve_at(z)
            left = height - shift
            step = left / slope
            if k == 1:
                load = np.abs(left)  # less is lost in rounding beside what was shifted
                usable = np.isfinite(step) & kept & (load > 1e-6 * np.maximum(np.abs(height), np.abs(shift)))
                if usable.sum() < 0.25 * _POINTS:
                    return None
            if (np.abs(left) <= _ACCEPTED * load)[usable].all():
                return k + _MARGIN
            z = np.maximum(z - step, low)
    return None
