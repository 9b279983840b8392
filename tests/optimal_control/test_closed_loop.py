"""A controlled plant is one run: what the controller is told is what the result has, whatever the plant does."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    delay,
    der,
    discrete,
    fabs,
    fixed,
    maximum,
    parameter,
    pre,
    reset,
    sample,
    signal_input,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import UsageError
from acausal.optimal_control import Problem, closed_loop
from acausal.optimal_control.receding.controller import Controller
from acausal.result.series import TimeSeries
from tests.expected import fails_with

SAMPLE = 0.1


class Mass(Component):
    """A mass of 1 kg that is pushed."""

    u: Real = signal_input(min=-3.0, max=3.0)
    s: Real = variable(default=fixed(0.3))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield der(self.v) == self.u


class Disturbed(Component):
    """The same with what a smooth model does not have."""

    kind: str = structural(default="none")
    pull: Real = parameter(default=0.0)
    u: Real = signal_input(min=-3.0, max=3.0)
    s: Real = variable(default=fixed(0.3))
    v: Real = variable(default=fixed(0.0))
    d: Real = discrete(default=0.0)
    f: Real = variable()

    def equations(self) -> Equations:
        pulse = maximum(1.0 - fabs(time - 0.537) / 1e-4, 0.0) / 1e-4
        yield self.f == {
            "pulse": pulse,
            "contact": where(self.s < 0.1, 1e4 * (0.1 - self.s), 0.0),
            "delay": -delay(self.s, 0.27),
        }.get(self.kind, 0.0 * self.s)
        yield der(self.s) == self.v
        yield der(self.v) == self.u + self.f + self.d + self.pull * self.s
        if self.kind == "wall":
            yield when(self.s < 0.1, reset(self.v, -0.8 * pre(self.v)))
        elif self.kind == "clock":
            yield when(sample(0.05, 0.131), reset(self.d, 0.5 - pre(self.d)))
        else:
            yield when(self.s > 1e6, reset(self.d, 0.0))


@cache
def controller() -> Controller:
    problem = Problem(Mass())
    problem.phase(duration=10 * SAMPLE, intervals=10)
    problem.minimize(problem.integral(10.0 * problem["s"] ** 2 + problem["v"] ** 2 + 0.1 * problem["u"] ** 2))
    return problem.controller()


@pytest.mark.parametrize("kind", ["none", "pulse", "contact", "delay", "wall", "clock"])
def test_what_the_controller_is_told_is_in_the_result(kind: str) -> None:
    """And that result is the run of the plant with these inputs, as none of these plants is unstable."""
    told: dict[float, dict[str, float]] = {}

    def seen(t: float, measured: Mapping[str, float]) -> dict[str, float]:
        told[t] = dict(measured)
        return {}

    plant = acausal.compile(Disturbed(kind=kind))
    loop = closed_loop(controller(), plant, samples=15, measure=["s", "v", "d", "u", "f"], estimate=seen)
    assert len(told) == len(loop.cost) == 15
    given = []
    for t, measured in told.items():
        for name in ("s", "v", "d"):
            assert measured[name] == pytest.approx(float(np.asarray(loop.result.at(t, name))), abs=1e-9)
        given.append(float(np.asarray(loop.result.at(t + 0.5 * SAMPLE, "u"))))
    # inputs as they were held up to each sample
    assert [m["u"] for m in told.values()][1:] == pytest.approx(given[:-1], abs=1e-12)
    times = np.append(list(told), 15 * SAMPLE)
    inputs = {"u": TimeSeries(times, [*given, given[-1]], "hold")}
    again = acausal.simulate(plant, inputs=inputs, stop_time=15 * SAMPLE, tolerance=1e-8, solver="idas")
    assert loop.result.final("s") == pytest.approx(float(again.final("s")), abs=1e-5)
    # the disturbance has been there
    if kind == "pulse":
        assert told[max(told)]["v"] != pytest.approx(0.0, abs=1e-6)
        (after,) = [m["v"] for t, m in told.items() if 0.55 < t < 0.65]
        (before,) = [m["v"] for t, m in told.items() if 0.45 < t < 0.55]
        assert after - before == pytest.approx(1.0 + SAMPLE * given[5], abs=1e-5)  # an impulse of 1 N.s
    elif kind == "wall":
        assert loop.result["s"].min() > 0.1 - 1e-6


def test_an_unstable_plant_is_held() -> None:
    """Errors grow like exp(1.7 t), 1e11 in 15 s: inputs that are played back do not hold it, and a controller does."""
    plant = Disturbed()
    loop = closed_loop(controller(), plant, samples=150, parameters={"pull": 3.0})
    late = np.asarray(loop.result.at(np.linspace(10.0, 15.0, 50), "s"))
    assert np.abs(late).max() < 1e-3


class Other(Component):
    """A plant without the input of the controller."""

    w: Real = signal_input()
    s: Real = variable(default=fixed(0.3))

    def equations(self) -> Equations:
        yield der(self.s) == self.w


def test_a_plant_has_the_inputs_of_its_controller_and_a_loop_has_samples() -> None:
    with fails_with(UsageError, "AC010", match="Other has no input u"):
        closed_loop(controller(), Other(), samples=3)
    with fails_with(UsageError, "AC053", match="closed loop of 0 samples"):
        closed_loop(controller(), Mass(), samples=0)
