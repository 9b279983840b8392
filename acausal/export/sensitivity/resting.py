"""Runs that rest on a kink: there they have two derivatives by what moves them off it.

A body that nothing moves stands where its friction turns over, a reservoir is as full as its overflow is high: what is
differentiated there is the equation of one side, or the mean of both. A kink that is only passed does no harm, so one
row in the middle of each stretch tells, and of the outputs the end.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.kinks import two_sides
from acausal.export.sensitivity.chain import Chain
from acausal.export.sensitivity.slopes import Slopes
from acausal.simulate.driver.hybrid import Hybrid
from acausal.simulate.events.guards import Moment

# A guard that moves by less, in what it may be wrong, does not move.
_STILL, _FAR = 1e-4, 1e-9


def refuse_resting(chain: Chain, hybrid: Hybrid) -> None:
    """Raise ExportError AC615 where the run has other derivatives on both sides of what it rests on."""
    times, x, z, _ = hybrid.recorder.rows()
    for k in range(len(chain.passages)):
        stretch = chain.stretch(k)
        inside = np.flatnonzero((times > stretch.start) & (times < stretch.end))
        if not len(inside):
            continue
        row = int(inside[len(inside) // 2])
        moment = Moment(x[:, row], z[:, row], stretch.m, stretch.regime)
        rates = moment.regime.compiled.rhs
        _refuse(chain, hybrid, float(times[row]), moment, lambda *a: rates(*a)[0], ("rates",), k)  # noqa: B023
    if chain.terminal is None:
        key = "outputs", *(output.name for output in chain.wanted)
        _refuse(chain, hybrid, chain.stop, chain.last, chain.observed, key, len(chain.passages) - 1)


def _refuse(
    chain: Chain, hybrid: Hybrid, t: float, moment: Moment, function: Any, key: tuple[Any, ...], k: int
) -> None:
    """Refuse two sides along the variations of the run at a point of stretch `k`: asked for where any sides differ."""
    rng = np.random.default_rng(0)
    size_x, size_p = np.maximum(np.abs(moment.x), chain.compiled.nominal_x), _sizes(chain)
    moving = np.arange(chain.nx) < chain.nx - chain.compiled.discretes
    anyway = rng.choice([-1.0, 1.0], chain.nx) * size_x * moving, rng.choice([-1.0, 1.0], chain.count) * size_p
    if not _differs(chain, hybrid, t, moment, function, key, anyway):
        return
    variations = chain.variations(k, t)[: chain.nx]
    for j, name in enumerate(chain.chosen):
        by_p = np.zeros(chain.count)
        by_p[j] = 1.0
        # as far as the largest of what moves goes by its own size
        share = 1.0 / max(np.max(np.abs(variations[:, j]) / size_x, initial=0.0), 1.0 / size_p[j])
        if _differs(chain, hybrid, t, moment, function, key, (share * variations[:, j] * moving, share * by_p)):
            raise ExportError(
                "AC615",
                f"sensitivities do not take {chain.compiled.name}: at t = {t:.9g} s it rests on a kink or a jump",
                evidence=[f"its derivative by {chain.compiled.parameters[name]} is another one on both sides"],
                cause="a relation, minimum, maximum or fabs changes sides exactly where the run stays",
                help="choose parameters by which it is on one side, or differentiate by those only that do not move it",
            )


def _sizes(chain: Chain) -> Vector:
    own = np.abs(chain.p[chain.chosen])
    return np.where(own > 0.0, own, 1.0)


def _differs(
    chain: Chain,
    hybrid: Hybrid,
    t: float,
    moment: Moment,
    function: Any,
    key: tuple[Any, ...],
    way: tuple[Vector, Vector],
) -> bool:
    """Whether a function has other values or slopes on both sides of a point along a way of states and parameters."""
    slopes, (dx, dp) = chain.slopes, way
    regime, held = moment.regime, moment.regime.held.owners
    dz = np.zeros(len(moment.z))
    if len(dz):
        by_x, by_p, _ = slopes.total(regime, ("algebraic",), lambda *a: a[2], t, moment)
        dz = by_x[:, : chain.nx] @ dx + by_p @ dp

    def beside(share: float) -> Moment:
        return replace(moment, x=moment.x + share * dx, z=moment.z + share * dz)

    falls = np.zeros(len(held))
    if len(held):
        g, rate, noise = hybrid.guards.state(t, moment)
        by_x, by_p, _ = slopes.total(regime, ("guards",), lambda *a: regime.held.watch(*a), t, moment)
        falls = _FAR * (by_x[:, : chain.nx] @ dx + by_p @ dp)
        is_resting = (np.abs(g) <= noise) & (np.abs(rate) <= noise) & np.array([side < 0 for _, side in held])
        falls[~is_resting | (np.abs(falls) <= _STILL * noise)] = 0.0
    size_x, size_p = np.maximum(np.abs(moment.x), chain.compiled.nominal_x), _sizes(chain)
    size = size_x if key == ("rates",) else np.ones(len(chain.wanted))

    def table(share: float) -> Vector:
        at = hybrid.iteration.flipped(beside(share), share * falls < 0.0)
        p = chain.p.copy()
        p[chain.chosen] += share * dp
        own = Slopes(chain.compiled, p, chain.u, chain.chosen)
        by_x, by_p, _ = own.total(regime, key, function, t, at)
        value = np.array(function(t, at.x, at.z, chain.u, p, at.m)).ravel()
        found = np.column_stack([value, by_x[:, : chain.nx] * size_x, by_p * size_p])
        return np.asarray(found / size[:, None])

    return two_sides(table) is not None
