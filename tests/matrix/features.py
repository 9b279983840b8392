"""Every feature of the language with a small model of it and its solution, stated independently of the compiler."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

from acausal import Component
from tests.accuracy.drilling_reference import PlainDrilling
from tests.matrix import models
from tests.random.switched_circuits import Branch, Circuit, Solver

Array = NDArray[np.float64]
Values = dict[str, Array]


@dataclass(frozen=True)
class Feature:
    """A model of one feature and what it must do.

    Attributes
    ----------
    exact
        `(times, value)`: the watched variables at these times, `value` being that of `parameter`.
    source
        Where the solution comes from.
    tolerance
        Largest error over the range of a variable, for runs at a tolerance of 1e-8.
    jumps
        `(value)`: instants at which a watched variable jumps; rows just there are not compared.
    instants
        Instants of the located events within the run, where they are listed one by one.
    acts
        Whether there are `when`s, samples or discrete equations: functions of states alone cannot stand for it.
    poles
        Eigenvalues of the linearised model at the start, where they have a closed form. [1/s]
    refused
        Code with which every run has to end, and the time at which.
    other_start
        Whether it is a feature before, from another start: what runs it again has nothing new to find.
    """

    name: str
    make: Callable[[], Component]
    stop: float
    exact: Callable[[Array, float], Values]
    source: str
    parameter: str = ""
    value: float = math.nan
    tolerance: float = 1e-5
    fixed_step: float = 1e-2
    jumps: Callable[[float], tuple[float, ...]] = lambda value: ()
    instants: tuple[float, ...] | None = None
    acts: bool = False
    poles: tuple[complex, ...] | None = None
    inputs: Mapping[str, float] = field(default_factory=dict)
    refused: tuple[str, float] | None = None
    cost: float = 1.0
    other_start: bool = False


def smooth(t: Array, k: float) -> Values:
    w = math.sqrt(k)
    return {"x": np.cos(w * t), "v": -w * np.sin(w * t)}


def algebraic(t: Array, a: float) -> Values:
    """z' (1 + 0.3 z^2) = -a z: ln z + 0.15 z^2 = c - a t."""
    c = math.log(1.2) + 0.15 * 1.44
    z = np.array([brentq(lambda q, s=s: q + 0.15 * math.exp(2 * q) - c + a * s, -50.0, 1.0, xtol=1e-14) for s in t])
    z = np.exp(z)
    return {"z": z, "x": z + 0.1 * z**3}


def pendulum(t: Array, g: float) -> Values:
    """sin(theta/2) = k cd(w t, k), k = sin(theta0/2): Byrd & Friedman, Handbook of Elliptic Integrals (1971)."""
    k, w = math.sin(0.5), math.sqrt(g)
    sn = ellipj(w * t + ellipk(k * k), k * k)[0]
    theta = 2 * np.arcsin(k * sn)
    return {"x": np.sin(theta), "y": -np.cos(theta)}


def bar_links(phi: complex) -> list[tuple[complex, complex, complex, complex]]:
    """Ends `(x, y, x, y)` of crank, coupler and rocker: two circles that intersect; analytic, for complex steps."""
    a, b, c, d = models.CRANK, models.COUPLER, models.ROCKER, models.GROUND
    px, py = a * np.cos(phi), a * np.sin(phi)
    dx, dy = d - px, -py
    r2 = dx * dx + dy * dy
    along = (b * b - c * c + r2) / (2 * r2)
    height = np.sqrt(b * b / r2 - along * along)
    qx, qy = px + along * dx - height * dy, py + along * dy + height * dx
    return [(0j, 0j, px, py), (px, py, qx, qy), (complex(d), 0j, qx, qy)]


def bar_inertia(phi: float) -> float:
    """M of the kinetic energy M(phi) phi'^2 / 2: velocities of the ends for phi' = 1, by a complex step."""
    total = 0.0
    for (m, inertia), (x0, y0, x1, y1) in zip(models.MASSES.values(), bar_links(phi + 1e-30j), strict=True):
        vx0, vy0, vx1, vy1 = (v.imag / 1e-30 for v in (x0, y0, x1, y1))
        rx, ry = (x1 - x0).real, (y1 - y0).real
        rate = (rx * (vy1 - vy0) - ry * (vx1 - vx0)) / (rx**2 + ry**2)
        total += m * ((vx0 + vx1) ** 2 + (vy0 + vy1) ** 2) / 4 + inertia * rate**2
    return float(total)


def four_bar(phi0: float) -> Callable[[Array, float], Values]:
    """Without gravity the kinetic energy M(phi) phi'^2 / 2 stays: one equation of first order, by DOP853."""

    def exact(t: Array, w0: float) -> Values:
        energy = bar_inertia(phi0) * w0 * w0
        found = solve_ivp(
            lambda s, phi: [math.sqrt(energy / bar_inertia(float(phi[0])))],
            (0.0, float(t[-1])),
            [phi0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-12,
            dense_output=True,
        )
        phi = found.sol(t)[0]
        return {"j1.phi": phi, "j1.w": np.array([math.sqrt(energy / bar_inertia(float(f))) for f in phi])}

    return exact


def four_bar_model(phi0: float) -> Callable[[], Component]:
    def make() -> Component:
        px, py, qx, qy = bar_links(complex(phi0))[1]
        coupler = math.atan2((qy - py).real, (qx - px).real) - phi0
        rocker = math.atan2(qy.real, (qx - models.GROUND).real)
        return models.FourBar(phi0=phi0, coupler0=coupler, rocker0=rocker)

    return make


def pulse(t: Array, a: float) -> Values:
    rise = a * (1 - np.exp(-(np.clip(t, 0.3, 0.32) - 0.3)))
    return {"x": 0.5 * np.exp(-t) + rise * np.exp(-np.maximum(t - 0.32, 0.0))}


def crossing(t: Array, c: float) -> Values:
    x = 0.7 - c * t
    at = 0.7 / c
    return {
        "x": x,
        "y": 400.0 * (np.clip(t, at - 1e-3 / c, at + 1e-3 / c) - (at - 1e-3 / c)),
        "z": np.minimum(t, at),
    }


def chained(t: Array, r: float) -> Values:
    after = t > 0.2 / r
    return {
        "x": np.where(after, 3.0 + r * t - 0.2, r * t),
        "n": np.where(after, 22.0, 0.0),
        "e": np.where(after, 2.0, 0.0),
        "m": np.where(after, 1.0, 0.0),
    }


def sampled(t: Array, gain: float) -> Values:
    """x goes straight between samples and is multiplied by 1 - gain/10 in each, from the second on."""
    k = np.floor(t * 10 + 1e-9)
    at = np.where(k < 1, 1.0, (1 - 0.1 * gain) ** (k - 1))
    u = np.where(k < 1, 0.0, -gain * at)
    return {"x": at + u * (t - k / 10), "u": u}


def thermostat_switches(power: float) -> tuple[float, ...]:
    """Up towards 10 + 5 power, down towards 10, between 19 and 21."""
    top = 10 + 5 * power
    up = 5 * math.log((top - 19) / (top - 21))
    down = 5 * math.log(11 / 9)
    times = [5 * math.log((top - 20) / (top - 21))]
    for k in range(12):
        times.append(times[-1] + (down if k % 2 == 0 else up))
    return tuple(times)


def thermostat(t: Array, power: float) -> Values:
    switches = thermostat_switches(power)
    k = np.searchsorted(switches, t, side="right")
    began = np.array([0.0, *switches])[k]
    first = np.where(k == 0, 20.0, np.where(k % 2 == 1, 21.0, 19.0))
    to = np.where(k % 2 == 0, 10 + 5 * power, 10.0)
    return {"T": to + (first - to) * np.exp(-(t - began) / 5), "heating": (k % 2 == 0).astype(float)}


def delayed(t: Array, r: float) -> Values:
    """The method of steps: r (t - (t - T)^2/2 + (t - 2T)^3/6 - ...)."""
    x = np.zeros_like(t)
    for k in range(20):
        s = np.maximum(t - 0.4 * k, 0.0)
        x += r * (-1) ** k * s ** (k + 1) / math.factorial(k + 1)
    return {"x": x}


def ball(t: Array, e: float) -> Values:
    """Flights of 2 v/g, each e times the one before, up to sqrt(2 h/g) (1 + e)/(1 - e)."""
    g = 9.81
    h, v = np.zeros_like(t), np.zeros_like(t)
    fall = math.sqrt(2 / g)
    h, v = np.where(t <= fall, 1 - g * t**2 / 2, 0.0), np.where(t <= fall, -g * t, 0.0)
    began, speed = fall, g * fall * e
    while speed > 1e-12:
        s = t - began
        inside = (s > 0) & (s <= 2 * speed / g)
        h, v = np.where(inside, speed * s - g * s**2 / 2, h), np.where(inside, speed - g * s, v)
        began, speed = began + 2 * speed / g, speed * e
    return {"h": h, "v": v}


def bounces(e: float) -> tuple[float, ...]:
    fall = math.sqrt(2 / 9.81)
    return tuple(fall * (1 + 2 * e * (1 - e**k) / (1 - e)) for k in range(60))


def sliding(t: Array, u: float) -> Values:
    """x rises at 1 + u until it is 0, and stays."""
    s = np.minimum(t, 0.65 / (1 + u))
    return {"x": -0.65 + (1 + u) * s, "y": -0.65 * s + (1 + u) * s**2 / 2}


def stopped(t: Array, v0: float) -> Values:
    s = np.minimum(t, v0 / 2.5)
    return {"mass.s": v0 * s - 2.5 * s**2 / 2, "mass.v": v0 - 2.5 * s}


@cache
def _rectifier() -> Solver:
    branches = (
        Branch("V", 1, 0, (10.0, 50.0, 0.3)),
        Branch("diode", 1, 2, (0.1, 1e-5)),
        Branch("R", 2, 0, (100.0,)),
        Branch("C", 2, 0, (1e-4, 0.0)),
    )
    return Solver(Circuit(3, branches, 0.05))


def rectifier(t: Array, value: float) -> Values:
    found = _rectifier().solve(t)
    return {"store.v": found.states[:, 0], "diode.v": found.voltages[:, 0]}


def bouncing(t: Array, value: float) -> Values:
    """Free fall, then half a swing on the spring about m g/k, mirrored: period after period."""
    g, k, m, drop = 9.81, 1e4, 1.0, 0.02
    fall, w = math.sqrt(2 * drop / g), math.sqrt(k / m)
    v = g * fall
    # in contact: s'' = -g - k/m s, s(0) = 0, s'(0) = -v
    below = g / w**2
    contact = 2 * (math.pi - math.atan2(v / w, below)) / w
    s = np.mod(t + fall, 2 * fall + contact)
    inside = s - 2 * fall
    flight = drop - g * (s - fall) ** 2 / 2
    pressed = -below + below * np.cos(w * inside) - v / w * np.sin(w * inside)
    height = np.where(inside < 0, flight, pressed)
    return {"body.r_0[2]": 0.1 + height}


def drilling(t: Array, v: float) -> Values:
    """Diameters of the cone's engaged part; the cutting law with a constant feed per edge (docs/drilling.md)."""
    plain = PlainDrilling((), (), t=1e-3, factor=1.0)
    slope = 2 * math.tan(plain.sigma / 2)
    feed = v / 9.28 / plain.z_E
    outer, inner = np.minimum(slope * v * t, 0.016), np.clip(slope * (v * t - 1e-3), 0.0, 0.016)
    h = feed * math.sin(plain.sigma / 2)
    k_c = plain.k_c11 * (h / 1e-3) ** -plain.z
    return {"drill.d_O": outer, "drill.d_I": inner, "drill.F_c": plain.z_E * (outer - inner) / 2 * feed * k_c}


def called(t: Array, k: float) -> Values:
    return {"x": 1 / (1 + k * t)}


@cache
def _ladder() -> tuple[Array, Array]:
    a = np.diag(np.full(150, -2.0)) + np.diag(np.ones(149), 1) + np.diag(np.ones(149), -1)
    a[-1, -1] = -1.0
    values, vectors = np.linalg.eigh(a)
    return values, vectors


def ladder(t: Array, value: float) -> Values:
    """v' = A v + b with b = e_1, by the eigenvectors of A; all at 1 V in the end."""
    values, vectors = _ladder()
    v = 1.0 + vectors @ (np.exp(np.outer(values, t)) * (vectors.T @ np.full(150, -1.0))[:, None])
    return {"capacitors[0].v": v[0], "capacitors[2].v": v[2]}


def tables(t: Array, k: float) -> Values:
    """The square of a straight line, integrated piece by piece (Simpson's rule is exact)."""
    rows = [np.array(table) for table in (models.TABLE_A, models.TABLE_B)]
    knots = np.unique(np.concatenate([rows[0][:, 0], rows[1][:, 0], t]))

    def f(s: Array) -> Array:
        total = sum(np.interp(s, table[:, 0], table[:, 1]) for table in rows)
        return np.asarray(total**2)

    a, b = knots[:-1], knots[1:]
    pieces = (b - a) / 6 * (f(a) + 4 * f((a + b) / 2) + f(b))
    total = np.concatenate([[0.0], np.cumsum(pieces)])
    return {"x": k * total[np.searchsorted(knots, t)]}


def driven(t: Array, k: float) -> Values:
    return {"x": 2.0 * (1 - np.exp(-k * t))}


def straight(t: Array, r: float) -> Values:
    return {"x": r * t}


FEATURES: tuple[Feature, ...] = (
    Feature("smooth", models.Smooth, 3.0, smooth, "closed form", "k", 4.0, poles=(2j, -2j)),
    Feature("dae", models.Algebraic, 2.0, algebraic, "separation of variables", "a", 1.5, poles=(-1.5 / 1.432,)),
    Feature("index 3", models.Pendulum, 3.0, pendulum, "elliptic functions", "g", 9.81),
    *(
        Feature(
            f"four-bar {phi0:g}",
            four_bar_model(phi0),
            2.0,
            four_bar(phi0),
            "energy integral",
            "w0",
            4.0,
            cost=3.0,
            other_start=phi0 != 0.25,
        )
        for phi0 in (0.25, 0.5, 1.0, 2.3)
    ),
    Feature("time event", models.Pulse, 1.0, pulse, "closed form", "a", 30.0, poles=(-1.0,)),
    Feature(
        "state event",
        models.Crossing,
        1.1,
        crossing,
        "closed form",
        "c",
        1.0,
        instants=(0.699, 0.7, 0.701),
        fixed_step=0.6,  # a step of 1.1 ms that is late is half of what y gathers in 2 ms
    ),
    Feature(
        "chained whens",
        models.Chained,
        0.9,
        chained,
        "Modelica 3.6, appendix B",
        "r",
        1.0,
        jumps=lambda r: (0.2 / r,),
        instants=(0.2,),
        acts=True,
    ),
    Feature(
        "sample",
        models.Sampled,
        0.95,
        sampled,
        "closed form",
        "gain",
        2.0,
        jumps=lambda gain: tuple(k / 10 for k in range(1, 10)),
        acts=True,
    ),
    Feature(
        "discrete",
        models.Thermostat,
        4.0,
        thermostat,
        "closed form",
        "power",
        4.0,
        jumps=thermostat_switches,
        instants=thermostat_switches(4.0)[:4],
        acts=True,
    ),
    Feature("delay", models.Delayed, 2.0, delayed, "method of steps", "r", 1.0),
    Feature("bouncing to rest", models.Ball, 2.5, ball, "closed form", "e", 0.6, 1e-4, jumps=bounces, acts=True),
    Feature("sliding", models.Sliding, 1.0, sliding, "Filippov", "u", 0.3),
    Feature("friction", models.Stopped, 1.5, stopped, "closed form", "v0", 3.0, acts=True),
    Feature(
        "ideal diode",
        models.Rectifier,
        0.05,
        rectifier,
        "exponentials between events",
        jumps=lambda value: tuple(_rectifier().solve(np.array([0.0])).events),
        acts=True,
    ),
    Feature("contact scene", models.Bouncing, 0.2, bouncing, "half swings", tolerance=1e-4, cost=2.0),
    Feature("drilling", models.Drilling, 4.0, drilling, "the paper's equations", "v", 1.672e-3, cost=2.0),
    Feature("external", models.Called, 2.0, called, "closed form", "k", 1.0, poles=(-2.0,)),
    Feature("150 components", models.Ladder, 2.0, ladder, "eigenvectors", cost=2.0),
    Feature("long tables", models.Tables, 1.0, tables, "Simpson's rule on pieces", "k", 1.0, cost=3.0),
    Feature("inputs", models.Driven, 2.0, driven, "closed form", "k", 1.5, inputs={"u": 2.0}, poles=(-1.5,)),
    Feature("assertion holds", models.Watched, 1.0, straight, "closed form", "r", 1.0, poles=(0.0,)),
    Feature("assertion broken", models.Watched, 3.0, straight, "closed form", "r", 1.0, refused=("AC503", 2.0)),
)
BY_NAME = {feature.name: feature for feature in FEATURES}
