"""Predictive control: one solver for all samples, on plants that differ from its model."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, quantity, signal_input, time, variable
from acausal.errors import UsageError
from acausal.lower.variants.started import with_starts
from acausal.models.optimal_control.feed_drilling import FeedDrilling, Hardness, horizon
from acausal.optimal_control import Problem, closed_loop
from tests.expected import fails_with
from tests.export.scenes import Slider


def regulator(samples: int = 20, step: float = 0.1) -> Problem:
    """Bring a kilogram back to rest at 0 with a force up to 1 N."""
    problem = Problem(Slider())
    problem.phase(duration=samples * step, intervals=samples)
    problem.subject_to("u", min=-1.0, max=1.0)
    s, v, u = problem["mass.s"], problem["mass.v"], problem["u"]
    problem.minimize(problem.integral(s**2 + v**2 + 0.1 * u**2))
    return problem


def test_each_call_begins_from_the_states_it_is_given() -> None:
    """By symmetry the force is odd in the states; far off it is at its limit."""
    controller = regulator().controller()
    far = controller({"mass.s": 3.0, "mass.v": 0.0})["u"]
    assert far == pytest.approx(-1.0, abs=1e-4)
    near = controller([0.1, 0.05])["u"]
    assert -1.0 < near < 0.0
    assert controller([-0.1, -0.05])["u"] == pytest.approx(-near, rel=1e-4)
    assert controller([0.0, 0.0])["u"] == pytest.approx(0.0, abs=1e-5)


def test_a_mass_is_brought_back() -> None:
    """The plant begins 1 m off with twice the mass that the controller assumes."""
    plant = acausal.compile(Slider())
    moved = with_starts(plant, {"mass.s": 1.0})
    loop = closed_loop(regulator().controller(), moved, samples=80, parameters={"m": 2.0})
    assert abs(float(loop.result.final("mass.s"))) < 2e-2
    assert np.abs(loop.result["u"]).max() <= 1.0 + 1e-6


def test_a_free_duration_is_no_horizon() -> None:
    problem = Problem(Slider())
    problem.phase(duration=(0.1, 2.0))
    problem.minimize(problem.duration)
    with fails_with(UsageError, "AC053", match="no horizon"):
        problem.controller()


class Ramped(Component):
    """A rate that is chosen, and one that grows with time."""

    u: Real = signal_input(unit="1/s", default=0.0, doc="Rate")
    x: Real = variable(unit="1", default=fixed(0.0), doc="What is reached")

    def equations(self) -> Equations:
        yield der(self.x) == self.u + quantity(1.0, "1/s2") * time


def test_a_model_with_a_clock_of_its_own_is_refused() -> None:
    problem = Problem(Ramped())
    problem.phase(duration=1.0, intervals=4)
    problem.minimize(problem.integral(problem["x"] ** 2))
    with fails_with(UsageError, "AC053", match="depends on the time"):
        problem.controller()


@pytest.mark.parametrize(
    ("states", "fact"),
    [
        ({"mass.s": 1.0}, "the state mass.v is missing"),
        ({"mass.s": float("nan"), "mass.v": 0.0}, "the state mass.s is nan"),
        ([1.0], "1 values for 2 states"),
        ([1.0, 0.0, 0.0], "3 values for 2 states"),
    ],
)
def test_a_sample_needs_all_states(states: object, fact: str) -> None:
    with fails_with(UsageError, "AC033", fact):
        regulator().controller()(states)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("harder", [1.15, 0.9])
def test_thrust_stays_at_its_limit_in_steel_of_hidden_hardness(harder: float) -> None:
    """Half a percent above 3 kN at most, at 10 ms on one core; when it is reached, Kienzle's law gives the feed."""
    plant = acausal.compile(FeedDrilling())
    hardness = Hardness()
    loop = closed_loop(
        horizon().controller(varying=["k_c11"], degree=2, tolerance=1e-5),
        plant,
        samples=100,
        parameters={"k_c11": harder * 2240e6},
        measure=Hardness.MEASURED,
        estimate=hardness,
    )
    thrust = loop.result["thrust"]
    assert thrust.max() <= 3000.0 * 1.005
    assert np.asarray(loop.result.at(0.95, "thrust")) == pytest.approx(3000.0, rel=2e-3)
    assert hardness.k_c11 / 2240e6 == pytest.approx(harder, rel=5e-3)
    assert np.median(loop.cost) < 0.01
