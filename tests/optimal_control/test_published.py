"""Optima of the textbooks: closed forms, equations of Riccati, published figures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize

from acausal import Component, Equations, Real, cos, der, exp, fixed, quantity, signal_input, sin, variable
from acausal.optimal_control import Problem

_PER_SECOND = quantity(1.0, "1/s")
_A, _B = np.array([[0.5, 1.0], [-1.0, 0.2]]), np.array([[0.0], [1.0]])
_Q, _R = np.diag([1.0, 2.0]), np.array([[0.3]])


class Unstable(Component):
    """x' = A x + B u."""

    u: Real = signal_input(default=0.0)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.5))

    def equations(self) -> Equations:
        yield der(self.x) == _PER_SECOND * (0.5 * self.x + self.y)
        yield der(self.y) == _PER_SECOND * (-self.x + 0.2 * self.y + self.u)


@pytest.mark.parametrize("duration", [2.0, 12.0])
def test_linear_quadratic_regulators_cost_what_riccati_says(duration: float) -> None:
    """The differential equation from P(T) = 1 for 2 s; in 12 s the algebraic one."""

    def slope(_: float, flat: np.ndarray) -> np.ndarray:
        p = flat.reshape(2, 2)
        return np.asarray(_A.T @ p + p @ _A - p @ _B @ np.linalg.solve(_R, _B.T @ p) + _Q).ravel()

    if duration == 12.0:
        p = scipy.linalg.solve_continuous_are(_A, _B, _Q, _R)
    else:
        way = scipy.integrate.solve_ivp(slope, (0.0, duration), np.eye(2).ravel(), rtol=1e-10, atol=1e-12)
        p = way.y[:, -1].reshape(2, 2)
    problem = Problem(Unstable())
    problem.phase(duration=duration, intervals=int(8 * duration**0.7))
    x, y, u = problem["x"], problem["y"], problem["u"]
    left = 1.0 if duration == 2.0 else 0.0
    at_end = problem.end("x") ** 2 + problem.end("y") ** 2
    problem.minimize(problem.integral(x**2 + 2 * y**2 + 0.3 * u**2) + left * at_end)
    start = np.array([1.0, 0.5])
    best = problem.solve()
    assert best.objective == pytest.approx(float(start @ p @ start), rel=1e-4)
    assert best.at(0.0, "u") == pytest.approx(float(-np.linalg.solve(_R, _B.T @ p @ start)[0]), rel=1e-3)


class Bead(Component):
    """A bead on a wire whose slope is chosen."""

    slope: Real = signal_input(default=0.7, min=0.0, max=3.14)
    x: Real = variable(unit="m", default=fixed(0.0))
    y: Real = variable(unit="m", default=fixed(0.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v * sin(self.slope)
        yield der(self.y) == self.v * cos(self.slope)
        yield der(self.v) == quantity(9.81, "m/s2") * cos(self.slope)


def test_the_brachistochrone_is_a_cycloid() -> None:
    """x = r (a - sin a), y = r (1 - cos a), in the time a sqrt(r / g) (Johann Bernoulli, 1697)."""
    found: Any = scipy.optimize.brentq(lambda a: (a - np.sin(a)) / (1 - np.cos(a)) - 2.0, 0.1, 6.2)
    angle = float(found)
    problem = Problem(Bead())
    problem.phase(duration=(0.1, 3.0), intervals=8)
    problem.subject_to(problem.end("x") == 2.0)
    problem.subject_to(problem.end("y") == 1.0)
    problem.minimize(problem.duration)
    exact = angle * np.sqrt(1.0 / (1 - np.cos(angle)) / 9.81)
    assert problem.solve().objective == pytest.approx(exact, rel=1e-6)


class Bounded(Component):
    """A mass thrown at a wall."""

    u: Real = signal_input(default=0.0)
    s: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.s) == _PER_SECOND * self.v
        yield der(self.v) == _PER_SECOND * self.u


def test_a_constraint_on_a_position_costs_what_bryson_and_denham_found() -> None:
    """4 / (9 l) for s <= l = 1/9: A. E. Bryson, W. F. Denham, S. E. Dreyfus, AIAA Journal 1 (1963) 2544-2550."""
    problem = Problem(Bounded())
    problem.phase(duration=1.0, intervals=12)
    problem.subject_to("s", max=1 / 9)
    problem.subject_to(problem.end("s") == 0.0)
    problem.subject_to(problem.end("v") == -1.0)
    problem.minimize(0.5 * problem.integral(problem["u"] ** 2))
    best = problem.solve()
    assert best.objective == pytest.approx(4.0, rel=1e-4)
    assert best.stats["notes"] == ()


class Rocket(Component):
    """R. H. Goddard's rocket in units of its start; the thrust has a singular arc."""

    thrust: Real = signal_input(default=1.5, min=0.0, max=3.5)
    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    m: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        drag = 310.0 * self.v**2 * exp(-500.0 * (self.h - 1.0))
        yield der(self.h) == _PER_SECOND * self.v
        yield der(self.v) == _PER_SECOND * ((self.thrust - drag) / self.m - 1.0 / self.h**2)
        yield der(self.m) == -_PER_SECOND * 2.0 * self.thrust


def test_goddards_rocket_reaches_its_published_height() -> None:
    """1.01283: E. D. Dolan, J. J. More, T. S. Munson, Benchmarking optimization software with COPS 3.0, 2004."""
    problem = Problem(Rocket())
    problem.phase(duration=(0.05, 0.5), expected=0.2, intervals=20)
    problem.subject_to("m", min=0.6)
    problem.subject_to("v", min=0.0)
    problem.guess(lines={"m": (1.0, 0.6)})
    problem.minimize(-problem.end("h"))
    assert problem.solve().objective == pytest.approx(-1.01283, abs=2e-5)
