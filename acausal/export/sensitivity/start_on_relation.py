"""Detection of runs that begin exactly on a relation, whose event a parameter moves to later, or out of the run.

A force that jumps where a tip touches acts from the start on, or from an instant that moves: final values have a
derivative for one sign of the change, and a different one, or none, for the other. Functions that are continuous there
are differentiable enough.
"""

from __future__ import annotations

import numpy as np

from acausal.errors import ExportError
from acausal.export.sensitivity.chain import Chain
from acausal.simulate.events.guards import Moment

# Relative difference of rates that counts as none; variation of a guard, relative to its error, that counts as none.
_SAME, _STILL = 1e-9, 1e-9


def refuse_start_on_relation(chain: Chain) -> None:
    """Raise ExportError AC615 if a run begins on a relation with an effect, from which parameters move it away."""
    passage = chain.passages[0]
    t, moment = passage.time, passage.happened.moment
    owners = moment.regime.active_set.owners
    if not owners:
        return
    g, rate, noise = chain.hybrid.guards.state(t, moment)
    near = (np.abs(g) <= noise) & (np.abs(rate) > noise) & np.array([side < 0 for _, side in owners])
    if not near.any():
        return
    by_x, by_p, *_ = chain.event(passage)
    variations = by_x @ chain.start() + by_p
    slopes = chain.slopes.total(moment.regime, ("guards",), lambda *a: moment.regime.active_set.watch(*a), t, moment)
    moves = np.abs(slopes[0] @ variations + slopes[1])
    sizes = np.abs(chain.p[chain.chosen])
    moves *= np.where(sizes > 0.0, sizes, 1.0)
    for k in np.flatnonzero(near & (moves > _STILL * noise[:, None]).any(axis=1)).tolist():
        other = chain.hybrid.iteration.consistent(t, chain.hybrid.iteration.flipped(moment, np.arange(len(g)) == k))
        if not _acts(chain, t, moment, other):
            continue
        cause = chain.hybrid.guards.causes[owners[k][0]]
        name = chain.compiled.parameters[chain.chosen[int(np.argmax(moves[k]))]]
        raise ExportError(
            "AC615",
            f"sensitivities do not take {chain.compiled.name}: it begins exactly on a relation, at t = {t:.9g} s",
            where=() if cause.where is None else (cause.where,),
            evidence=[f"{cause.text}: {name} moves it to one side, where it happens later, or to the other"],
            cause="what happens there is done at the start, or later, or never: the derivatives of both sides differ",
            help="a start clearly on one side of it, or other parameters",
        )


def _acts(chain: Chain, t: float, moment: Moment, other: Moment) -> bool:
    """Whether rates jump across a relation, or a clause acts when it is crossed from the `other` side."""
    rates = [chain.slopes.rate(m.regime, t, m) for m in (moment, other)]
    if (np.abs(rates[1] - rates[0]) > _SAME * (np.abs(rates[0]) + np.abs(rates[1]))).any():
        return True
    after = chain.hybrid.iteration.settle(t, moment, other.m)
    return bool(after.acted) or after.terminated is not None or not np.array_equal(after.moment.x, moment.x)
