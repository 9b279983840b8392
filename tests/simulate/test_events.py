"""Events of models with `when` clauses, against closed forms."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    exp,
    fixed,
    parameter,
    pre,
    reset,
    sample,
    sign,
    time,
    variable,
    when,
    where,
)
from acausal.errors import IntegrationError, StructureError
from acausal.lower.build import Symbols
from acausal.simulate.events.regime import Hold, active_set
from tests.expected import fails_with

G = 9.81


class Ball(Component):
    """A ball that bounces on a floor at h = 0 and counts."""

    e: Real = parameter(default=0.8, unit="1")
    h: Real = variable(unit="m", default=fixed(1.0))
    v: Real = variable(unit="m/s", default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -G
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)), reset(self.n, self.n + 1))


def bounces(e: float, stop: float) -> tuple[list[float], float]:
    """Instants of the bounces and the height at `stop`: free fall from 1 m, each flight 2 v / g long."""
    times, v = [math.sqrt(2 / G)], G * math.sqrt(2 / G)
    while True:
        v *= e
        following = times[-1] + 2 * v / G
        if following > stop:
            t = stop - times[-1]
            return times, v * t - G * t**2 / 2
        times.append(following)


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize("interval", [3.0, 0.006])
def test_bounces_are_found_in_order_and_exactly(solver: str, interval: float) -> None:
    """Times of events to ten times the tolerance, with one output and with five hundred."""
    r = acausal.simulate(Ball(), stop_time=3.0, tolerance=1e-8, solver=solver, output_interval=interval)
    expected, height = bounces(0.8, 3.0)
    np.testing.assert_allclose([event.time for event in r.events], expected, rtol=0, atol=1e-7)
    assert r.final("n") == len(expected)
    assert r.final("h") == pytest.approx(height, abs=1e-7)


def test_both_sides_of_an_event_are_in_the_result() -> None:
    r = acausal.simulate(Ball(), stop_time=1.0, tolerance=1e-8, solver="rosenbrock")
    k = int(np.argmax(np.diff(r.time) == 0.0))
    assert r["v"][k] == pytest.approx(-math.sqrt(2 * G), rel=1e-8)
    assert r["v"][k + 1] == pytest.approx(0.8 * math.sqrt(2 * G), rel=1e-8)
    assert r.events[0].changed == ("v", "n")


class SampledDecay(Component):
    """x' = u, and u = -x sampled every `dt`: x shrinks by 1 - dt each time."""

    dt: Real = parameter(default=0.1, unit="s")
    x: Real = variable(default=fixed(1.0))
    u: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(sample(0.0, self.dt), reset(self.u, -self.x))


def test_a_sample_acts_at_its_instants_from_the_first_on() -> None:
    r = acausal.simulate(SampledDecay(), stop_time=1.0, tolerance=1e-8, solver="rosenbrock")
    assert r.final("x") == pytest.approx(0.9**10, rel=1e-10)
    assert r.at(0.45, "u") == pytest.approx(-(0.9**4), rel=1e-10)


class Lift(Component):
    """A ball on a floor that starts to fall away faster than the ball at t = 5 s."""

    h: Real = variable(unit="m", default=fixed(0.1))
    v: Real = variable(unit="m/s", default=fixed(0.0))
    w: Real = variable(unit="m/s", default=fixed(0.0))
    floor: Real = variable(unit="m", default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -G
        yield der(self.floor) == self.w
        yield der(self.w) == where(time < 5.0, 0.0, -2 * G)
        yield when(self.h < self.floor, reset(self.v, self.w - 0.5 * (self.v - self.w)))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_rest_ends_when_it_would_have_to_pull(solver: str) -> None:
    """Free fall from 0 m since 5 s: -g t^2 / 2, the floor falls twice as fast."""
    r = acausal.simulate(Lift(), stop_time=6.0, tolerance=1e-8, solver=solver)
    assert r.at(4.9, "h") == pytest.approx(0.0, abs=1e-9)
    assert r.final("h") == pytest.approx(-G / 2, abs=1e-6)
    assert r.final("floor") == pytest.approx(-G, abs=1e-6)


class Relay(Component):
    """x' = 0.3 - sign(x) reaches 0 from 1 at t = 1/0.7 and stays there, its switch between its two values."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y == sign(self.x)
        yield der(self.x) == 0.3 - self.y


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
def test_a_relay_slides(solver: str) -> None:
    """Filippov: on the switch the mean value is the one that keeps x, here y = 0.3."""
    r = acausal.simulate(Relay(), stop_time=3.0, tolerance=1e-8, solver=solver)
    assert r.final("x") == pytest.approx(0.0, abs=1e-12)
    assert r.final("y") == pytest.approx(0.3, abs=1e-12)
    assert [e.time for e in r.events] == [pytest.approx(1 / 0.7, abs=1e-7)]
    assert "sliding" in str(r.stats["notes"])


class Stiction(Component):
    """v' = F - 5 sign(v) under F = 2 t: stops, and starts again when F reaches 5 at t = 2.5."""

    v: Real = variable(default=fixed(1.0))
    f: Real = variable()

    def equations(self) -> Equations:
        yield self.f == 5 * sign(self.v)
        yield der(self.v) == 2.0 * time - self.f


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
def test_sticking_ends_when_the_force_is_reached(solver: str) -> None:
    """Stops where 1 + t^2 - 5 t = 0, holds with f = 2 t, and moves as (t - 2.5)^2 from t = 2.5 on."""
    r = acausal.simulate(Stiction(), stop_time=4.0, tolerance=1e-8, solver=solver)
    assert [e.time for e in r.events] == pytest.approx([(5 - math.sqrt(21)) / 2, 2.5], abs=1e-7)
    assert r.at(2.0, "f") == pytest.approx(4.0, abs=1e-7)
    assert r.final("v") == pytest.approx(2.25, abs=1e-7)


class Dependent(Component):
    """y follows from x, so it cannot be reset."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.y == 2 * self.x + 1
        yield when(self.x < 0.5, reset(self.y, 0.0))


def test_only_states_are_reset() -> None:
    with fails_with(StructureError, "AC210", match="y cannot be reset") as caught:
        acausal.compile(Dependent())
    assert "test_events.py" in str(caught.value.where[0])
    assert "prefer_state=True" in str(caught.value)


class Preferred(Component):
    """y is to be a state, but follows from x all the same."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(prefer_state=True)

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.y == exp(self.x) + self.x
        yield when(self.x < 0.5, reset(self.y, 0.0))


def test_what_a_variable_has_already_is_no_advice() -> None:
    with pytest.raises(StructureError, match=r"(?s)y cannot be reset.*reset the state it follows from") as caught:
        acausal.compile(Preferred())
    assert "prefer_state" not in str(caught.value.help)


class Pole(Component):
    """x' = x^2 from 1: it ends at t = 1, with an event on the way."""

    x: Real = variable(default=fixed(1.0), unit="")
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.x * self.x
        yield when(self.x > 1.5, reset(self.n, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_solution_that_ends_behind_an_event_is_given_up(solver: str) -> None:
    with pytest.raises(IntegrationError) as caught:
        acausal.simulate(Pole(), stop_time=2.0, solver=solver)
    assert [e.time for e in caught.value.result.events] == pytest.approx([1.0 / 3.0], abs=1e-5)  # ten tolerances
    assert caught.value.result.time[-1] == pytest.approx(1.0, abs=0.01)


class Slid(Component):
    """x slides where y' = p."""

    p: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(self.x > 0, -1.0, 1.0) + self.p
        yield der(self.y) == where(self.x > 0, 1.0, -1.0)


@pytest.mark.parametrize("p", [-1.0, 0.0, 1.0])
def test_rates_of_a_sliding_mode_have_its_slopes_up_to_its_ends(p: float) -> None:
    """From -1 to 1, where the multiplier is exactly 0 and 1: as sensitivities meet it at the last of a stretch."""
    compiled = acausal.compile(Slid())
    s = Symbols(compiled)
    ode = active_set(compiled, (Hold(0),), None).compiled.rhs(*s.inputs)[0]
    slope = ca.Function("slope", s.inputs, [ode[1], ca.jacobian(ode[1], s.p)])
    rate, by_p = slope(0, [0, 0], [], [], [p], [1] * s.m.numel())
    assert (float(rate), float(by_p)) == pytest.approx((p, 1.0), abs=1e-15)
