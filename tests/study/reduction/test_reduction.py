"""The report of a reduction: counts, reasons, times, errors."""

from __future__ import annotations

import json
from typing import ClassVar

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    asin,
    der,
    fixed,
    parameter,
    signal_input,
    sqrt,
    structural,
    variable,
    where,
)
from acausal.models.drilling_dynamic import ThickBlock
from tests.lower.test_monotone import Stack
from tests.lower.test_select import Arm, TwoIslands


def test_three_dimensional_drilling_keeps_the_states_of_one_axis() -> None:
    """The hand-written model of benchmarks/thick_block_vs_casadi.py has s, v, s_tar, and the angle that nobody asked
    for here."""
    found = acausal.reduce(ThickBlock(), ["drill.s", "drill.F_f"], repeat=1, stop_time=8.0)
    assert set(found.compiled.states) == {"slide.s", "slide.v", "drill.s_tar"}
    assert found.before.states == 4
    assert found.after.equations < found.before.solved < found.before.equations
    assert [(item.kind, item.name) for item in found.dropped] == [("state", "spindle.phi")]
    assert found.comparison is not None
    assert found.comparison.failed is None
    assert max(e.absolute for e in found.comparison.errors) < 1e-12


def test_the_report_is_json_and_text() -> None:
    found = acausal.reduce(TwoIslands(), ["mass_a.s", "spring_b.f"], repeat=1, stop_time=1.0, tolerance=1e-8)
    content = json.loads(json.dumps(found.record()))
    assert content["states"]["after"] == ["mass_a.s", "mass_a.v", "mass_b.s", "mass_b.v"]
    assert {item["name"] for item in content["dropped"] if item["kind"] == "state"} == {"h", "v"}
    assert content["speed"]["gained"] > 0
    assert content["error"]["mass_a.s"]["absolute"] < 1e-6
    assert [set(i["states"]) for i in content["islands"]] == [{"mass_a.s", "mass_a.v"}, {"mass_b.s", "mass_b.v"}]
    text = str(found)
    assert "no output depends on it" in text
    assert "2 islands" in text


def test_islands_solved_apart_give_the_same() -> None:
    found = acausal.reduce(TwoIslands(), ["mass_a.s", "mass_b.s"], compare=False)
    result = found.simulate(stop_time=1.0, tolerance=1e-9)
    # closed forms: sqrt(100/1) and sqrt(400/1) rad/s
    np.testing.assert_allclose(result["mass_a.s"], 0.1 * np.cos(10.0 * result.time), atol=1e-7)
    np.testing.assert_allclose(result["mass_b.s"], 0.2 * np.cos(20.0 * result.time), atol=1e-7)


class Leaving(Component):
    """A relation that holds wherever its function has a value, and is false beyond."""

    angle: bool = structural(default=False)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.y == where((asin(self.x) if self.angle else sqrt(self.x)) > -3.0, 1.0, 2.0)


@pytest.mark.parametrize("angle", [False, True])
def test_a_relation_without_a_value_is_not_decided(angle: bool) -> None:
    """Every value of the root is above -3, but where x < 0 there is none, and the relation is false, as with nan."""
    found = acausal.reduce(Leaving(angle=angle), ["y"], compare=False)
    assert (found.constant, found.compiled.states) == ((), ("x",))
    assert found.simulate(stop_time=3.0).final("y") == 2.0


class TwoPulses(Component):
    """Two lags that switch at different times, and a signal of time that neither needs."""

    t_a: Real = parameter(default=0.3, unit="s")
    t_b: Real = parameter(default=0.7, unit="s")
    T: Real = parameter(default=0.1, unit="s")
    a: Real = variable(default=fixed(0.0))
    b: Real = variable(default=fixed(0.0))
    square: Real = variable(unit="s2")

    def equations(self) -> Equations:
        yield self.square == acausal.time**2
        yield self.T * acausal.der(self.a) == acausal.where(acausal.time < self.t_a, 0.0, 1.0) - self.a
        yield self.T * acausal.der(self.b) == acausal.where(acausal.time < self.t_b, 0.0, 1.0) - self.b


def test_islands_with_events_of_their_own_are_joined_at_all_times() -> None:
    result = acausal.reduce(TwoPulses(), ["a", "b"], compare=False).simulate(stop_time=1.0, tolerance=1e-9)
    for name, start in (("a", 0.3), ("b", 0.7)):
        expected = np.where(result.time < start, 0.0, 1.0 - np.exp(-(result.time - start) / 0.1))
        np.testing.assert_allclose(result[name], expected, atol=1e-7)
    assert [e.time for e in result.events] == [0.3, 0.7]


@pytest.mark.parametrize("outputs", [["a", "b", "square"], ["square", "b"], ["square"]])
def test_outputs_of_time_alone_are_in_the_joined_result(outputs: list[str]) -> None:
    result = acausal.reduce(TwoPulses(), outputs, compare=False).simulate(stop_time=1.0, tolerance=1e-9)
    np.testing.assert_allclose(result["square"], result.time**2, atol=1e-12)


def test_zeros_that_hide_a_plane_are_hinted_at() -> None:
    found = acausal.reduce(Arm(), ["links[2].frame_b.r_0"], compare=False)
    assert any("freeze zeros" in hint for hint in found.hints)


def test_error_of_the_quasi_static_limit_is_estimated_and_measured() -> None:
    found = acausal.reduce(
        Stack(), ["heavy.s", "light.s"], quasi_static=["light"], repeat=1, stop_time=2.0, tolerance=1e-9
    )
    comparison = found.comparison
    assert comparison is not None
    assert comparison.estimate is not None
    # light.s = 0.99e-3 cos(10 t) lags by d/k of its rate: 5/10100 s times 0.0099 m/s
    assert comparison.estimate["states"]["light.s"] == pytest.approx(5 / 10100 * 0.00985, rel=0.05)
    # slowest root of m z^2 + d z + k + c = 0 with m = 1e-3 kg, d = 5 N s/m, k + c = 10100 N/m
    assert comparison.estimate["slowest"] == pytest.approx(1 / 2500, rel=0.01)
    error = {e.name: e for e in comparison.errors}["light.s"]
    assert 1e-6 < error.absolute < 2e-3  # the start does not lie on the limit: 1e-3 m of it decay in the full model
    assert {item.name for item in found.dropped if item.kind == "quasi-static"} == {"light.s", "light.v"}


class Nothing(Component):
    """One output that never changes."""

    k: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()
    leaf: TwoPulses = TwoPulses()

    def equations(self) -> Equations:
        yield acausal.der(self.x) == 0.0 * self.x
        yield self.y == self.k * self.x


def test_an_output_that_depends_on_nothing_is_named() -> None:
    found = acausal.reduce(Nothing(), ["y"], repeat=1, stop_time=1.0)
    assert found.constant == ("y",)
    assert found.after.states == 0
    assert "never change: y" in str(found)
    assert found.compiled.selection is not None
    assert acausal.simulate(found.compiled, stop_time=1.0, parameters={"k": 3.0}).final("y") == 3.0


class Follower(Component):
    """A lag of 1 ms behind a body that an input force pushes into a stop."""

    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    F: Real = signal_input()

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.F - where(self.x > 0.5, 100.0 * (self.x - 0.5), 0.0)
        yield 1e-3 * der(self.y) == self.x - self.y


def test_the_lag_is_estimated_with_inputs_and_events_too() -> None:
    found = acausal.reduce(Follower(), ["y"], quasi_static=["y"], inputs={"F": 0.5}, repeat=1)
    assert found.comparison is not None
    estimate = found.comparison.estimate
    assert estimate is not None
    # y is 1 ms behind x, whose speed is at most sqrt(1 + 2 F x) up to the stop and a little more behind it
    fastest = float(np.max(np.abs(acausal.simulate(Follower(), inputs={"F": 0.5})["v"])))
    assert estimate["states"]["y"] == pytest.approx(1e-3 * fastest, rel=0.03)
    assert estimate["slowest"] == pytest.approx(1e-3)
    assert found.comparison.errors[0].absolute == pytest.approx(estimate["states"]["y"], rel=0.1)


def test_no_lag_is_told_from_what_is_not_there() -> None:
    found = acausal.reduce(Follower(), ["x"], quasi_static=["y"], inputs={"F": 0.5}, repeat=1)
    assert found.comparison is not None
    assert found.comparison.estimate is None or found.comparison.estimate["states"] == {"y": None}


class Sampled(Component):
    """The integral of a lag behind a sine that is held for 0.1 s."""

    f: Real = variable(default=fixed(0.0))
    x: Real = variable(default=fixed(0.0))
    held: Real = acausal.discrete()

    def equations(self) -> Equations:
        yield 0.1 * acausal.der(self.f) == self.held - self.f
        yield acausal.der(self.x) == self.f
        yield acausal.when(acausal.sample(0.0, 0.1), acausal.reset(self.held, acausal.sin(5.0 * acausal.time)))


@pytest.mark.parametrize("interval", [0.1, 0.07])
def test_errors_are_measured_where_every_row_is_a_sample(interval: float) -> None:
    """0.1 f' = held - f and x' = f: without the lag x is ahead by 0.1 f."""
    found = acausal.reduce(
        Sampled(), ["x"], quasi_static=["f"], repeat=1, output_interval=interval, stop_time=1.0, tolerance=1e-9
    )
    assert found.comparison is not None
    f = acausal.simulate(Sampled(), output_interval=0.01, stop_time=1.0, tolerance=1e-9)["f"]
    (error,) = found.comparison.errors
    assert error.absolute == pytest.approx(0.1 * np.abs(f).max(), rel=0.1)


class KinkBesideWhatRests(Component):
    """y' = 1000 max(x - 0.5, 0) with x = t; the kink also depends on `aside`, which stays zero."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    still: Real = variable(default=fixed(0.0))
    aside: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.still) == -self.still * self.x
        yield self.aside == self.still * acausal.exp(self.x)
        yield der(self.y) == 1e3 * acausal.maximum(self.x + self.aside - 0.5, 0.0)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_kink_is_located_without_what_was_folded(solver: str) -> None:
    """Closed form: y(1) = 1000 * 0.5**2 / 2. A drill above plates was a KeyError: its edges were beside the axis."""
    found = acausal.reduce(KinkBesideWhatRests(), ["y"], repeat=1, stop_time=1.0)
    assert found.compiled.states == ("x", "y")
    r = acausal.simulate(found.compiled, stop_time=1.0, tolerance=1e-8, solver=solver)
    assert r.final("y") == pytest.approx(125.0, rel=1e-7)
