"""Friction that sticks and turns round in an order that nobody declared: optima against those of calculus."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from acausal import Component, Equations, Real, der, fixed, parameter, quantity, signal_input, variable, where
from acausal.errors import OptimizationError, UsageError
from acausal.optimal_control import Problem
from acausal.optimal_control.optimum.optimum import Optimum
from tests.expected import fails_with
from tests.optimal_control.test_rounding import Rubbing, back


def least_effort(intervals: int) -> Problem:
    """A block that slides at 1 m/s is to be at rest where it began, after 8 s: it stops, sticks, and turns round."""
    problem = Problem(Rubbing())
    problem.phase(duration=8.0, intervals=intervals)
    problem.subject_to(problem.end("x") == 0.0)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    problem.guess(inputs={"u": -0.6})
    return problem


def effort() -> float:
    """The least integral of u**2, over the place D where it turns round.

    To D from 1 m/s and back over D from rest to rest the acceleration is linear in time (Euler-Lagrange), u differs
    from it by the friction of 0.5 m/s2, and sticking in between costs nothing. Back: 12 D**2/T**3 + T/4 in
    the time T, least at T**2 = 12 D, where it is sqrt(12 D)/3.
    """

    def there(distance: float) -> float:
        def cost(time: float) -> float:
            powers = np.array([[time, time**2 / 2], [time**2 / 2, time**3 / 6]])
            a, b = np.linalg.solve(powers, [-1.0, distance - time])
            a = a + 0.5
            return float(a * a * time + a * b * time**2 + b * b * time**3 / 3)

        best: Any = minimize_scalar(cost, bounds=(0.3, 2.5), method="bounded", options={"xatol": 1e-9})
        return float(best.fun)

    whole: Any = minimize_scalar(lambda d: there(d) + np.sqrt(12 * d) / 3, bounds=(0.1, 1.0), method="bounded")
    return float(whole.fun)


def replay_error(best: Optimum) -> float:
    found = best.stats["replay_error"]
    assert isinstance(found, float)
    return found


def test_a_block_stops_sticks_and_turns_round() -> None:
    best = least_effort(40).solve(complementarity=True)
    exact = effort()
    assert exact == pytest.approx(1.0, abs=1e-6)
    # inputs that are constant in 0.2 s cost a little more
    assert exact < best.objective < 1.005 * exact
    assert np.abs(np.asarray(best.at(np.linspace(2.0, 4.0, 9), "v"))).max() < 1e-4
    assert np.abs(np.asarray(best.at(np.linspace(2.0, 4.0, 9), "u"))).max() < 1e-3
    assert replay_error(best) < 0.01
    assert replay_error(best) == pytest.approx(max(best.error(best.replay()).values()), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("way", [0.5, 1.2])
def test_friction_that_turns_round_takes_the_least_time(way: float) -> None:
    """As in test_rounding.py, without a bias: the mesh is halved until a run with the answer ends up there."""
    top = ((way + 0.2) / (0.5 / 1.5 + 0.5 / 2.5)) ** 0.5
    exact = 0.4 + top / 1.5 + top / 2.5
    best = back(way).solve(complementarity=True, accuracy=1e-3, refinements=8)
    assert best.objective == pytest.approx(exact, rel=3e-3)
    assert replay_error(best) < 1e-3
    assert best.stats["bias"] == 0.0


class Springy(Component):
    """A ball that is pushed, above a floor that gives way like a spring."""

    u: Real = signal_input(unit="m/s2", min=-20.0, max=20.0, default=0.0, doc="Push by the mass, upward")
    k: Real = parameter(default=400.0, unit="1/s2", min=0.0, doc="Stiffness of the floor by the mass")
    h: Real = variable(unit="m", default=fixed(1.0), doc="Height")
    v: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity, upward")

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == self.u + where(self.h < 0.0, -self.k * self.h, 0.0) - quantity(9.81, "m/s2")


def bounce(phases: bool) -> Problem:
    """Up to 1.3 m after one bounce and 1.2 s with the least effort; left alone the ball is at 0.92 m then."""
    problem = Problem(Springy())
    if phases:
        problem.phase("falls", until="h < 0", intervals=8)
        problem.phase("is thrown back", until=problem["h"] >= 0.0, intervals=8, duration=(0.05, 0.5))
        problem.phase("rises", intervals=8, expected=0.6, duration=(0.1, 2.0))
        problem.subject_to(problem.duration == 1.2)
    else:
        problem.phase(duration=1.2, intervals=20)
    problem.subject_to(problem.end("h") == 1.3)
    problem.minimize(problem.integral(problem["u"] ** 2))
    return problem


@pytest.mark.slow
def test_a_ball_bounces_without_declared_phases() -> None:
    """Against the same in phases, whose inputs are parabolas: constant ones in 27 intervals cost a tenth more."""
    exact = bounce(phases=True).solve()
    assert max(exact.error(exact.replay()).values()) < 1e-4
    best = bounce(phases=False).solve(complementarity=True, accuracy=1e-2, refinements=6)
    assert replay_error(best) < 1e-2
    assert exact.objective < best.objective < 1.2 * exact.objective
    assert best.replay().final("h") == pytest.approx(1.3, abs=0.013)


def test_a_mesh_that_stays_too_coarse_is_refused() -> None:
    with fails_with(OptimizationError, "AC707"):
        least_effort(10).solve(complementarity=True, accuracy=1e-4, refinements=1)


@pytest.mark.parametrize("other", [{"smooth": 1e-2}, {"shooting": "rk4"}, {"solver": "fatrop"}])
def test_complementarity_goes_with_collocation_and_ipopt_alone(other: dict[str, float]) -> None:
    with fails_with(UsageError, "AC053", match="complementarity"):
        least_effort(10).solve(complementarity=True, **other)  # type: ignore[arg-type]
