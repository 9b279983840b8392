"""Bodies that come to rest, or do not, and guards that dip below zero between mesh points that are not even.

Expected values: a ball dropped from 1 m lies on the floor, h = 0, after (1 + e)/(1 - e) times the time of its first
fall, whatever is left of its speed at an impact (e = 0: at once, e = 1: never); until then its flights are parabolas.
x = t - 1 is within 1 mm of zero for 2 ms.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    sin,
    time,
    variable,
    when,
    where,
)
from acausal.models.bouncing_ball import BouncingBall
from tests.marks import slow_but

G1 = (2 / 9.81) ** 0.5
"""Time of the first fall [s]."""


def end_of_flights(result: acausal.Result) -> float:
    """When the one body comes to rest, as the note says; the last event is there."""
    (note,) = [n for n in result.stats["notes"] if "at rest" in n]  # type: ignore[attr-defined]
    said = float(note.split(" s on")[0].split("= ")[1])
    assert said == pytest.approx(result.events[-1].time, rel=1e-8)
    return result.events[-1].time


def height(t: float, e: float) -> float:
    """Height of the ball, `t` not beyond its rest."""
    start, v = 0.0, 9.81 * G1
    if t < G1:
        return 1.0 - 9.81 * t * t / 2
    start = G1
    while t > start + 2 * e * v / 9.81:
        v *= e
        start += 2 * v / 9.81
    return e * v * (t - start) - 9.81 * (t - start) ** 2 / 2


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize(("e", "tolerance"), [(0.0, 1e-3), (0.0, 1e-10), (0.05, 1e-6), (0.3, 1e-3), (0.3, 1e-10)])
def test_a_ball_that_hardly_bounces_stays_on_the_floor(solver: str, e: float, tolerance: float) -> None:
    result = acausal.simulate(
        BouncingBall(e=e), stop_time=20.0, output_interval=5.0, tolerance=tolerance, solver=solver, native=False
    )
    assert result.final("h") == pytest.approx(0.0, abs=tolerance)
    assert result.final("v") == pytest.approx(0.0, abs=tolerance)
    assert end_of_flights(result) == pytest.approx(G1 * (1 + e) / (1 - e), abs=1e-9 + tolerance)
    if e == 0.0:
        assert result.final("bounces") == 1.0


@pytest.mark.parametrize(
    ("e", "tolerance", "solver", "native"),
    slow_but(
        [
            (*ball, *method)
            for ball in [(0.7, 1e-4), (0.7, 1e-10), (0.9, 1e-8)]
            for method in [*product(["rosenbrock", "erk"], [True, False]), ("idas", False), ("cvodes", False)]
        ],
        (0.7, 1e-4, "rosenbrock", True),
        (0.7, 1e-10, "rosenbrock", False),
        (0.9, 1e-8, "erk", True),
        (0.7, 1e-4, "erk", False),
        (0.7, 1e-10, "idas", False),
        (0.9, 1e-8, "cvodes", False),
    ),
)
def test_the_end_of_the_flights_is_computed(e: float, tolerance: float, solver: str, native: bool) -> None:
    """cvodes does not integrate a parabola exactly: errors of the speed add up over 1/(1 - e) flights, twice."""
    result = acausal.simulate(BouncingBall(e=e), stop_time=9.0, tolerance=tolerance, solver=solver, native=native)
    error = tolerance / (1 - e) ** 2 if solver == "cvodes" else tolerance
    assert end_of_flights(result) == pytest.approx(G1 * (1 + e) / (1 - e), abs=1e-8 + error)


@pytest.mark.parametrize(
    ("solver", "native"), [("rosenbrock", True), ("rosenbrock", False), ("erk", False), ("idas", False)]
)
@pytest.mark.parametrize("e", [0.99, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_ball_that_bounces_at_speed_does_not_rest(solver: str, native: bool, e: float) -> None:
    """At 60 s the ball of e = 0.99 is still 1.5 m/s fast, the elastic one 4.4 m/s."""
    result = acausal.simulate(BouncingBall(e=e), stop_time=60.0, tolerance=1e-8, solver=solver, native=native)
    assert not result.stats["notes"]
    for t in (20.0, 44.5, 59.9):
        assert result.at(t, "h") == pytest.approx(height(t, e), abs=1e-8)


def test_a_long_run_does_not_take_short_flights_for_no_time() -> None:
    """The last flights last 3e-6 s, 1e-10 of the run."""
    result = acausal.simulate(BouncingBall(e=0.9), stop_time=20_000.0, tolerance=1e-8)
    assert end_of_flights(result) == pytest.approx(G1 * 19, abs=1e-7)


class TwoBalls(Component):
    """Two balls that land together at every impact, or at every second one."""

    e: Real = parameter(default=1.0)
    h: Real = parameter(default=1.0)
    a: Real = variable(default=fixed(1.0))
    b: Real = variable()
    va: Real = variable(default=fixed(0.0))
    vb: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        for height, speed in ((self.a, self.va), (self.b, self.vb)):
            yield der(height) == speed
            yield der(speed) == -9.81
            yield when(height < 0.0, reset(speed, -self.e * pre(speed)))

    def initial_equations(self) -> Equations:
        yield self.b == self.h


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize("h", [1.0, 4.0])
def test_elastic_balls_that_land_together_go_on(solver: str, h: float) -> None:
    result = acausal.simulate(TwoBalls(h=h), stop_time=10.0, tolerance=1e-8, solver=solver, native=False)
    assert not result.stats["notes"]
    assert result.final("a") == pytest.approx(height(10.0, 1.0), abs=1e-6)
    # four times as high is twice as slow
    assert result.final("b") == pytest.approx(h * height(10.0 / h**0.5, 1.0), abs=1e-6)


@pytest.mark.parametrize("solver", ["rosenbrock", "cvodes"])
def test_balls_that_land_together_rest_together(solver: str) -> None:
    result = acausal.simulate(TwoBalls(e=0.9), stop_time=10.0, tolerance=1e-8, solver=solver, native=False)
    assert "reset(va" in result.events[-1].condition
    assert "reset(vb" in result.events[-1].condition
    assert result.events[-1].time == pytest.approx(G1 * 19, abs=1e-6)
    assert (result.final("a"), result.final("b")) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.1, 0.5])
def test_compiled_flights_land_too(e: float) -> None:
    result = acausal.simulate(BouncingBall(e=e), stop_time=20.0, tolerance=1e-6, native=True)
    assert result.final("h") == pytest.approx(0.0, abs=1e-6)


class Plastic(Component):
    """A ball that a lift takes along: it lies on the floor of the lift, and leaves it when that falls faster."""

    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    floor: Real = variable(default=fixed(0.0))
    speed: Real = variable(default=fixed(0.0))
    impacts: Real = integer()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -10.0
        yield der(self.floor) == self.speed
        yield der(self.speed) == where(self.speed > -2.0, -1.0, -20.0)
        yield when(self.h < self.floor, reset(self.v, self.speed), reset(self.impacts, pre(self.impacts) + 1))


def test_a_body_at_rest_is_let_go_when_it_would_be_pulled() -> None:
    """The lift falls at 1 m/s2 until it is 2 m/s fast, at t = 2 s; then the ball falls freely from there."""
    result = acausal.simulate(Plastic(), stop_time=2.5, tolerance=1e-8)
    assert result.final("impacts") == 1.0
    assert result.at(1.9, "h") == pytest.approx(-0.5 * 1.9**2, abs=1e-7)
    assert result.final("h") == pytest.approx(-2.0 - 2.0 * 0.5 - 0.5 * 10.0 * 0.25, abs=1e-6)


class Window(Component):
    """A relation that holds for 2 ms of 3 s."""

    x: Real = variable(default=fixed(-1.0))
    inside: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.inside) == where(self.x * self.x < 1e-6, 1.0, 0.0)
        yield when(self.x * self.x < 1e-6, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize("points", [1, 7, 3000])
def test_a_short_dip_is_seen_on_every_grid(solver: str, points: int) -> None:
    result = acausal.simulate(Window(), stop_time=3.0, output_interval=3.0 / points, tolerance=1e-8, solver=solver)
    assert [event.time for event in result.events] == pytest.approx([0.999, 1.001], abs=1e-9)
    assert result.final("inside") == pytest.approx(2e-3, abs=1e-9)
    assert result.final("n") == 1.0


class Clockwork(Component):
    """A ball beside an integral of time, the ball's energy, and a clock that counts."""

    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    lost: Real = variable(default=fixed(0.0))
    turned: Real = variable(default=fixed(0.0))
    ticks: Real = integer()

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield der(self.turned) == sin(3.0 * time)
        energy = 9.81 * pre(self.h) + 0.5 * pre(self.v) ** 2
        yield when(self.h < 0.0, reset(self.v, -0.5 * pre(self.v)), reset(self.lost, pre(self.lost) + 0.75 * energy))
        yield der(self.lost) == 0.0
        yield when(sample(0.0, 0.1), reset(self.ticks, pre(self.ticks) + 1))


@pytest.mark.parametrize("native", [True, False])
def test_integrals_and_clocks_go_on_over_the_last_bounces(native: bool) -> None:
    """At rest from 3 G1 = 1.35 s on, when all of m g h is lost; the integral is (1 - cos 3 t)/3."""
    result = acausal.simulate(Clockwork(), stop_time=2.05, tolerance=1e-9, solver="rosenbrock", native=native)
    times = result.time
    assert result["turned"] == pytest.approx((1.0 - np.cos(3.0 * times)) / 3.0, abs=1e-8)
    assert result["h"] == pytest.approx([height(t, 0.5) if t < 3 * G1 else 0.0 for t in times.tolist()], abs=1e-8)
    assert result.final("lost") == pytest.approx(9.81, abs=1e-7)
    assert result.final("ticks") == 21.0
