"""Where the guards of a regime stand: distances, rates, and how far they can be wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from acausal.errors import Span
from acausal.simulate.direct import rows
from acausal.simulate.problem import Problem
from acausal.simulate.regime import Regime

Vector = NDArray[np.float64]
Truth = NDArray[np.bool_]
# Instants are located to this share of the run, or of the time.
_INSTANT = 1e-12
# Guards are located to this share of the noise.
LOCATED = 1e-2


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


@dataclass(frozen=True, eq=False)
class Tolerances:
    """Tolerances of the solver, relative and absolute (in nominal magnitudes)."""

    relative: float
    absolute: float


class Guards:
    """Distances of one problem; the regime says which of them count."""

    def __init__(self, problem: Problem, tolerances: Tolerances, span: float) -> None:
        self.problem = problem
        self.tolerances = tolerances
        self.span = span
        compiled = problem.compiled
        self.first = compiled.n_modes - len(compiled.state_events.relations)

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """The relations as the user reads them."""
        return self.problem.compiled.events.texts

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """The relations with the place of the first statement that holds each of them."""
        places = self.problem.compiled.events.places
        return tuple(Cause(text, *place) for text, place in zip(self.texts, places, strict=True))

    def distances(self, t: float, at: Moment) -> Vector:
        """Guards of the regime: positive while it lasts."""
        return at.regime.guards(t, at.x, at.z, self.problem.u, self.problem.p, at.m)[0]

    def rates(self, t: float, at: Moment) -> tuple[Vector, Vector]:
        """Time derivatives of the guards along the solution, and by how much the distances can be wrong."""
        problem = self.problem
        errors = self._error(at.x, self._nominal), self._error(at.z, problem.compiled.nominal_z)
        own, noise, by_z, alg, alg_z = at.regime.rates(t, at.x, at.z, problem.u, problem.p, at.m, *errors)
        if len(at.z):
            moved = np.linalg.lstsq(alg_z.reshape(len(at.z), -1), alg.ravel(), rcond=None)[0]
            own = own - by_z.reshape(len(own), -1) @ moved
        # never quite nothing: values are rounded, and instants are found to rounding only
        noise += 1e-15 + np.abs(own) * (_INSTANT * max(self.span, abs(t)))
        return own, noise if np.isfinite(noise).all() else np.nan_to_num(noise, nan=1e-15, posinf=1e-15)

    def _error(self, values: Vector, nominal: Vector) -> Vector:
        """How far values may be off."""
        return np.asarray(10 * (self.tolerances.relative * np.abs(values) + self.tolerances.absolute * nominal))

    def held(self, t: float, at: Moment) -> Vector:
        """States nearest to those given that are on the guards which the regime holds."""
        x = at.x.copy()
        for _ in range(4):
            value, slope, ways = at.regime.kept(t, x, at.z, self.problem.u, self.problem.p, at.m)
            slope, ways = slope.reshape(len(value), -1), ways.reshape(len(x), -1)
            x = x - ways @ np.linalg.lstsq(slope @ ways, value, rcond=None)[0]
        return x

    @cached_property
    def _nominal(self) -> Vector:
        return self.problem.compiled.nominal_x

    def along(self, times: Vector, x: Vector, z: Vector, m: Vector, regime: Regime) -> Vector:
        """Guards at n instants, shape (n, guards)."""
        return rows(regime.watch, (times[:, None], x.T, z.T, self.problem.u, self.problem.p, m))

    def fired(self, t: float, at: Moment) -> Truth:
        """Guards that end the regime at this event: all that are reached and falling; at least the nearest."""
        g = self.distances(t, at)
        rate, noise = self.rates(t, at)
        near = np.abs(g) <= np.maximum(LOCATED * noise, np.abs(rate) * _INSTANT * max(self.span, abs(t)))
        found = (g < 0) | (near & (rate < 0))
        if not found.any():
            found[int(np.argmin(np.abs(g) / np.maximum(np.abs(rate), 1e-30)))] = True
        return np.asarray(found)
