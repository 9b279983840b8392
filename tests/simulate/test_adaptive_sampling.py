"""Products and functions of steep functions, which are awake where no argument turns nor is in its middle."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    cosh,
    der,
    exp,
    fixed,
    parameter,
    sqrt,
    structural,
    tanh,
    time,
    variable,
)
from acausal.lower.compiled import CompiledModel

SPAN = 100.0


def _logistic(v: Any) -> Expr:
    return 1.0 / (1.0 + exp(-v))


# Pulses and their integrals over all v. Gumbel's density has area one; -s/v of a logistic function s is s*(1 - s);
# of a box, the difference of a step and itself shifted by 4, four times half of what the step rises by.
PULSES: dict[str, tuple[Callable[[Any], Expr], float]] = {
    "Gumbel": (lambda v: exp(-v - exp(-v)), 1.0),
    "logistic": (lambda v: _logistic(v) * (1.0 - _logistic(v)), 1.0),
    "two exponentials": (lambda v: 1.0 / (exp(v) + exp(-v)), 0.5 * math.pi),
    "sech": (lambda v: 1.0 / cosh(v), math.pi),
    "power of two": (lambda v: 2.0 ** (-(v**2)), math.sqrt(math.pi / math.log(2.0))),
    "box": (lambda v: 0.5 * (tanh(3.0 + 3.0 * tanh(v + 2.0)) - tanh(3.0 + 3.0 * tanh(v - 2.0))), 2.0 * math.tanh(6.0)),
}


class Pulse(Component):
    """y' = k F(v), v = (t - c)/w; `is_hybrid` beside a relation, with t as a state or as time."""

    pulse: str = structural(default="Gumbel")
    is_state: bool = structural(default=False)
    is_hybrid: bool = structural(default=False)
    c: Real = parameter(default=50.0)
    w: Real = parameter(default=0.01)
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    late: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        v = ((self.x if self.is_state else time) - self.c) / self.w
        yield der(self.y) == self.k * PULSES[self.pulse][0](v)
        if self.is_hybrid:
            yield der(self.late) == acausal.where(self.x > 70.0, 1.0, 0.0)
        else:
            yield self.late == 0.0


@cache
def _compiled(pulse: str, is_state: bool, is_hybrid: bool) -> CompiledModel:
    return acausal.compile(Pulse(pulse=pulse, is_state=is_state, is_hybrid=is_hybrid))


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_pulses_without_a_middle(solver: str) -> None:
    """Peaks of 1e-5 to 1e-2 of the run, anywhere in it, of area one; the integral in closed form.

    Slopes of exponentials overflow far from their peaks: `erk` needs none.
    """
    rng = random.Random(f"pulses {solver}")
    for _ in range(5):
        pulse, is_hybrid = (
            rng.choice(list(PULSES) if solver == "erk" else ["power of two", "box"]),
            rng.random() < 0.5 and solver != "rosenbrock",
        )
        is_state = pulse in ("power of two", "box") and rng.random() < 0.5
        w, c = SPAN * 10.0 ** rng.uniform(-5.0, -2.0), SPAN * rng.uniform(0.2, 0.8)
        k, tolerance = 1.0 / w, rng.choice([1e-4, 1e-6, 1e-8])
        run: dict[str, Any] = {"stop_time": SPAN, "solver": solver, "tolerance": tolerance, "native": False}
        model = _compiled(pulse, is_state, is_hybrid)
        r = acausal.simulate(model, parameters={"c": c, "w": w, "k": k}, **run)
        exact = k * w * PULSES[pulse][1]
        assert r.final("y") == pytest.approx(exact, abs=100.0 * tolerance * max(1.0, exact)), (pulse, w, c, tolerance)


@pytest.mark.parametrize("pulse", ["sech", "logistic"])
def test_compiled_runs_find_a_pulse_that_underflows_on_both_sides(pulse: str) -> None:
    """Zero but for 1e-6 to 1e-5 of the run, beside a relation of a state, in compiled code; the integral as above."""
    rng = random.Random(f"underflow {pulse}")
    for _ in range(2):
        w, c, tolerance = SPAN * 10.0 ** rng.uniform(-6.0, -5.0), SPAN * rng.uniform(0.2, 0.8), rng.choice([1e-4, 1e-6])
        run: dict[str, Any] = {"stop_time": SPAN, "solver": "erk", "tolerance": tolerance, "native": True}
        r = acausal.simulate(_compiled(pulse, True, True), parameters={"c": c, "w": w, "k": 1.0 / w}, **run)
        area = PULSES[pulse][1]
        assert r.final("y") == pytest.approx(area, abs=100.0 * tolerance * area), (w, c, tolerance)


def _root_step_area() -> float:
    """Integral of exp(-400 (g - 1/2)^2) over v, g = v/sqrt(1 + v^2), dv = dg/(1 - g^2)^1.5, by the midpoint rule."""
    g = (np.arange(200_000) + 0.5) / 100_000 - 1.0
    return float(np.sum(np.exp(-400.0 * (g - 0.5) ** 2) / (1.0 - g * g) ** 1.5) / 100_000)


class RootStep(Component):
    """y' = k exp(-400 (g - 1/2)^2), g = v/sqrt(1 + v^2), v = (x - c)/w: only a run knows whether it is narrow."""

    c: Real = parameter(default=50.0)
    w: Real = parameter(default=0.01)
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        v = (self.x - self.c) / self.w
        yield der(self.x) == 1.0
        yield der(self.y) == self.k * exp(-400.0 * (v / sqrt(1.0 + v * v) - 0.5) ** 2)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_a_pulse_of_a_root_step(solver: str) -> None:
    model, rng, area = acausal.compile(RootStep()), random.Random(f"root {solver}"), _root_step_area()
    for _ in range(8):
        w, c = SPAN * 10.0 ** rng.uniform(-5.0, -2.0), SPAN * rng.uniform(0.2, 0.8)
        tolerance = rng.choice([1e-4, 1e-6, 1e-8])
        run: dict[str, Any] = {"stop_time": SPAN, "solver": solver, "tolerance": tolerance, "native": False}
        r = acausal.simulate(model, parameters={"c": c, "w": w, "k": 1.0 / w}, **run)
        assert r.final("y") == pytest.approx(area, abs=100.0 * tolerance), (w, c, tolerance)


class Behind(Component):
    """A pulse of an iterated g, which itself is a step: g + 0.3 g^3 = s + 0.3 s^3 of s = (1 + tanh((x - c)/w))/2.

    exp(-60 (g - 1/2)^2) is awake on the way of the step; by g = s, dx = w dg/(2 g (1 - g)).
    """

    c: Real = parameter(default=50.0)
    w: Real = parameter(default=0.01)
    x: Real = variable(default=fixed(0.0))
    g: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        step = 0.5 * (1.0 + tanh((self.x - self.c) / self.w))
        yield self.g + 0.3 * self.g**3 == step + 0.3 * step**3
        yield der(self.y) == exp(-60.0 * (self.g - 0.5) ** 2) - math.exp(-15.0)


@pytest.mark.parametrize(("solver", "formulation"), [("idas", "torn"), ("idas", "dae"), ("rosenbrock", "dae")])
def test_a_pulse_behind_a_step(solver: str, formulation: str) -> None:
    """Against the integral of (exp(-60 (g - 1/2)^2) - exp(-15))/(2 g (1 - g)) over g from 0 to 1 by the midpoint rule.

    The integrand is smooth: its numerator vanishes at both ends.
    """
    g = (np.arange(100_000) + 0.5) / 100_000
    integral = float(np.mean((np.exp(-60.0 * (g - 0.5) ** 2) - math.exp(-15.0)) / (2.0 * g * (1.0 - g))))
    model, rng = acausal.compile(Behind(), formulation=formulation), random.Random(f"{solver} {formulation}")
    w, c, tolerance = SPAN * 10.0 ** rng.uniform(-5.0, -3.0), SPAN * rng.uniform(0.2, 0.8), rng.choice([1e-6, 1e-8])
    run: dict[str, Any] = {"stop_time": SPAN, "solver": solver, "tolerance": tolerance, "native": False}
    r = acausal.simulate(model, parameters={"c": c, "w": w}, output_interval=7.0, **run)
    assert r.final("y") == pytest.approx(w * integral, abs=100.0 * tolerance), (w, c, tolerance)
