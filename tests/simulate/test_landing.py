"""Bodies that come to rest after few impacts or one, and guards that dip below zero between looks that are not even.

Expected values: a ball dropped from 1 m lies on the floor, h = 0, after (1 + e)/(1 - e) times the time of its first
fall, whatever is left of its speed at an impact (e = 0: at once). x = t - 1 is within 1 mm of zero for 2 ms.
"""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, integer, pre, reset, variable, when, where
from acausal.models.bouncing_ball import BouncingBall


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize("e", [0.0, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_a_ball_that_hardly_bounces_stays_on_the_floor(solver: str, e: float, tolerance: float) -> None:
    result = acausal.simulate(
        BouncingBall(e=e), stop_time=20.0, output_interval=5.0, tolerance=tolerance, solver=solver, native=False
    )
    assert result.final("h") == pytest.approx(0.0, abs=tolerance)
    assert result.final("v") == pytest.approx(0.0, abs=tolerance)
    (note,) = [n for n in result.stats["notes"] if "at rest" in n]  # type: ignore[attr-defined]
    rest = (2 / 9.81) ** 0.5 * (1 + e) / (1 - e)
    # a flight as high as the tolerance lasts its root
    assert float(note.split(" s on")[0].split("= ")[1]) == pytest.approx(rest, abs=tolerance**0.5)
    if e == 0.0:
        assert result.final("bounces") == 1.0


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
@pytest.mark.parametrize("points", [1, 7, 100, 10_000])
def test_a_short_dip_is_seen_on_every_grid(solver: str, points: int) -> None:
    result = acausal.simulate(Window(), stop_time=3.0, output_interval=3.0 / points, tolerance=1e-8, solver=solver)
    assert [event.time for event in result.events] == pytest.approx([0.999, 1.001], abs=1e-9)
    assert result.final("inside") == pytest.approx(2e-3, abs=1e-9)
    assert result.final("n") == 1.0
