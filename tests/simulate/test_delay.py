"""Constant delays: piecewise polynomials, references by an own method of steps, edges, events, DAEs."""

from __future__ import annotations

from functools import cache
from math import exp, factorial, pi, sin
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    delay,
    der,
    fixed,
    time,
    variable,
    where,
)
from tests.simulate.delayed import DeadTime, Decay, MackeyGlass, Regenerative, by_steps

ADAPTIVE = ["idas", "cvodes", "rosenbrock", "erk"]


def decayed(t: float) -> float:
    """x of `Decay`, T = 1, by the method of steps: sum of (-1)^k (t - k + 1)^k / k! for k up to t + 1."""
    return float(sum((-1) ** k * (t - k + 1) ** k / factorial(k) for k in range(int(t) + 2)))


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-9])
def test_a_delayed_decay_is_a_piecewise_polynomial(solver: str, tolerance: float) -> None:
    r = acausal.simulate(Decay(), stop_time=10.0, tolerance=tolerance, solver=solver, output_interval=0.1)
    error = max(abs(x - decayed(t)) for t, x in zip(r.time, r["x"], strict=True))
    assert error < 2 * tolerance
    assert len(r.time) == 101  # the cuts of the method of steps are not outputs
    assert r.events == ()


@pytest.mark.parametrize(
    ("solver", "step", "error"), [("rk", 0.02, 1e-7), ("rk2", 0.002, 1e-5), ("collocation", 0.05, 1e-7)]
)
def test_solvers_with_fixed_steps(solver: str, step: float, error: float) -> None:
    r = acausal.simulate(Decay(), stop_time=5.0, solver=solver, step=step)
    assert r.final("x") == pytest.approx(decayed(5.0), abs=error)


@pytest.mark.parametrize("interval", [0.01, 0.7, 5.0])
def test_outputs_do_not_change_the_solution_much(interval: float) -> None:
    r = acausal.simulate(Decay(), stop_time=5.0, tolerance=1e-8, solver="idas", output_interval=interval)
    assert r.final("x") == pytest.approx(decayed(5.0), abs=1e-7)


def test_between_the_outputs_the_result_knows_the_past_too() -> None:
    """`at` integrates again from the nearest stored point, with the past of that point."""
    r = acausal.simulate(Decay(), stop_time=5.0, tolerance=1e-9, output_interval=5.0)
    assert r.at(3.3, "x") == pytest.approx(decayed(3.3), abs=1e-8)
    assert r.at(1.0, "x") == pytest.approx(0.0, abs=1e-8)


# Exact solutions of the models, each made once.


@cache
def mackey_glass() -> Any:
    return by_steps(lambda t, x, d: [float(v) for v in 0.2 * d / (1 + d**10) - 0.1 * x], [1.2], 17.0, 100.0)


@cache
def dead_time() -> Any:
    return by_steps(lambda t, x, d: [1.2 * (1 - d[0]) + 0.8 * x[1] - x[0], 1 - d[0]], [0.0, 0.0], 0.4, 8.0)


@cache
def regenerative() -> Any:
    return by_steps(lambda t, x, d: [x[1], -0.06 * x[1] - x[0] - 0.06 * (x[0] - d[0])], [0.0, 1.0], 3.0, 60.0)


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-9])
def test_mackey_glass(solver: str, tolerance: float) -> None:
    exact = mackey_glass()
    r = acausal.simulate(MackeyGlass(), stop_time=100.0, tolerance=tolerance, solver=solver, output_interval=1.0)
    assert max(abs(x - exact(t)[0]) for t, x in zip(r.time, r["x"], strict=True)) < 10 * tolerance


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_a_control_loop_with_dead_time(solver: str, tolerance: float) -> None:
    exact = dead_time()
    r = acausal.simulate(DeadTime(), stop_time=8.0, tolerance=tolerance, solver=solver, output_interval=0.1)
    assert max(abs(x - exact(t)[0]) for t, x in zip(r.time, r["x"], strict=True)) < 10 * tolerance


@pytest.mark.parametrize("solver", ["auto", "idas", "cvodes"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-9])
def test_regenerative_chatter(tolerance: float, solver: str) -> None:
    exact = regenerative()
    r = acausal.simulate(Regenerative(), stop_time=60.0, tolerance=tolerance, solver=solver, output_interval=0.5)
    assert r.stats["solver"] == ("rosenbrock" if solver == "auto" else solver)
    assert max(abs(x - exact(t)[0]) for t, x in zip(r.time, r["x"], strict=True)) < 10 * tolerance


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_chatter_that_grows(solver: str) -> None:
    """The method of steps. cvodes ended 29 tolerances off, as what BDF loses at each start came back with the delay."""
    exact = by_steps(lambda t, x, d: [x[1], -0.06 * x[1] - x[0] - 0.08 * (x[0] - d[0])], [0.0, 1.0], 4.7, 120.0)
    model = Regenerative(k=0.08, T=4.7)
    r = acausal.simulate(model, stop_time=120.0, tolerance=1e-9, solver=solver, output_interval=0.5)
    assert max(abs(x - exact(t)[0]) for t, x in zip(r.time, r["x"], strict=True)) < 1e-8


@pytest.mark.parametrize("lobe", [1, pytest.param(4, marks=pytest.mark.slow)])
def test_the_limit_of_chatter_is_where_theory_puts_it(lobe: int) -> None:
    """J. Tlusty, M. Polacek (1963): k = 2 d (1 + d) at w = sqrt(1 + 2 d), the least over all speeds; there amplitudes
    stay, below they decay, above they grow."""
    d = 0.03
    w, k = (1 + 2 * d) ** 0.5, 2 * d * (1 + d)
    # exp(i w t) is a solution: 1 - w^2 + 2 i d w + k (1 - exp(-i w T)) = 0
    turn = (2 * pi * lobe - np.angle(1 + (1 - w**2 + 2j * d * w) / k)) / w
    growth = []
    for share in (0.9, 1.0, 1.1):
        r = acausal.simulate(Regenerative(d=d, k=share * k, T=float(turn)), stop_time=60 * turn, tolerance=1e-7)
        x = np.abs(r["x"])
        late, later = x[(r.time > 40 * turn) & (r.time < 50 * turn)].max(), x[r.time > 50 * turn].max()
        growth.append(later / late)
    assert growth[0] < 0.9
    assert growth[1] == pytest.approx(1.0, abs=0.02)
    assert growth[2] > 1.1


class Implicit(Component):
    """A delayed algebraic variable: z + z^3 = t."""

    x: Real = variable(default=fixed(0.0))
    z: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.z + self.z**3 == time / 1.0
        yield self.y == delay(self.z, 0.5)
        yield der(self.x) == self.y


@pytest.mark.parametrize("solver", ADAPTIVE)
@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
def test_a_delayed_algebraic_variable(solver: str, tolerance: float) -> None:
    """x is the integral of z: over z it is z (1 + 3 z^2) dz = z^2/2 + 3 z^4/4."""

    def z(t: float) -> float:
        return float(brentq(lambda v: v + v**3 - t, -1.0, 3.0, xtol=1e-15))

    r = acausal.simulate(Implicit(), stop_time=4.0, tolerance=tolerance, solver=solver, output_interval=0.25)
    for t, y in zip(r.time, r["y"], strict=True):
        assert y == pytest.approx(z(max(t - 0.5, 0.0)), abs=10 * tolerance)
    assert r.final("x") == pytest.approx(z(3.5) ** 2 / 2 + 3 * z(3.5) ** 4 / 4, abs=10 * tolerance)


class Several(Component):
    """Two delays of one state, one far below the output interval; sin is the solution by construction."""

    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        t = time / 1.0
        forced = acausal.cos(t) + _past(t, 0.7) + 0.5 * _past(t, 0.03)
        yield der(self.x) == forced - delay(self.x, 0.7) - 0.5 * delay(self.x, 0.03)


def _past(t: acausal.Expr, length: float) -> acausal.Expr:
    return where(t < length, 0.0, acausal.sin(t - length))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_several_delays(solver: str) -> None:
    r = acausal.simulate(Several(), stop_time=3.0, tolerance=1e-7, solver=solver, output_interval=1.0)
    assert r.final("x") == pytest.approx(sin(3.0), abs=1e-6)


class Start(Component):
    """Rest with a delay: before the run a delayed signal is what it is at the start, also where that must be found."""

    x: Real = variable()
    y: Real = variable()

    def initial_equations(self) -> Equations:
        yield der(self.x) == 0.0

    def equations(self) -> Equations:
        yield self.y == 3.0 * self.x + delay(self.y, 0.4) / 2.0
        yield der(self.x) == 1.0 - delay(self.y, 0.4) - self.x


def test_a_steady_start_includes_the_past() -> None:
    """y = 6 x and x = 1 - y: x = 1/7, for ever."""
    r = acausal.simulate(Start(), stop_time=3.0, tolerance=1e-8)
    assert r["x"] == pytest.approx(np.full(len(r.time), 1 / 7), abs=1e-8)


def test_no_delay_is_the_signal_itself() -> None:
    r = acausal.simulate(Decay(T=0.0), stop_time=1.0, tolerance=1e-8)
    assert r.final("x") == pytest.approx(exp(-1.0), abs=1e-7)


def test_a_delay_longer_than_the_run_is_the_start() -> None:
    r = acausal.simulate(Decay(T=100.0), stop_time=3.0)
    assert r.final("x") == pytest.approx(-2.0, abs=1e-9)


def test_the_length_is_a_parameter_of_the_compiled_model() -> None:
    compiled = acausal.compile(Decay())
    r = acausal.simulate(compiled, stop_time=2.0, tolerance=1e-9, parameters={"T": 0.5})
    # term by term: each delay adds one, with alternating signs
    assert r.final("x") == pytest.approx(1 - 2 + 1.5**2 / 2 - 1 / 6 + 0.5**4 / 24, abs=1e-8)


def test_compiled_code_gives_the_same() -> None:
    for solver in ("idas", "rosenbrock", "erk"):
        r = acausal.simulate(Decay(), stop_time=4.0, tolerance=1e-9, solver=solver, native=True)
        assert r.final("x") == pytest.approx(decayed(4.0), abs=1e-8)
        assert r.stats["native"]


def test_the_past_of_a_linear_equation_has_its_root() -> None:
    """x' = -x(t - T) swings for ever at T = pi/2: x -> A cos(t + phi), so that x(t + pi) = -x(t)."""
    r = acausal.simulate(Decay(T=pi / 2), stop_time=19 * pi, tolerance=1e-9, output_interval=pi / 20)
    x = r["x"][-61:]
    assert x[20:] == pytest.approx(-x[:-20], abs=1e-6)
