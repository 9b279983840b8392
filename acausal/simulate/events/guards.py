"""Guards of a regime: their distances from zero, rates, and error bounds (noise)."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from acausal.simulate.record.algebraic import corrected
from acausal.simulate.solvers.segment import Tolerances

# Instants coincide if they are closer than this fraction of the run, or of the time: a hundred rounding errors of it.
INSTANT, _TIME_ROUNDING = 1e-12, 2e-14
# How late a mode may begin, in multiples of that; its guards are then below zero by more than their noise.
LATE = 100
# The noise of guards that depend on no error. It is no lower limit for others, which may be measured in picocoulombs.
LEAST = 1e-15
# The relative rounding errors of loads.
_LOAD_ROUNDING = 1e-13
# States are moved by different fractions of their errors, multiples of the golden ratio.
_GOLDEN = 0.618
# Guards count as zero within this fraction of their noise.
STILL = 1e-2
# Guards are located to this fraction of their noise, or to their rounding errors, what up to eight rounding errors of
# time and states make of them. The error of the states moves both ends of an excursion; that of location its length.
LOCATED, _ROUNDINGS = 1e-6, np.finfo(float).eps * np.array([-8, -5, -2, 2, 5, 8])
# By how much more two of them may differ: rounding errors are estimated from these few points.
_MARGIN = 4.0
# States are moved by a few multiples of this fraction of their errors: a current through 1e-5 Ohm moves in small steps.
_SHIFT, _SHIFTS = 1e-4, 4
# Where the noise beside a point is less than this fraction of that at the point, a guard is steep for a moment only.
_STEADY = 0.1
# The slowest rate that is assumed to predict when a guard is reached.
_SLOWEST = 1e-30
# The largest distance on either side, so that differences of guards are finite where a limit is infinite.
FAR = 1e100


def same_instant(span: float, t: Any) -> Any:
    """Instants at times `t` [s], a number or an array, coincide if closer than this in a run of length `span` [s]."""
    return np.maximum(INSTANT * span, _TIME_ROUNDING * np.abs(t))


@dataclass(frozen=True, eq=False)
class Moment:
    """States, algebraic variables and modes at one instant, and the regime they belong to."""

    x: Vector
    z: Vector
    m: Vector
    regime: Regime


@dataclass(frozen=True)
class Cause:
    """The cause of an event: its text, and where it is in the source."""

    text: str
    where: Span | None = None
    component: str = ""


class Guards:
    """Evaluates the guards of one problem, for the regime of a moment."""

    def __init__(self, problem: Problem, tolerances: Tolerances, span: float) -> None:
        self.problem = problem
        self.tolerances = tolerances
        self.span = span
        self.step = 0.0
        """Mean step of the solver over which errors relax [s]; 0 if it is not known."""
        self._last: tuple[float, Moment, float, tuple[Vector, Vector, Vector]] | None = None
        compiled = problem.compiled
        self.first = compiled.n_modes - len(compiled.state_events.relations)

    @cached_property
    def timed(self) -> Truth:
        """See `EventFunctions.timed`."""
        return np.array(self.problem.compiled.events.timed, dtype=bool)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The text of each relation."""
        return self.problem.compiled.events.texts

    @cached_property
    def rests(self) -> Truth:
        """Whether the sides of each relation may be equal for a while."""
        events = self.problem.compiled.state_events
        return np.isin(np.arange(len(events.relations)), list(events.resting))

    @cached_property
    def ties(self) -> NDArray[np.int64]:
        """See `EventFunctions.ties`."""
        return np.array(self.problem.compiled.events.ties, dtype=np.int64)

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """Each relation as a cause, with the first statement that contains it; without text if it is no event."""
        places, watched = self.problem.compiled.events.places, self.problem.compiled.state_events.watched
        shown = ("" if k in watched else text for k, text in enumerate(self.texts))
        return tuple(Cause(text, *place) for text, place in zip(shown, places, strict=True))

    def distances(self, t: float, at: Moment) -> Vector:
        """The guards, which are positive while the regime lasts; shape (guards,)."""
        found = at.regime.active_set.guards(t, at.x, at.z, self.problem.u, self.problem.p, at.m)[0]
        return np.clip(found, -FAR, FAR)

    def state(self, t: float, at: Moment) -> tuple[Vector, Vector, Vector]:
        """Distances at the end of a step, their rates, and their noise; shapes (guards,).

        The last values are kept, because those at the start of a stretch are needed for its bands and by the search.
        """
        known = self._last
        if known is None or known[0] != t or known[1] is not at or known[2] != self.step:
            distances = self.distances(t, at)
            known = self._last = t, at, self.step, (distances, *self.rates(t, at, distances=distances))
        return known[3]

    def rates(
        self, t: float, at: Moment, *, between: bool = False, distances: Vector | None = None
    ) -> tuple[Vector, Vector]:
        """Time derivatives of the guards along the solution, and the noise of the distances; shapes (guards,).

        `between`: Whether the point is within a step, so that its errors have not relaxed.
        `distances`: Those at this point, if they are known.
        """
        errors = self._errors(at)
        rates, noise = self._rates(t, at.x, at, errors)
        if self.step > 0.0 and not between:
            near = noise > np.abs(self.distances(t, at) if distances is None else distances)
            if near.any():
                noise[near] = np.minimum(noise[near], self._relaxed(t, at, errors[0], np.flatnonzero(near)))
        noise += np.abs(rates) * same_instant(self.span, t)  # instants are located only up to rounding errors
        noise[noise == 0.0] = LEAST
        return rates, _finite(noise + self._load_noise(at))

    def _rates(self, t: float, x: Vector, at: Moment, errors: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        """Rates of the guards at some states, and what these errors make of the distances."""
        p = self.problem
        rates, noise, by_z, alg, alg_z = at.regime.active_set.rates(t, x, at.z, p.u, p.p, at.m, *errors)
        if len(at.z):
            z_rates = np.linalg.lstsq(alg_z.reshape(len(at.z), -1), alg.ravel(), rcond=None)[0]
            rates = rates - by_z.reshape(len(rates), -1) @ z_rates
        return rates, noise

    def _load_noise(self, at: Moment) -> float:
        """An element at its limit beside others that are stuck is at its guard up to rounding errors of loads."""
        return _LOAD_ROUNDING * (1.0 + float(np.abs(at.z).max())) if self._has_shared_loads else 0.0

    def _errors(self, at: Moment) -> tuple[Vector, Vector]:
        """Errors of states and algebraic variables: ten tolerances."""
        x_and_z = 10 * self.tolerances.of(np.concatenate([at.x, at.z]), self._nominal)
        return x_and_z[: len(at.x)], x_and_z[len(at.x) :]

    def resting_band(self, t: float, at: Moment) -> Vector:
        """How far below zero guards at rest may be: by their noise; 0 for all others. Shape (guards,).

        A guard that still falls after its mode was kept for a moment gets just enough for that to be seen.
        """
        g, rate, noise = self.state(t, at)
        band = self._band(t, at, g, rate, noise)
        return self._band(t, at, g, rate, self.steady(t, at, noise)) if band.any() else band

    def _band(self, t: float, at: Moment, g: Vector, rate: Vector, noise: Vector) -> Vector:
        is_near = (g <= STILL * noise) & (rate <= noise)
        if is_near.any():
            is_near &= self.are_reached(t, at, g, rate, noise)
        return np.where(is_near, np.where(rate < -noise, 2 * STILL * noise, 2 * noise), 0.0)

    def are_reached(self, t: float, at: Moment, g: Vector, rate: Vector, noise: Vector) -> Truth:
        """Guards of these distances that may be zero now, within a hundredth of their noise; shape (guards,).

        Not those which certainly follow one that is passed now: both sides of `(x > c - w) & (x < c + w)` are as
        uncertain as x, but where one is passed, x is known, and the other is reached after 2 w.
        """
        reached: Truth = g <= STILL * noise
        unclear = reached & (g > LOCATED * noise) & (rate < -noise)
        if len(g) == 1 or not unclear.any():
            return reached
        located = self.located(t, at, noise)
        unclear &= g > located
        passed = np.flatnonzero((np.abs(g) <= located) & (np.abs(rate) > noise))
        if unclear.any() and len(passed):
            apart = _MARGIN * located + self._apart(t, at, g, rate, passed, located)
            reached[unclear] &= g[unclear] <= apart[unclear]
        return reached

    def _apart(
        self, t: float, at: Moment, g: Vector, rate: Vector, passed: NDArray[np.intp], located: Vector
    ) -> Vector:
        """How far guards may be from zero at the instant of the one among `passed` that determines them best.

        A hundredth of their noise if that one is zero, and as much as the time to its zero means for them.
        """
        signs = np.array([np.ones(len(at.x)), self._signs(at)])
        shifts = (_SHIFT * np.arange(1, _SHIFTS + 1)[:, None, None] * signs).reshape(-1, len(at.x)) * self._errors(at)[
            0
        ]
        try:
            moved = self._beside(np.full(len(shifts), t), at.x + shifts, at) - g
        except RuntimeError:
            return np.full(len(g), np.inf)
        since = moved[:, passed] / rate[passed]  # how much earlier these are passed
        found = np.abs(moved[:, None] - since[:, :, None] * rate).max(axis=0)
        off = ((np.abs(g) + _MARGIN * located)[passed] / np.abs(rate[passed]))[:, None] * np.abs(rate)
        return np.asarray((found * (STILL / _SHIFT) + off).min(axis=0))

    def _signs(self, at: Moment) -> Vector:
        """Some up and some down: voltages that all change by the same factor remain as different as they were."""
        return np.where(np.arange(len(at.x)) * _GOLDEN % 1.0 < 0.5, 1.0, -1.0)

    def located(self, t: float, at: Moment, noise: Vector) -> Vector:
        """How close to zero guards of this noise can be located; shape (guards,).

        As far as rounding errors permit; not if the algebraic variables cannot be solved for.
        """
        try:
            found = self._beside(t * (1.0 - _ROUNDINGS), at.x * (1.0 + _ROUNDINGS[:, None] * self._signs(at)), at)
        except RuntimeError:
            return STILL * noise
        return np.asarray(np.minimum(np.fmax(LOCATED * noise, np.ptp(found, axis=0)), STILL * noise))

    def solved(self, t: float, at: Moment) -> Moment:
        """The same with algebraic variables that satisfy their equations; RuntimeError if Newton's method fails."""
        return replace(at, z=self._solved(np.array([t]), at.x[None], at)[:, 0]) if len(at.z) else at

    def _solved(self, times: Vector, x: Vector, at: Moment) -> Vector:
        """Algebraic variables at n points, shape (nz, n), from those of a moment; `x` has shape (n, nx)."""
        p, z = at.regime.problem, np.tile(at.z[:, None], (1, len(times)))
        return corrected(p.compiled, times, x.T, z, p.u, p.p, at.m, self.tolerances)

    def _beside(self, times: Vector, x: Vector, at: Moment) -> Vector:
        """Distances at n points beside a moment, shape (n, guards); RuntimeError as for `solved`."""
        return self.along(times, x.T, self._solved(times, x, at), at.m, at.regime)

    def steady(self, t: float, at: Moment, noise: Vector) -> Vector:
        """The noise of guards, where it is as large beside this point, within the errors of states; shape (guards,).

        Where a slope is steep for a moment (`1/(x + 1e-12)` at zero), noise by this slope exceeds all values that the
        guard will ever have: a guard is at rest only if its value is small beside this point, too.
        """
        errors, found = self._errors(at), np.full(len(at.regime.active_set.owners), -np.inf)
        shift = errors[0] * (1.0 - 0.5 * (np.arange(len(at.x)) * _GOLDEN % 1.0))  # no two states by the same fraction
        for x in (at.x + shift, at.x - shift):
            rates, beside = self._rates(t, x, at, errors)
            beside = beside + np.abs(rates) * same_instant(self.span, t)
            found = np.fmax(found, np.where(np.isfinite(beside), beside, -np.inf))
        known: Truth = np.isfinite(found)
        return np.where(known, np.minimum(noise, np.maximum(found + self._load_noise(at), LEAST)), noise)

    def are_steep(self, t: float, at: Moment, g: Vector, noise: Vector) -> Truth:
        """Guards that are steep for a moment only, and away from zero by what they are known to beside this point.

        Where a step of width 1e-9 is in its middle, its slope takes it far beyond its height, within errors of states.
        """
        free, steady = at.regime.active_set.side < 0, self.steady(t, at, noise)
        return np.asarray(free & (steady < _STEADY * noise) & (np.abs(g) > STILL * steady))

    def _relaxed(self, t: float, at: Moment, error: Vector, near: NDArray[np.intp]) -> Vector:
        """The noise of these guards after errors of the states have relaxed over a step (`ActiveSet.relaxed`).

        Errors of states that follow others immediately are not independent. If they were taken as such, the current
        through 1e-5 Ohm would have an error of several amperes at a tolerance of 1e-4, and a diode would conduct as
        much backwards. The solver leaves of these errors what an implicit step of its length does.
        """
        p = self.problem
        given = t, at.x, at.z, p.u, p.p, at.m, error, self.step
        found = at.regime.relaxed(*given, near=near)
        return np.where(np.isfinite(found), found, np.inf)

    def are_at_zero(self, t: float, g: Vector, rate: Vector, noise: Vector) -> Truth:
        """Guards that are zero within their noise, or will be soon, because their mode began up to `LATE` late."""
        return np.asarray((np.abs(g) <= noise) | (-g <= rate * (LATE * same_instant(self.span, t))))

    def projected(self, t: float, at: Moment) -> Vector:
        """The nearest states that are on the guards which the regime holds."""
        x = at.x.copy()
        for _ in range(4):
            value, slope, directions = at.regime.active_set.kept(t, x, at.z, self.problem.u, self.problem.p, at.m)
            slope, directions = slope.reshape(len(value), -1), directions.reshape(len(x), -1)
            x = x - directions @ np.linalg.lstsq(slope @ directions, value, rcond=None)[0]
        return x

    @cached_property
    def _nominal(self) -> Vector:
        """Nominal values of states and algebraic variables."""
        return np.concatenate([self.problem.compiled.nominal_x, self.problem.compiled.nominal_z])

    @cached_property
    def _has_shared_loads(self) -> bool:
        """Whether loads may be statically indeterminate."""
        return functions_of(self.problem.compiled).shares is not None

    def along(self, times: Vector, x: Vector, z: Vector, m: Vector, regime: Regime) -> Vector:
        """Guards at n instants, shape (n, guards)."""
        found = regime.active_set.guards.many(times[:, None], x.T, z.T, self.problem.u, self.problem.p, m)
        return np.clip(found, -FAR, FAR, out=found)

    def fired(self, t: float, at: Moment) -> Truth:
        """Guards that end the regime at this event: all that are reached and falling, or else the nearest one."""
        found, ahead = self._reached(t, at)
        if found.sum() > 1:  # beside the one that was located
            g, _, noise = self.state(t, at)
            found &= (g < 0.0) | ~self.are_steep(t, at, g, noise)
        if not found.any():
            found[int(np.argmin(np.abs(ahead)))] = True
        return found

    def exact(self, t: float, at: Moment) -> Truth:
        """Guards that are reached at this instant by relations whose value at equal sides differs from their mode.

        At an instant that is determined by something else, such a relation changes with the event and not after it:
        `x >= 1` holds at the tick at which x is one, and `x > 1` begins to hold after it (Modelica 3.6, section 8.5).
        """
        g = self.distances(t, at)
        if (g > 1.0).all():  # far from everything: no rates needed
            return np.zeros(len(g), dtype=bool)
        rate, noise = self.rates(t, at, distances=g)
        own, free = at.regime.active_set.owner, at.regime.active_set.side < 0
        ties = self.ties[own]
        differs = (ties >= 0) & (at.m[self.first + own] != ties)
        return np.asarray(free & differs & (np.abs(g) <= np.abs(rate) * same_instant(self.span, t)) & (rate < -noise))

    def ahead(self, t: float, at: Moment) -> float:
        """The time until the nearest guard is passed at its rate [s]; 0 if one is passed already, or if none falls."""
        found, ahead = self._reached(t, at)
        return 0.0 if found.any() else max(float(ahead[int(np.argmin(np.abs(ahead)))]), 0.0)

    def _reached(self, t: float, at: Moment) -> tuple[Truth, Vector]:
        """Guards that are reached and falling, and the time to each at its rate [s], negative if it rises."""
        g, rate, noise = self.state(t, at)
        is_near = self.are_reached(t, at, g, rate, noise) | (np.abs(g) <= np.abs(rate) * same_instant(self.span, t))
        ahead = np.abs(g) / np.where(np.abs(rate) > _SLOWEST, -rate, -_SLOWEST)
        return np.asarray((g < 0) | (is_near & (rate < 0))), ahead


def _finite(noise: Vector) -> Vector:
    """Noise that is not finite counts as almost none; it is at most the largest distance, as distances are."""
    return np.where(np.isfinite(noise), np.minimum(noise, FAR), LEAST)
