"""Events of models with `when` clauses, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    parameter,
    pre,
    reset,
    sample,
    variable,
    when,
    where,
)
from acausal.errors import EventError, StructureError

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


class Relay(Component):
    """x'' = -sign(x) with its switches counted; period 4 sqrt(2) from (1, 0)."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.x > 0, -1.0, 1.0)
        yield when(self.x > 0, reset(self.n, self.n + 1))


def test_bang_bang_is_exact_after_ten_periods() -> None:
    """The scene `bang-bang`: (1, 0) again after 10 periods of 4 sqrt(2)."""
    r = acausal.simulate(Relay(), stop_time=40 * math.sqrt(2), tolerance=1e-8, solver="rosenbrock")
    assert r.final("x") == pytest.approx(1.0, abs=1e-10)
    assert r.final("v") == pytest.approx(0.0, abs=1e-10)
    assert r.final("n") == 10


def test_bounces_without_end_are_named() -> None:
    """The accumulation point is sqrt(2 / g) (1 + e) / (1 - e) = 4.06 s; passing it is a known gap."""
    with pytest.raises(EventError, match="AC502") as caught:
        acausal.simulate(Ball(), stop_time=5.0, tolerance=1e-8, solver="rosenbrock")
    assert "h < 0" in str(caught.value)


class Dependent(Component):
    """y follows from x, so it cannot be reset."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.y == 2 * self.x + 1
        yield when(self.x < 0.5, reset(self.y, 0.0))


def test_only_states_are_reset() -> None:
    with pytest.raises(StructureError, match="y cannot be reset") as caught:
        acausal.compile(Dependent())
    assert caught.value.code == "AC210"
    assert "test_events.py" in str(caught.value.where[0])
