"""Random networks with more friction elements than degrees of freedom, and a plain simulator of them.

A network is a few groups of inertias (or masses) that gears and rigid connections make turn together, each group with
one degree of freedom, and brakes, bearings and clutches on and between them; torques and normal forces are steps and
ramps of time. With constant coefficients of friction everything is piecewise polynomial, so the simulator is exact
between its events.

At an instant accelerations are those of least constraint (Gauss): of all loads that the surfaces at rest can carry the
ones that leave the least motion, found by trying each element stuck, giving way forward and backward. They are unique,
loads are not. How long a set of surfaces holds is a linear programme: the last instant at which any loads within the
limits of all of them balance the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

Array = NDArray[np.float64]
STOP = 4.0
_SOON = 1e-6
_STILL = 1e-9


@dataclass(frozen=True)
class Body:
    """Moment of inertia [kg.m2] (or mass [kg]), the group it belongs to, and its speed by that of the first body."""

    inertia: float
    group: int
    ratio: float
    gear: bool


@dataclass(frozen=True)
class Line:
    """What is `a + b*(t - t0)` from each t0 on: rows (t0, a, b), the first at 0."""

    pieces: tuple[tuple[float, float, float], ...]

    def at(self, t: float) -> tuple[float, float]:
        """Value and slope just after t."""
        t0, a, b = next(p for p in reversed(self.pieces) if p[0] <= t + 1e-12)
        return a + b * (t - t0), b


@dataclass(frozen=True)
class Friction:
    """An element of kind "brake", "bearing" or "clutch", the bodies it acts on, its limit, and `normal` over time."""

    kind: str
    bodies: tuple[int, ...]
    limit: float
    normal: Line


@dataclass(frozen=True)
class Network:
    """Bodies, friction elements, a torque on each of some bodies, and the speeds of the groups at the start."""

    bodies: tuple[Body, ...]
    frictions: tuple[Friction, ...]
    torques: tuple[tuple[int, Line], ...]
    speeds: tuple[float, ...]
    linear: bool

    @property
    def mass(self) -> Array:
        """Of each group, at its first body."""
        found = np.zeros(len(self.speeds))
        for b in self.bodies:
            found[b.group] += b.inertia * b.ratio**2
        return found

    @property
    def ways(self) -> Array:
        """Relative speed of each element's surfaces by the speeds of the groups."""
        rows = np.zeros((len(self.frictions), len(self.speeds)))
        for row, f in zip(rows, self.frictions, strict=True):
            for sign, k in zip((1.0, -1.0), f.bodies, strict=False):
                row[self.bodies[k].group] += sign * self.bodies[k].ratio
        return rows

    def loads(self, t: float) -> tuple[Array, Array]:
        """Applied torques on the groups, and their slopes."""
        found = np.zeros((2, len(self.speeds)))
        for k, line in self.torques:
            found[:, self.bodies[k].group] += self.bodies[k].ratio * np.array(line.at(t))
        return found[0], found[1]

    def limits(self, t: float) -> tuple[Array, Array]:
        """The largest load of each element, and its slope."""
        values = np.array([f.normal.at(t) for f in self.frictions]) * np.array([[f.limit] for f in self.frictions])
        return values[:, 0], values[:, 1]

    @property
    def instants(self) -> list[float]:
        """When slopes or values of what is given jump."""
        lines = [line for _, line in self.torques] + [f.normal for f in self.frictions]
        return sorted({p[0] for line in lines for p in line.pieces if 0.0 < p[0] < STOP} | {STOP})


def random_line(rng: np.random.Generator, size: float, least: float) -> Line:
    """Steps and ramps of about this size, never below `least`."""
    times = [0.0, *sorted(np.round(rng.uniform(0.3, STOP - 0.3, rng.integers(0, 3)), 3).tolist())]
    pieces = []
    for t0, t1 in zip(times, [*times[1:], STOP], strict=True):
        a, e = (max(least + 0.01, round(float(rng.uniform(-size, size)), 3)) for _ in range(2))
        kind = rng.integers(0, 3)
        pieces.append((t0, a, 0.0) if kind == 0 else (t0, a, round((e - a) / (t1 - t0), 4)))
        if kind == 1 and least == 0.0 and rng.random() < 0.5:
            pieces[-1] = (t0, 0.0, 0.0)  # not pressed
    return Line(tuple(pieces))


def random_network(seed: int) -> Network:
    """A network with at least as many friction elements as degrees of freedom, mostly more."""
    rng = np.random.default_rng([seed, 20140])
    groups = int(rng.integers(1, 4))
    linear = bool(rng.random() < 0.25)
    bodies = []
    for g in range(groups):
        ratio = 1.0
        for k in range(int(rng.integers(1, 3))):
            gear = bool(k and rng.random() < 0.7) and not linear
            ratio *= round(float(rng.choice([-1, 1]) * rng.uniform(0.3, 3.0)), 2) if gear else 1.0
            bodies.append(Body(round(float(10 ** rng.uniform(-1, 1)), 3), g, ratio, gear))
    frictions = []
    for _ in range(int(rng.integers(groups, groups + 4))):
        kinds = ["brake", "bearing"] if linear or len(bodies) == 1 else ["brake", "bearing", "clutch", "clutch"]
        kind = str(rng.choice(kinds))
        on = tuple(int(k) for k in rng.choice(len(bodies), 2 if kind == "clutch" else 1, replace=False))
        normal = Line(((0.0, 1.0, 0.0),)) if kind == "bearing" else random_line(rng, 1.0, 0.0)
        frictions.append(Friction(kind, on, round(float(rng.uniform(0.5, 6.0)), 2), normal))
    torques = tuple(
        (k, random_line(rng, float(rng.uniform(1.0, 15.0)), -np.inf)) for k in range(len(bodies)) if rng.random() < 0.6
    )
    still = rng.random() < 0.4
    speeds = tuple(0.0 if still or rng.random() < 0.2 else round(float(rng.uniform(-8, 8)), 2) for _ in range(groups))
    return Network(tuple(bodies), tuple(frictions), torques, speeds, linear)


class Discard(Exception):
    """A network on which rounding decides."""


def accelerations(network: Network, load: Array, limit: Array, signs: Array) -> Array:
    """Of the groups; `signs` are those of the elements that slide, 0 of the others."""
    mass, ways = network.mass, network.ways
    slides = signs != 0
    free = load - ways[slides].T @ (signs * limit)[slides]
    here = np.flatnonzero(~slides)
    for choice in sorted(product((0.0, 1.0, -1.0), repeat=len(here)), key=np.count_nonzero):
        give = np.array(choice)
        stuck = here[give == 0.0]
        q = free - ways[here].T @ (give * limit[here])
        own = ways[stuck]
        carried = np.linalg.pinv(own / mass @ own.T, rcond=1e-11) @ (own / mass @ q) if len(stuck) else np.zeros(0)
        a = (q - own.T @ carried) / mass
        size = 1.0 + np.abs(q).max()
        # any loads within the limits will do: those of least squares may lie outside
        if (np.abs(carried) > limit[stuck] + 1e-12 * size).any() and not _carries(own, limit[stuck], own.T @ carried):
            continue
        if (np.abs(own @ a) < 1e-9 * size).all() and (give * (ways[here] @ a) >= -1e-12 * size).all():
            return np.asarray(a)
    raise Discard("no combination holds")


def _carries(own: Array, limit: Array, wanted: Array) -> bool:
    bounds = list(zip(-limit, limit, strict=True))
    return bool(linprog(np.zeros(len(limit)), A_eq=own.T, b_eq=wanted, bounds=bounds).status == 0)


def lasts(network: Network, t: float, signs: Array, stuck: NDArray[np.bool_], a: Array, until: float) -> float:
    """How long the elements `stuck` can carry what is to be carried."""
    ways = network.ways
    own = ways[stuck]
    if not len(own):
        return until
    load, load_rate = network.loads(t)
    limit, limit_rate = network.limits(t)
    slides = signs != 0
    q = load - ways[slides].T @ (signs * limit)[slides]
    q_rate = load_rate - ways[slides].T @ (signs * limit_rate)[slides]
    # own^T c + mass a = q + q_rate s, own a = 0, |c| <= limit + limit_rate s: the largest s
    n, k = len(q), len(own)
    mass = np.diag(network.mass)
    zero = np.zeros
    equal = np.block([[own.T, mass, -q_rate[:, None]], [zero((k, k)), own, zero((k, 1))]])
    right = np.concatenate([q, zero(k)])
    less = np.vstack([np.hstack([sign * np.eye(k), zero((k, n)), -limit_rate[stuck, None]]) for sign in (1.0, -1.0)])
    bounds = [(None, None)] * (k + n) + [(0.0, until)]
    cost = np.append(zero(k + n), -1.0)
    found = linprog(cost, A_ub=less, b_ub=np.tile(limit[stuck], 2) + 1e-13, A_eq=equal, b_eq=right, bounds=bounds)
    if found.status != 0:
        raise Discard("what is stuck does not hold")
    return float(found.x[-1])


def first_zero(v: float, a: float, b: float, until: float) -> float:
    """The first s > 0 at which v + a s + b s^2 / 2 leaves the sign it has just after 0 [s]."""
    roots = np.roots([b / 2, a, v]) if b else (np.array([-v / a]) if a else np.zeros(0))
    real = np.sort(roots[np.abs(np.imag(roots)) < 1e-12].real)
    real = real[real > (1e-9 if abs(v) < _STILL else 0.0)]
    return min(until, float(real[0])) if len(real) else until


def simulated(network: Network, times: Array) -> Array:
    """Speeds of the groups, shape (groups, n)."""
    t, speeds = 0.0, np.array(network.speeds)
    ways, mass = network.ways, network.mass
    rows = np.zeros((len(speeds), len(times)))
    instants = network.instants
    for _ in range(200):
        relative = ways @ speeds
        relative[np.abs(relative) < _STILL] = 0.0
        # just after t, so that what is on its limit shows where it goes
        (load, load_rate), (limit, limit_rate) = network.loads(t), network.limits(t)
        soon = accelerations(network, load + _SOON * load_rate, limit + _SOON * limit_rate, np.sign(relative))
        moved = np.where(relative == 0.0, ways @ soon, 0.0)
        if ((np.abs(moved) > 1e-10) & (np.abs(moved) < 1e-8)).any():
            raise Discard("gives way too slowly to tell")
        stuck = (relative == 0.0) & (np.abs(moved) <= 1e-10)
        signs = np.sign(relative) + np.where(stuck, 0.0, np.sign(moved))
        until = min(i for i in instants if i > t + 1e-12) - t
        span = lasts(network, t, signs, stuck, soon, until)

        def rates(q: Array, c: Array, signs: Array = signs, stuck: NDArray[np.bool_] = stuck) -> Array:
            slides = signs != 0
            q = q - ways[slides].T @ (signs * c)[slides]
            own = ways[stuck]
            carried = np.linalg.pinv(own / mass @ own.T, rcond=1e-11) @ (own / mass @ q)
            return np.asarray((q - own.T @ carried) / mass)

        a, b = rates(load, limit), rates(load_rate, limit_rate)
        for k in np.flatnonzero(signs):
            v = float(ways[k] @ speeds) if relative[k] else 0.0
            span = min(span, first_zero(v, float(ways[k] @ a), float(ways[k] @ b), until))
        here = (times >= t - 1e-12) & (times <= t + span + 1e-12)
        s = times[here] - t
        rows[:, here] = speeds[:, None] + np.outer(a, s) + np.outer(b, s**2 / 2)
        if span < 1e-9:
            raise Discard("two events at once")
        speeds = speeds + a * span + b * span**2 / 2
        t += span
        if t >= STOP - 1e-9:
            return rows
    raise Discard("too many events")
