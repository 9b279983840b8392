"""Problems of accuracy.py in addition to the published ones: exact solutions, many states, events."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    boolean,
    connect,
    cos,
    der,
    fixed,
    parameter,
    part,
    pre,
    reset,
    sin,
    sqrt,
    time,
    variable,
    when,
    where,
)
from acausal.library import blocks, electrical, thermal
from acausal.models.ivp.answers import Problem
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.rc_ladder import RCLadder
from acausal.models.stability.switching import BangBang

Array = NDArray[np.float64]
COUNT = 60


class Kepler(Component):
    """An orbit of eccentricity `e` and period 2 pi; after whole periods it returns to its start."""

    e: Real = parameter(default=0.5)
    x: Real = variable()
    y: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(0.0))
    v: Real = variable()

    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0 * math.pi)

    def equations(self) -> Equations:
        cubed = sqrt(self.x**2 + self.y**2) ** 3
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == -self.x / cubed
        yield der(self.v) == -self.y / cubed

    def initial_equations(self) -> Equations:
        yield self.x == 1.0 - self.e
        yield self.v == sqrt((1.0 + self.e) / (1.0 - self.e))


class Oscillation(Component):
    """x'' = -x: a hundred periods."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=200.0 * math.pi)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x


class ProtheroRobinson(Component):
    """Stiff, with a known smooth solution sin t. A. Prothero, A. Robinson, Math. Comp. 28 (1974)."""

    rate: Real = parameter(default=1e6)
    y: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0)

    def equations(self) -> Equations:
        yield der(self.y) == -self.rate * (self.y - sin(time)) + cos(time)


class SineGordon(Component):
    """A line of 60 coupled pendulums, 120 states that are not stiff and never come to rest."""

    x: Real = variable(
        default=fixed(tuple(2.0 * math.exp(-(((k - 20) / 6.0) ** 2)) for k in range(COUNT))), shape=COUNT
    )
    v: Real = variable(default=fixed((0.0,) * COUNT), shape=COUNT)

    experiment: ClassVar[Experiment] = Experiment(stop_time=30.0)

    def equations(self) -> Equations:
        x = self.x
        yield der(x) == self.v
        for k in range(COUNT):
            left = x[k - 1] if k else 0.0
            right = x[k + 1] if k + 1 < COUNT else 0.0
            yield der(self.v[k]) == 4.0 * (left - 2.0 * x[k] + right) - sin(x[k])


class Brusselator(Component):
    """The Brusselator with diffusion on 60 cells, 120 states, stiff.

    Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.1.
    """

    a: Real = variable(
        default=fixed(tuple(1.0 + math.sin(2.0 * math.pi * (k + 1) / (COUNT + 1)) for k in range(COUNT))), shape=COUNT
    )
    b: Real = variable(default=fixed((3.0,) * COUNT), shape=COUNT)

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0)

    def equations(self) -> Equations:
        spread = (COUNT + 1) ** 2 / 50.0

        def across(y: Any, k: int, edge: float) -> Any:
            left = y[k - 1] if k else edge
            right = y[k + 1] if k + 1 < COUNT else edge
            return spread * (left - 2.0 * y[k] + right)

        for k in range(COUNT):
            a, b = self.a[k], self.b[k]
            yield der(a) == 1.0 + a**2 * b - 4.0 * a + across(self.a, k, 1.0)
            yield der(b) == 3.0 * a - a**2 * b + across(self.b, k, 3.0)


class Heater(Component):
    """T' = q - T, heated with q = 4 until 3 is reached, off until 2 is: a two-point controller."""

    T: Real = variable(default=fixed(0.0))
    on: Real = boolean(default=fixed(True))

    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0)

    def equations(self) -> Equations:
        yield der(self.T) == where(self.on, 4.0, 0.0) - self.T
        yield when(self.T > 3.0, reset(self.on, False))
        yield when(self.T < 2.0, reset(self.on, True))


class Oven(Component):
    """A self-heating resistor and a heat capacity, switched by a two-point controller with a rising reference.

    After `ControlledTemperature` of Modelica.Thermal.HeatTransfer.Examples, with other numbers.
    """

    supply: electrical.ConstantVoltage = part()
    resistor: electrical.HeatingResistor = part()
    switch: electrical.IdealClosingSwitch = part()
    ground: electrical.Ground = part()
    oven: thermal.HeatCapacitor = part()
    loss: thermal.ThermalConductor = part()
    surroundings: thermal.FixedTemperature = part()
    sensor: thermal.TemperatureSensor = part()
    ramp: blocks.Ramp = part()
    control: blocks.OnOffController = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=12.0)

    def build(self) -> None:
        self.supply = electrical.ConstantVoltage(V=12.0)
        self.resistor = electrical.HeatingResistor(R_ref=8.0, T_ref=293.15, alpha=4e-3)
        self.switch = electrical.IdealClosingSwitch()
        self.ground = electrical.Ground()
        self.oven = thermal.HeatCapacitor(C=1.5, T=fixed(295.0))
        self.loss = thermal.ThermalConductor(G=0.1)
        self.surroundings = thermal.FixedTemperature(T=293.15)
        self.sensor = thermal.TemperatureSensor()
        self.ramp = blocks.Ramp(height=30.0, duration=8.0, offset=300.0)
        self.control = blocks.OnOffController(bandwidth=4.0)

    def equations(self) -> Equations:
        yield connect(self.supply.p, self.resistor.p)
        yield connect(self.resistor.n, self.switch.p)
        yield connect(self.switch.n, self.supply.n, self.ground.p)
        yield connect(self.resistor.heatPort, self.oven.port, self.loss.port_a, self.sensor.port)
        yield connect(self.loss.port_b, self.surroundings.port)
        yield connect(self.ramp.y, self.control.reference)
        yield connect(self.sensor.T, self.control.u)
        yield connect(self.control.y, self.switch.control)


class Bounces(Component):
    """A ball that loses no energy: v = -sqrt(2 g h) at each of a hundred impacts."""

    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=200.0)

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -2.0
        yield when(self.h < 0.0, reset(self.v, -pre(self.v)))


def chain(n: int) -> Problem:
    """Masses without friction, from the eigenvectors of the stiffness matrix."""

    class Masses(MassSpringDamperChain):
        """The chain with `n` masses."""

        experiment: ClassVar[Experiment] = Experiment(stop_time=10.0)

    A = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    A[-1, -1] = 1.0
    squares, modes = np.linalg.eigh(100.0 * A)
    s = modes @ (np.cos(10.0 * np.sqrt(np.abs(squares))) * (modes.T @ (0.1 * np.eye(n)[0])))
    return Problem(lambda: Masses(n=n, d=0.0), {f"masses[{k}].s": float(s[k]) for k in range(n)}, 13, "eigenvectors")


def ladder(n: int) -> Problem:
    """Diffusion, from the eigenvectors of the conductance matrix."""
    A = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    A[-1, -1] = 1.0
    rates, modes = np.linalg.eigh(A)
    v = 1.0 - modes @ (np.exp(-rates * RCLadder.experiment.stop_time) * (modes.T @ np.ones(n)))
    return Problem(lambda: RCLadder(n=n), {f"capacitors[{k}].v": float(v[k]) for k in range(n)}, 13, "eigenvectors")


def line() -> dict[str, float]:
    """The end of `SineGordon`, by an explicit method of order 8 at 1e-13."""
    from scipy.integrate import solve_ivp

    def rates(t: float, y: Array) -> Array:
        x = np.concatenate([[0.0], y[:COUNT], [0.0]])
        return np.concatenate([y[COUNT:], 4.0 * np.diff(x, 2) - np.sin(y[:COUNT])])

    y0 = np.concatenate([2.0 * np.exp(-(((np.arange(COUNT) - 20) / 6.0) ** 2)), np.zeros(COUNT)])
    y = solve_ivp(rates, (0.0, 30.0), y0, method="DOP853", rtol=1e-13, atol=1e-14).y[:COUNT, -1]
    return {f"x[{k}]": float(y[k]) for k in range(COUNT)}


def cells() -> dict[str, float]:
    """The end of `Brusselator`, by a method of order 8 at 1e-13 (its steps are bounded by stability)."""
    from scipy.integrate import solve_ivp

    def rates(t: float, y: Array) -> Array:
        a, b = y[:COUNT], y[COUNT:]
        spread = (COUNT + 1) ** 2 / 50.0
        d_a = spread * np.diff(np.concatenate([[1.0], a, [1.0]]), 2)
        d_b = spread * np.diff(np.concatenate([[3.0], b, [3.0]]), 2)
        return np.concatenate([1.0 + a**2 * b - 4.0 * a + d_a, 3.0 * a - a**2 * b + d_b])

    y0 = np.concatenate([1.0 + np.sin(2.0 * np.pi * np.arange(1, COUNT + 1) / (COUNT + 1)), np.full(COUNT, 3.0)])
    y = solve_ivp(rates, (0.0, 10.0), y0, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    values = {f"a[{k}]": float(y[k]) for k in range(COUNT)}
    return values | {f"b[{k}]": float(y[COUNT + k]) for k in range(COUNT)}


def baked() -> dict[str, float]:
    """The temperature of `Oven`, by an explicit method of order 8 at 1e-13 that stops where the controller switches."""
    from scipy.integrate import solve_ivp

    t, T, on = 0.0, 295.0, True
    while t < 12.0:
        i_off = 1e-5 * 12.0

        def rate(t: float, y: Array, on: bool = on, i_off: float = i_off) -> Array:
            R = 8.0 * (1.0 + 4e-3 * (y[0] - 293.15))
            i = 12.0 / (R + 1e-5) if on else i_off / (1.0 + 1e-5 * R)
            return np.array([(R * i**2 - 0.1 * (y[0] - 293.15)) / 1.5])

        def edge(t: float, y: Array, on: bool = on) -> float:
            return float(y[0] - (300.0 + 30.0 * min(t, 8.0) / 8.0) - (2.0 if on else -2.0))

        edge.terminal = True  # type: ignore[attr-defined]
        edge.direction = 1.0 if on else -1.0  # type: ignore[attr-defined]
        end = 8.0 if t < 8.0 else 12.0
        run = solve_ivp(rate, (t, end), [T], method="DOP853", rtol=1e-13, atol=1e-12, events=edge)
        t, T, on = float(run.t[-1]), float(run.y[0, -1]), on != (run.status == 1)
    return {"oven.T": T}


def heated() -> dict[str, float]:
    """The temperature at 20 s: up from 0 in log 4, then log 1.5 down and log 2 up, again and again."""
    t, T, on = math.log(4.0), 3.0, False
    while t + (math.log(2.0) if on else math.log(1.5)) < 20.0:
        t += math.log(2.0) if on else math.log(1.5)
        T, on = (3.0, False) if on else (2.0, True)
    q = 4.0 if on else 0.0
    return {"T": q + (T - q) * math.exp(-(20.0 - t))}


OWN: dict[str, Callable[[], Problem]] = {
    "kepler": lambda: Problem(Kepler, {"x": 0.5, "y": 0.0, "u": 0.0, "v": math.sqrt(3.0)}, 13, "ten whole periods"),
    "oscillation": lambda: Problem(Oscillation, {"x": 1.0, "v": 0.0}, 14, "a hundred whole periods"),
    "prothero_robinson": lambda: Problem(ProtheroRobinson, {"y": math.sin(10.0)}, 15, "exact"),
    "sine_gordon": lambda: Problem(SineGordon, line(), 11, "DOP853 at 1e-13"),
    "brusselator": lambda: Problem(Brusselator, cells(), 11, "DOP853 at 1e-13"),
    "masses_20": lambda: chain(20),
    "masses_200": lambda: chain(200),
    "ladder_300": lambda: ladder(300),
    "heater": lambda: Problem(Heater, heated(), 14, "exact"),
    "oven": lambda: Problem(Oven, baked(), 12, "DOP853 at 1e-13"),
    "bounces": lambda: Problem(Bounces, {"h": 1.0, "v": 0.0}, 14, "exact"),
    "bang_bang": lambda: Problem(BangBang, {"x": 1.0, "v": 0.0}, 14, "ten whole periods"),
}

SLOPES = {"kepler", "oscillation", "sine_gordon", "masses_20", "masses_200", "heater", "oven", "bounces", "bang_bang"}
"""Problems for which explicit methods are suitable too."""
