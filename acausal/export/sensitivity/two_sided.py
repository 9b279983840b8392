"""Detection of points of a run whose one-sided derivatives differ, before the run is differentiated.

A body at rest is where its friction changes sign; a reservoir is filled exactly to its overflow. There, differentiation
would use the equation of one side, or the mean of both. A kink that is only crossed is harmless. Therefore two rows
inside each stretch are checked and, for the outputs, the end.

A run may also begin exactly on a relation, whose event a parameter delays or moves out of the run. A force that jumps
when a tip touches acts from the start, or from an instant that moves: final values have a derivative for one sign of
the change, and a different one, or none, for the other. Functions that are continuous there cause no error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Vector
from acausal.errors import ExportError
from acausal.export.kinks import two_sides
from acausal.export.sensitivity.chain import Chain
from acausal.export.sensitivity.jumps import refuse_jumps
from acausal.export.sensitivity.slopes import Slopes
from acausal.simulate.events.guards import Moment

# A guard counts as constant if a displacement of all variables by their magnitude changes it by less than this many
# times its error.
_STILL = 1e3


def refuse_resting(chain: Chain) -> None:
    """Raise ExportError AC615 if the run rests on a kink with different derivatives on both sides."""
    times, x, z, _ = chain.hybrid.recorder.rows()
    for k in range(len(chain.passages)):
        stretch = chain.stretch(k)
        inside = np.flatnonzero((times > stretch.start) & (times < stretch.end))
        if not len(inside):
            continue
        # check two rows, because one may coincide with the crossing of a kink
        points = [
            _Point(chain, float(times[row]), Moment(x[:, row], z[:, row], stretch.m, stretch.regime), k, None)
            for row in (int(inside[len(inside) // 2]), int(inside[len(inside) // 3]))
        ]
        if all(p.is_on_a_kink() for p in points):
            points[0].refuse()
    if chain.terminal is None:
        end = _Point(chain, chain.stop, chain.last, len(chain.passages) - 1, chain.observed)
        if end.is_on_a_kink():
            end.refuse()


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of stretch `k`, at which both sides of the rates, or of `outputs` (unless None), are compared."""

    chain: Chain
    t: float
    moment: Moment
    k: int
    outputs: Any

    @property
    def _sizes(self) -> tuple[Vector, Vector]:
        """Magnitudes of the states, shape (nx,), and of the chosen parameters, shape (count,)."""
        sizes = np.abs(self.chain.p[self.chain.chosen])
        return np.maximum(np.abs(self.moment.x), self.chain.compiled.nominal_x), np.where(sizes > 0.0, sizes, 1.0)

    @property
    def _continuous(self) -> NDArray[np.bool_]:
        """Which states are not discrete variables, shape (nx,)."""
        return np.arange(self.chain.nx) < self.chain.nx - self.chain.compiled.discretes

    def is_on_a_kink(self) -> bool:
        """Whether both sides differ along a random direction of all states and parameters."""
        rng = np.random.default_rng(0)
        dx, dp = (rng.choice([-1.0, 1.0], len(size)) * size for size in self._sizes)
        return self._differs(dx * self._continuous, dp)

    def refuse(self) -> None:
        """Raise ExportError AC615 if both sides differ along the variation of a parameter."""
        chain, (size_x, size_p) = self.chain, self._sizes
        variations = chain.variations(self.k, self.t)[: chain.nx]
        for j, place in enumerate(chain.chosen):
            dp = np.zeros(chain.count)
            # scale so that the state with the largest relative change changes by its magnitude
            dp[j] = 1.0 / max(np.max(np.abs(variations[:, j]) / size_x, initial=0.0), 1.0 / size_p[j])
            if self._differs(dp[j] * variations[:, j] * self._continuous, dp):
                raise ExportError(
                    "AC615",
                    f"sensitivities do not take {chain.compiled.name}: at t = {self.t:.9g} s it rests on a kink or a "
                    "jump",
                    evidence=[f"its derivatives by {chain.compiled.parameters[place]} differ between the two sides"],
                    cause="a relation, minimum, maximum or fabs changes sides exactly where the run stays",
                    help="choose values with which it stays on one side, or leave out parameters that move it",
                )

    def _differs(self, dx: Vector, dp: Vector) -> bool:
        """Whether values or slopes differ on both sides along the direction `dx`, shape (nx,), `dp`, shape (count,)."""
        chain, t, moment = self.chain, self.t, self.moment
        regime, (size_x, size_p) = moment.regime, self._sizes
        outputs = self.outputs
        function, key, size = outputs, ("outputs", *(o.name for o in chain.wanted)), np.ones(len(chain.wanted))
        if function is None:
            function, key, size = (lambda *a: regime.compiled.rhs(*a)[0]), ("rates",), size_x
        dz, guard_changes = np.zeros(len(moment.z)), self._guard_changes(dx, dp)
        if len(dz):
            by_x, by_p, _ = chain.slopes.total(regime, ("algebraic",), lambda *a: a[2], t, moment)
            dz = by_x[:, : chain.nx] @ dx + by_p @ dp

        def table(s: float) -> Vector:
            displaced = replace(moment, x=moment.x + s * dx, z=moment.z + s * dz)
            at = self.chain.hybrid.iteration.flipped(displaced, s * guard_changes < 0.0)
            p = chain.p.copy()
            p[chain.chosen] += s * dp
            slopes = Slopes(chain.compiled, p, chain.u, chain.chosen)
            by_x, by_p, _ = slopes.total(regime, key, function, t, at)
            if outputs is None:
                value = slopes.rate(regime, t, at)
            else:
                value = np.array(outputs(t, at.x, at.z, chain.u, p, at.m)).ravel()
            found = np.column_stack([value, by_x[:, : chain.nx] * size_x, by_p * size_p])
            return np.asarray(found / size[:, None])

        return two_sides(table) is not None

    def _guard_changes(self, dx: Vector, dp: Vector) -> Vector:
        """Changes of guards that rest on zero along `dx` (nx,), `dp` (count,); zero for others; shape (n_guards,)."""
        active = self.moment.regime.active_set
        if not active.owners:
            return np.zeros(0)
        g, rate, noise = self.chain.hybrid.guards.state(self.t, self.moment)
        is_resting = (np.abs(g) <= noise) & (np.abs(rate) <= noise) & np.array([side < 0 for _, side in active.owners])
        if not is_resting.any():
            return np.zeros(len(g))
        by_x, by_p, _ = self.chain.slopes.total(
            self.moment.regime, ("guards",), lambda *a: active.watch(*a), self.t, self.moment
        )
        changes = by_x[:, : self.chain.nx] @ dx + by_p @ dp
        return np.where(is_resting & (np.abs(changes) > _STILL * noise), changes, 0.0)


def refuse_two_sided(chain: Chain) -> None:
    """Raise ExportError AC615 for a run that rests on a kink, starts on an acting relation, or jumps without event."""
    refuse_resting(chain)
    refuse_start_on_relation(chain)
    refuse_jumps(chain)


# Rates with a smaller relative difference count as equal; a guard with a smaller variation, in units of its error,
# counts as constant.
_SAME, _STILL_AT_START = 1e-9, 1e-9


def refuse_start_on_relation(chain: Chain) -> None:
    """Raise ExportError AC615 if a run begins on a relation that has an effect and from which parameters move it."""
    passage = chain.passages[0]
    t, moment = passage.time, passage.happened.moment
    owners = moment.regime.active_set.owners
    if not owners:
        return
    g, rate, noise = chain.hybrid.guards.state(t, moment)
    near = (np.abs(g) <= noise) & (np.abs(rate) > noise) & np.array([side < 0 for _, side in owners])
    if not near.any():
        return
    by_x, by_p, *_ = chain.event(0)
    variations = by_x @ chain.start() + by_p
    slopes = chain.slopes.total(moment.regime, ("guards",), lambda *a: moment.regime.active_set.watch(*a), t, moment)
    moves = np.abs(slopes[0] @ variations + slopes[1])
    sizes = np.abs(chain.p[chain.chosen])
    moves *= np.where(sizes > 0.0, sizes, 1.0)
    for k in np.flatnonzero(near & (moves > _STILL_AT_START * noise[:, None]).any(axis=1)).tolist():
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
            cause="the event happens at the start, or later, or never: the derivatives of both sides differ",
            help="start clearly on one side of it, or choose other parameters",
        )


def _acts(chain: Chain, t: float, moment: Moment, other: Moment) -> bool:
    """Whether rates jump across a relation, or a clause acts when it is crossed from the `other` side."""
    rates = [chain.slopes.rate(m.regime, t, m) for m in (moment, other)]
    if (np.abs(rates[1] - rates[0]) > _SAME * (np.abs(rates[0]) + np.abs(rates[1]))).any():
        return True
    after = chain.hybrid.iteration.settle(t, moment, other.m)
    return bool(after.acted) or after.terminated is not None or not np.array_equal(after.moment.x, moment.x)
