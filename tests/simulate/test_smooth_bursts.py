"""Smooth rates that wake for a moment after a long rest: every solver integrates the burst, wherever it is."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from scipy.special import i0e

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    atan,
    cos,
    der,
    exp,
    fixed,
    parameter,
    sin,
    sqrt,
    structural,
    tanh,
    time,
    variable,
)
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.watched import with_watched

SOLVERS = ["idas", "cvodes", "rosenbrock", "erk"]
SPAN = 100.0


def _lorentz_squared(v: float) -> float:
    return 0.5 * (v / (1.0 + v * v) + math.atan(v))


def _box(v: float) -> float:
    """The integral of (1 + tanh(v + 3))*(1 - tanh(v - 3))/4, with a = exp(-12) and ln(cosh(v + 3)/cosh(v - 3))."""
    difference = abs(v + 3.0) - abs(v - 3.0)
    logs = math.log1p(math.exp(-2.0 * abs(v + 3.0))) - math.log1p(math.exp(-2.0 * abs(v - 3.0)))
    return 0.5 * (difference + logs) / (1.0 - math.exp(-12.0))


def _arcs(v: float) -> float:
    def one(u: float) -> float:
        return u * math.atan(u) - 0.5 * math.log1p(u * u)

    return (one(v + 3.0) - one(v - 3.0)) / math.pi


# A pulse of width and height one around zero, and its integral.
PULSES: dict[str, tuple[Callable[[Any], Expr], Callable[[float], float]]] = {
    "Gauss": (lambda v: exp(-(v**2)), lambda v: 0.5 * math.sqrt(math.pi) * math.erf(v)),
    "product": (lambda v: exp(-v * v), lambda v: 0.5 * math.sqrt(math.pi) * math.erf(v)),
    "Lorentz": (lambda v: 1.0 / (1.0 + v**2), math.atan),
    "Lorentz squared": (lambda v: 1.0 / (1.0 + v**2) ** 2, _lorentz_squared),
    "tanh squared": (lambda v: 1.0 - tanh(v) ** 2, math.tanh),
    "logistic": (lambda v: 0.25 * (1.0 - tanh(0.5 * v) * tanh(0.5 * v)), lambda v: 0.5 * math.tanh(0.5 * v)),
    "two tanh": (lambda v: 0.25 * (1.0 + tanh(v + 3.0)) * (1.0 - tanh(v - 3.0)), _box),
    "two atan": (lambda v: (atan(v + 3.0) - atan(v - 3.0)) / math.pi, _arcs),
}


class Burst(Component):
    """y' = k F((s - c)/w) with s = t: as time, as a state, as a variable that is iterated, or behind a definition."""

    pulse: str = structural(default="Gauss")
    argument: str = structural(default="state")
    c: Real = parameter(default=50.0)
    w: Real = parameter(default=0.01)
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        if self.argument == "iterated":
            yield self.z + 0.01 * self.z**3 == self.x + 0.01 * self.x**3
        else:
            yield self.z == (self.x - self.c) / self.w
        s = {"time": time, "state": self.x, "iterated": self.z}.get(self.argument)
        v = self.z if s is None else (s - self.c) / self.w
        yield der(self.y) == self.k * PULSES[self.pulse][0](v)


@cache
def _compiled(pulse: str, argument: str) -> CompiledModel:
    return acausal.compile(Burst(pulse=pulse, argument=argument))


@pytest.mark.parametrize("solver", SOLVERS)
def test_random_bursts(solver: str) -> None:
    """Peaks of 1e-5 to 1e-1 of the run, of height or area one, anywhere in it, against the integral in closed form.

    The argument is known to a tolerance of x only, and errors add up over a burst: ten tolerances of the area, a
    hundred at 1e-4, where the first step behind a rest is large.
    """
    rng = random.Random(SOLVERS.index(solver))
    for _ in range(8 if solver == "erk" else 16):  # a rootfinder in its rates takes most of the time
        pulse, argument = rng.choice(list(PULSES)), rng.choice(["time", "state", "iterated", "defined"])
        w, c = SPAN * 10.0 ** rng.uniform(-5.0, -1.0), SPAN * rng.uniform(0.05, 0.95)
        k, tolerance = rng.choice([1.0, 1.0 / w]), rng.choice([1e-4, 1e-6, 1e-8, 1e-10])
        values = {"c": c, "w": w, "k": k}
        integral = PULSES[pulse][1]
        exact = k * w * (integral((SPAN - c) / w) - integral(-c / w))
        run: dict[str, Any] = {"stop_time": SPAN, "solver": solver, "tolerance": tolerance, "native": False}
        r = acausal.simulate(_compiled(pulse, argument), parameters=values, **run)
        allowed = (100.0 if tolerance >= 1e-4 else 10.0) * tolerance * max(1.0, exact)
        assert r.final("y") == pytest.approx(exact, abs=allowed), (pulse, argument, values, tolerance)
        assert not r.events


class Periodic(Component):
    """Rates of an angle q = t that wake once or twice a turn, and of a body that passes a point."""

    kind: str = structural(default="power")
    q: Real = variable(default=fixed(0.0))
    r: Real = variable(default=fixed(0.0))
    s: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.q) == 1.0
        yield der(self.r) == 0.6
        yield der(self.s) == self.u
        yield der(self.u) == -self.s
        near = (self.q - 20.0) ** 2 + (self.r - 12.0) ** 2
        yield (
            der(self.y)
            == {
                "power": sin(self.q) ** 20000,
                "exponential": exp(150.0 * (cos(self.q) - 1.0)),
                "quotient": 1.0 / (1.0 + 1e8 * cos(self.q) ** 2),
                "oscillator": self.s**20000,
                "peak": exp(1e6 * (self.s - 1.0)),
                "point": exp(-near / 1e-4),
                "bell": 1.0 / (1.0 + near / 1e-4) ** 2,
            }[self.kind]
        )


# Over 4 pi, in which q passes (20, 12) not at all, and over 12 pi, in which it does.
TURN = 2.0 * math.pi
POWER = 2.0 * math.exp(math.lgamma(10000.5) - math.lgamma(10001.0)) * math.sqrt(math.pi)
SPEED = math.hypot(1.0, 0.6)
PERIODIC = {
    "power": 2 * POWER,
    "exponential": 2 * TURN * float(i0e(150.0)),
    "quotient": 2 * TURN / math.sqrt(1.0 + 1e8),
    "oscillator": 2 * POWER,
    "peak": 10 * TURN * float(i0e(1e6)),
    "point": 1e-2 * math.sqrt(math.pi) / SPEED,
    "bell": 1e-2 * 0.5 * math.pi / SPEED,
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", PERIODIC)
def test_periodic_bursts_and_closest_approaches(kind: str, solver: str) -> None:
    """Integrals over a turn: Wallis' for the power, 2 pi exp(-k) I0(k) and 2 pi/sqrt(1 + k) for the next two.

    The oscillator is s = sin t; its power amplifies what s is off by 20000, its exponential by 1e6. A body that goes
    straight through the point sees a pulse of width 1e-2 over its speed. Of ten peaks idas missed five, cvodes four.
    """
    stop = 40.0 if kind in ("point", "bell") else (10.0 if kind == "peak" else 2.0) * TURN + 1.0
    r = acausal.simulate(Periodic(kind=kind), stop_time=stop, solver=solver, tolerance=1e-8)
    expected = PERIODIC[kind]
    if kind == "exponential":  # half of a third peak, and what begins at the end is none
        expected *= 1.25
    assert r.final("y") == pytest.approx(expected, rel={"oscillator": 1e-2, "peak": 5e-2}.get(kind, 1e-4))


class Often(Component):
    """y' = sin(200 t)**200: 400 pulses in 6.3 s."""

    y: Real = variable(default=fixed(0.0))
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 200.0
        yield der(self.y) == sin(self.x) ** 200


def test_thousands_of_bursts_are_named() -> None:
    """Wallis' integral, 200 turns; pulses are a sixteenth as wide as they are apart, and steps a twentieth."""
    r = acausal.simulate(Often(), stop_time=TURN, solver="idas", tolerance=1e-6)
    wallis = 2.0 * math.exp(math.lgamma(100.5) - math.lgamma(101.0)) * math.sqrt(math.pi)
    assert r.final("y") == pytest.approx(wallis, rel=1e-3)
    assert "AC414" in str(r.stats["notes"])


HARMLESS: dict[str, Callable[[Any, Any], Expr]] = {
    "diode": lambda x, v: 1e-9 * (exp(x / 0.025) - 1.0),
    "friction": lambda x, v: -tanh(v / 1e-3),
    "regularised": lambda x, v: -v / sqrt(1e-6 + v**2),
    "softened": lambda x, v: -x / (1.0 + 0.5 * cos(x) ** 2),
    "attraction": lambda x, v: -x / sqrt(x**2 + v**2) ** 3,
    "polynomial": lambda x, v: x**2 * v**4,
}


class Harmless(Component):
    force: Callable[[Any, Any], Expr] = structural(default=HARMLESS["diode"])
    x: Real = variable(default=fixed(0.1))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.force(self.x, self.v) - self.x


@pytest.mark.parametrize("force", HARMLESS.values(), ids=HARMLESS)
def test_one_step_for_itself_is_no_burst(force: Callable[[Any, Any], Expr]) -> None:
    """The error control sees both sides of it: nothing is watched, and such runs cost what they did."""
    model, notes = with_watched(acausal.compile(Harmless(force=force)), 1e-6)
    assert not model.state_events.middles
    assert not notes
