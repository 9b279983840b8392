"""An optimum does not depend on units: neither on those of the objective, nor on those of inputs."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, signal_input, variable
from acausal.optimal_control import Problem


class Slider(Component):
    """A mass on a line, pushed."""

    u: Real = signal_input(unit="N", doc="Force")
    m: Real = parameter(default=2.0, unit="kg", min=0.7, max=10.0, doc="Mass")
    s: Real = variable(unit="m", default=fixed(0.0), doc="Position")
    v: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity")

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.u


def least_time(force: float, scale: float, model: Slider | None = None) -> Problem:
    """One metre from rest to rest, in 2*sqrt(m*d/force), counted in units of 1/scale seconds."""
    problem = Problem(model or Slider())
    least = 2.0 * np.sqrt(2.0 / force)
    problem.phase(duration=(0.1 * least, 10.0 * least), intervals=6)
    problem.subject_to("u", min=-force, max=force)
    problem.subject_to(problem.end("s") == 1.0)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(scale * problem.duration)
    return problem


@pytest.mark.parametrize(
    ("force", "scale", "solver"),
    [(8.0, 1e-9, "ipopt"), (8.0, 1e-9, "fatrop"), (8e12, 1.0, "ipopt"), (8e12, 1e-6, "ipopt"), (8.0, 1e6, "ipopt")],
)
def test_least_time_does_not_depend_on_the_unit_of_the_objective(force: float, scale: float, solver: str) -> None:
    least = 2.0 * np.sqrt(2.0 / force)  # full force forward for one half, and back for the other
    best = least_time(force, scale).solve(solver=solver)
    assert best.objective == pytest.approx(scale * least, rel=1e-6)
    # d(least)/dd = least/(2 d)
    assert best.multipliers["s at the end == 1"].value == pytest.approx(scale * least / 2.0, rel=1e-5)


def test_least_effort_over_long_ways_and_times() -> None:
    """From rest to rest with the least integral of u**2: 12 m**2 d**2/T**3 by variations; the guess rests."""
    problem = Problem(Slider())
    problem.phase(duration=1e6, intervals=4)
    problem.subject_to(problem.end("s") == 1e9)
    problem.subject_to(problem.end("v") == 0.0)
    problem.minimize(problem.integral(problem["u"] ** 2))
    assert problem.solve().objective == pytest.approx(48.0, rel=1e-6)


def test_a_small_input_is_replayed() -> None:
    force = 8e-12
    best = least_time(force, 1.0).solve()
    assert best.stats["notes"] == ()
    assert np.abs(best.replay()["u"]).max() == pytest.approx(force, rel=1e-5)
    assert max(best.error(best.replay()).values()) < 1e-6


def test_a_decided_parameter_at_its_declared_limit_can_be_run() -> None:
    problem = least_time(8.0, 1.0)
    problem.decide("m")
    best = problem.solve()
    assert best.parameters == {"m": 0.7}
    run = acausal.simulate(
        Slider(), inputs=best.inputs, start=best.start, parameters=best.parameters, stop_time=best.objective
    )
    assert run.final("s") == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("scale", [1e-12, 1e-6])
def test_a_controller_does_not_depend_on_the_unit_of_its_objective(scale: float) -> None:
    found = []
    for factor in (1.0, scale):
        problem = Problem(Slider())
        problem.phase(duration=1.0, intervals=10)
        problem.subject_to("u", min=-20.0, max=20.0)
        problem.minimize(factor * problem.integral((problem["s"] - 1.0) ** 2 + 1e-3 * problem["u"] ** 2))
        found.append(problem.controller()({"s": 0.2, "v": 0.1})["u"])
    assert found[1] == pytest.approx(found[0], rel=1e-4)
