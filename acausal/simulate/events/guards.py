"""Where the guards of a regime stand: distances, rates, and how far they can be wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal.arrays import Truth, Vector
from acausal.errors import Span
from acausal.lower.events.functions import AT_REST as AT_REST
from acausal.simulate.equations.function_cache import functions_of
from acausal.simulate.equations.problem import Problem
from acausal.simulate.events.regime import Regime
from acausal.simulate.solvers.segment import Tolerances

# Instants are told apart by this share of the run, or of the time, which is a hundred of its roundings.
INSTANT, _ROUNDINGS = 1e-12, 2e-14
# So many instants late a mode may begin: its guards are behind zero then, by more than their noise.
LATE = 100
# What rounding makes of guards that no error moves. Of all others it would be no small number where they are
# picocoulombs.
LEAST = 1e-15
# What rounding makes of loads.
_ROUNDED = 1e-13
# Guards are located to this share of the noise.
LOCATED = 1e-2
# No guard changes more slowly than this, where it is asked how long that takes.
_SLOWEST = 1e-30
# No guard is farther: where a limit is infinite, differences of guards are numbers all the same.
FAR = 1e100


def as_one(span: float, t: Any) -> Any:
    """Instants at times `t` [s], a number or an array, that are nearer than this are one, in a run of length `span`."""
    return np.maximum(INSTANT * span, _ROUNDINGS * np.abs(t))


def located(span: float, times: Vector) -> Vector:
    """How well instants [s] are located, shape (n,): better than they are told apart from others."""
    return np.maximum(LOCATED * INSTANT * span, 0.05 * _ROUNDINGS * np.abs(times))


@dataclass(frozen=True, eq=False)
class Moment:
    """States, algebraic variables and modes at one instant, and the regime they belong to."""

    x: Vector
    z: Vector
    m: Vector
    regime: Regime


@dataclass(frozen=True)
class Cause:
    """What made an event: its words, and where it stands in the source."""

    text: str
    where: Span | None = None
    component: str = ""


class Guards:
    """Distances of one problem; the regime says which of them count."""

    def __init__(self, problem: Problem, tolerances: Tolerances, span: float) -> None:
        self.problem = problem
        self.tolerances = tolerances
        self.span = span
        self.step = 0.0
        """Mean step of the solver [s], as far as it is known."""
        self._last: tuple[float, Moment, float, tuple[Vector, Vector, Vector]] | None = None
        compiled = problem.compiled
        self.first = compiled.n_modes - len(compiled.state_events.relations)

    @cached_property
    def timed(self) -> Truth:
        """See `EventFunctions.timed`."""
        return np.array(self.problem.compiled.events.timed, dtype=bool)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The relations as the user reads them."""
        return self.problem.compiled.events.texts

    @cached_property
    def rests(self) -> Truth:
        """Of each relation whether its sides may be equal for a while."""
        events = self.problem.compiled.state_events
        return np.isin(np.arange(len(events.relations)), list(events.resting))

    @cached_property
    def ties(self) -> NDArray[np.int64]:
        """See `EventFunctions.ties`."""
        return np.array(self.problem.compiled.events.ties, dtype=np.int64)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """The relations with the place of the first statement that holds each; no words where it is no event."""
        places, watched = self.problem.compiled.events.places, self.problem.compiled.state_events.watched
        shown = ("" if k in watched else text for k, text in enumerate(self.texts))
        return tuple(Cause(text, *place) for text, place in zip(shown, places, strict=True))

    def distances(self, t: float, at: Moment) -> Vector:
        """Guards of the regime: positive while it lasts."""
        return np.minimum(at.regime.active_set.guards(t, at.x, at.z, self.problem.u, self.problem.p, at.m)[0], FAR)

    def state(self, t: float, at: Moment) -> tuple[Vector, Vector, Vector]:
        """Distances at the end of a step, their rates, and by how much they can be wrong.

        What a stretch begins with is asked for twice: for the bands of its guards, and by the search.
        """
        known = self._last
        if known is None or known[0] != t or known[1] is not at or known[2] != self.step:
            distances = self.distances(t, at)
            known = self._last = t, at, self.step, (distances, *self.rates(t, at, distances=distances))
        return known[3]

    def rates(
        self, t: float, at: Moment, *, between: bool = False, distances: Vector | None = None
    ) -> tuple[Vector, Vector]:
        """Time derivatives of the guards along the solution, and by how much the distances can be wrong.

        `between` says that the point is no end of a step: errors of it have not relaxed. `distances` are those at
        this point, where they are known.
        """
        problem = self.problem
        # how far values may be off
        x_and_z = 10 * self.tolerances.of(np.concatenate([at.x, at.z]), self._nominal)
        errors = x_and_z[: len(at.x)], x_and_z[len(at.x) :]
        own, noise, by_z, alg, alg_z = at.regime.active_set.rates(t, at.x, at.z, problem.u, problem.p, at.m, *errors)
        if len(at.z):
            moved = np.linalg.lstsq(alg_z.reshape(len(at.z), -1), alg.ravel(), rcond=None)[0]
            own = own - by_z.reshape(len(own), -1) @ moved
        if self.step > 0.0 and not between:
            near = noise > np.abs(self.distances(t, at) if distances is None else distances)
            if near.any():
                noise[near] = np.minimum(noise[near], self._relaxed(t, at, errors[0], np.flatnonzero(near)))
        noise += np.abs(own) * as_one(self.span, t)  # instants are found to rounding only
        noise[noise == 0.0] = LEAST
        if self._shared:
            # an element that carries its limit beside others that are stuck is at its guard but for rounding of loads
            noise += _ROUNDED * (1.0 + np.abs(at.z).max())
        return own, _finite(noise)

    def states(self, times: Vector, x: Vector, at: Moment) -> tuple[Vector, Vector, Vector]:
        """What `state` says, at n ends of steps of a problem without algebraic variables; shapes (n, guards).

        States `x` have shape (n, states); modes and regime are those of `at`.
        """
        problem, error = self.problem, 10 * self.tolerances.of(x, self._nominal)
        common = at.z, problem.u, problem.p, at.m
        if len(times) == 1:  # half the time of a function of many
            found = at.regime.active_set.judged(times[0], x[0], *common, error[0], at.z)[0][None, :]
        else:
            found = at.regime.active_set.judged.many(times[:, None], x, *common, error, at.z)
        count = found.shape[1] // 3
        distances, rates, noises = np.minimum(found[:, :count], FAR), found[:, count : 2 * count], found[:, 2 * count :]
        if self.step > 0.0:
            near = noises > np.abs(distances)
            for k in np.flatnonzero(near.any(axis=1)).tolist():
                here, which = Moment(x[k], at.z, at.m, at.regime), near[k]
                least = self._relaxed(float(times[k]), here, error[k], np.flatnonzero(which))
                noises[k, which] = np.minimum(noises[k, which], least)
        noises += np.abs(rates) * as_one(self.span, times)[:, None]
        noises[noises == 0.0] = LEAST
        return distances, rates, _finite(noises)

    def _relaxed(self, t: float, at: Moment, error: Vector, near: NDArray[np.intp]) -> Vector:
        """How far these guards can be wrong when errors of the states have relaxed over a step (`ActiveSet.relaxed`).

        Taken alone, errors of states that follow others at once are no errors of a solution: the current through
        1e-5 Ohm would be known to several ampere at a tolerance of 1e-4, and a diode conducted backwards as far. What
        the solver leaves of them is what an implicit step of its length does.
        """
        p = self.problem
        given = t, at.x, at.z, p.u, p.p, at.m, error, self.step
        found = at.regime.relaxed(*given, near=near)
        return np.where(np.isfinite(found), found, np.inf)

    def behind(self, t: float, g: Vector, rate: Vector, noise: Vector) -> Truth:
        """Guards that are zero to rounding, or in a mode that began some instants late, which they are about to be."""
        return np.asarray((np.abs(g) <= noise) | (-g <= rate * (LATE * as_one(self.span, t))))

    def projected(self, t: float, at: Moment) -> Vector:
        """States nearest to those given that are on the guards which the regime holds."""
        x = at.x.copy()
        for _ in range(4):
            value, slope, ways = at.regime.active_set.kept(t, x, at.z, self.problem.u, self.problem.p, at.m)
            slope, ways = slope.reshape(len(value), -1), ways.reshape(len(x), -1)
            x = x - ways @ np.linalg.lstsq(slope @ ways, value, rcond=None)[0]
        return x

    @cached_property
    def _nominal(self) -> Vector:
        """Of states and algebraic variables."""
        return np.concatenate([self.problem.compiled.nominal_x, self.problem.compiled.nominal_z])

    @cached_property
    def _shared(self) -> bool:
        """Whether statics may leave loads open."""
        return functions_of(self.problem.compiled).shares is not None

    def along(self, times: Vector, x: Vector, z: Vector, m: Vector, regime: Regime) -> Vector:
        """Guards at n instants, shape (n, guards)."""
        found = regime.active_set.guards.many(times[:, None], x.T, z.T, self.problem.u, self.problem.p, m)
        return np.minimum(found, FAR, out=found)

    def fired(self, t: float, at: Moment) -> Truth:
        """Guards that end the regime at this event: all that are reached and falling; at least the nearest."""
        found, ahead = self._reached(t, at)
        if not found.any():
            found[int(np.argmin(np.abs(ahead)))] = True
        return found

    def exact(self, t: float, at: Moment) -> Truth:
        """Guards that are reached here to rounding of the instant, by relations that hold, or do not, at equal sides.

        At an instant that something else has set, such a relation is another one with that, not after it: `x >= 1`
        holds at the tick at which x is one, and `x > 1` begins behind it (Modelica 3.6, section 8.5).
        """
        g = self.distances(t, at)
        if (g > 1.0).all():  # far from everything: no rates needed
            return np.zeros(len(g), dtype=bool)
        rate, noise = self.rates(t, at, distances=g)
        own, free = at.regime.active_set.owner, at.regime.active_set.side < 0
        ties = self.ties[own]
        differs = (ties >= 0) & (at.m[self.first + own] != ties)
        return np.asarray(free & differs & (np.abs(g) <= np.abs(rate) * as_one(self.span, t)) & (rate < -noise))

    def ahead(self, t: float, at: Moment) -> float:
        """How long it takes until the nearest guard is passed at its rate [s]; 0 where one is, or where none falls."""
        found, ahead = self._reached(t, at)
        return 0.0 if found.any() else max(float(ahead[int(np.argmin(np.abs(ahead)))]), 0.0)

    def _reached(self, t: float, at: Moment) -> tuple[Truth, Vector]:
        """Guards that are reached and falling; and how far away all of them are [s], below zero where they rise."""
        g, rate, noise = self.state(t, at)
        near = np.abs(g) <= np.maximum(LOCATED * noise, np.abs(rate) * as_one(self.span, t))
        ahead = np.abs(g) / np.where(np.abs(rate) > _SLOWEST, -rate, -_SLOWEST)
        return np.asarray((g < 0) | (near & (rate < 0))), ahead


def _finite(noise: Vector) -> Vector:
    """What is not known of a guard is nothing."""
    return noise if np.isfinite(noise).all() else np.nan_to_num(noise, nan=1e-15, posinf=1e-15)


def resting_band(g: Vector, rate: Vector, noise: Vector) -> Vector:
    """How far past its guard one may go that rests there: the noise; 0 for all others.

    One that was kept in its mode for a moment more falls on: it goes no farther than is needed to see that.
    """
    width = np.where(rate < -noise, 2 * LOCATED * noise, 2 * noise)
    return np.where((g <= LOCATED * noise) & (rate <= noise), width, 0.0)
