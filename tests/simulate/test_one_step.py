"""One-step methods between their steps: guards that are passed together, and rows of stiff components.

Closed forms throughout; the published end values are those of `acausal/models/ivp/answers.py`.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, cos, der, fixed, parameter, sin, time, variable, where
from acausal.models.ivp.answers import PROBLEMS
from acausal.simulate.native import cache

METHODS = [
    ("rosenbrock", False),
    ("erk", False),
    *(
        pytest.param(
            method, True, marks=[pytest.mark.slow, pytest.mark.skipif(cache.compiler() is None, reason="no C")]
        )
        for method in ("rosenbrock", "erk")
    ),
]


class Passing(Component):
    """A point that passes a window of width 2*half around `place` and a border behind it, both within a step."""

    half: Real = parameter(default=1e-3, unit="")
    place: Real = parameter(default=0.0, unit="")
    x: Real = variable(default=fixed(1.0), unit="")
    inside: Real = variable(default=fixed(0.0), unit="")
    before: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield der(self.inside) == where(abs(self.x - self.place) < self.half, 1 / self.half, 0.0)
        yield der(self.before) == where(self.x > 0.0, 1.0, 0.0)


@pytest.mark.parametrize(("solver", "native"), METHODS)
def test_all_guards_within_a_step_are_found(solver: str, native: bool) -> None:
    """The window takes two half widths, the border is reached at 1 s, wherever the window is."""
    for half, place in [(1e-3, 0.0), (2e-4, 0.0), (1e-5, 0.31), (3e-3, -0.4), (1e-4, 1e-5)]:
        r = acausal.simulate(
            Passing(half=half, place=place), stop_time=2.0, output_interval=2.0, solver=solver, native=native
        )
        assert r.final("inside") == pytest.approx(2.0, abs=1e-6), (half, place)
        assert r.final("before") == pytest.approx(1.0, abs=1e-8)
        assert len(r.events) == 3


class Turning(Component):
    """A point on a sine that passes a window twice."""

    half: Real = parameter(default=1e-3, unit="")
    place: Real = parameter(default=0.37, unit="")
    x: Real = variable(default=fixed(0.0), unit="")
    inside: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == cos(time)
        yield der(self.inside) == where(abs(self.x - self.place) < self.half, 1 / self.half, 0.0)


@pytest.mark.parametrize(("solver", "native"), METHODS)
def test_a_window_passed_between_two_looks(solver: str, native: bool) -> None:
    for half, place in [(1e-3, 0.37), (1e-4, 0.81), (1e-5, 0.12)]:
        r = acausal.simulate(
            Turning(half=half, place=place),
            stop_time=3.1,
            output_interval=3.1,
            tolerance=1e-10,
            solver=solver,
            native=native,
        )
        expected = 2 * (math.asin(place + half) - math.asin(place - half)) / half
        assert r.final("inside") == pytest.approx(expected, abs=1e-5), (half, place)
        assert len(r.events) == 4


class Ignition(Component):
    """y' = y**2 - y**3: almost nothing happens, then everything; `late` is the time since y = 1/2."""

    y: Real = variable(default=fixed(1e-4), unit="")
    late: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.y) == self.y**2 - self.y**3
        yield der(self.late) == where(self.y > 0.5, 1.0, 0.0)


@pytest.mark.parametrize(("solver", "native"), METHODS)
def test_an_ignition_is_found_once_and_in_time(solver: str, native: bool) -> None:
    """t(y) = ln(y / (1 - y)) - 1/y, up to a constant; the time from 1e-4 to 1/2 is 1e4 s, a relative error counts."""
    start = math.log(1e-4 / (1 - 1e-4)) - 1e4
    expected = -2.0 - start
    r = acausal.simulate(Ignition(), stop_time=2e4, tolerance=1e-8, solver=solver, native=native)
    assert [e.time for e in r.events] == pytest.approx([expected], rel=1e-8)
    assert r.final("late") == pytest.approx(2e4 - expected, rel=1e-8)


class Follower(Component):
    """A capacitor on a 10 V sine behind next to no resistance: a fast component that follows its source."""

    r: Real = parameter(default=1e-5, unit="")
    v: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        source = 10.0 * sin(100 * math.pi * time)
        yield der(self.v) == ((source - self.v) / self.r - self.v / 10.0) / 1e-3


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
@pytest.mark.parametrize("r", [1e-5, 1e-3, 1e-1])
@pytest.mark.parametrize("native", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_rows_of_a_stiff_component_are_as_good_as_steps(r: float, tolerance: float, native: bool) -> None:
    """v' = -s*v + a*sin(w*t), 500 rows of two periods; interpolated they are 20 mV off."""
    found = acausal.simulate(
        Follower(r=r), stop_time=0.04, solver="rosenbrock", tolerance=tolerance, output_interval=8e-5, native=native
    )
    s, a, w, t = (1 / r + 0.1) / 1e-3, 10 / r / 1e-3, 100 * math.pi, found.time
    exact = a * (s * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-s * t)) / (s**2 + w**2)
    assert np.abs(found["v"] - exact).max() <= 10 * 10 * tolerance


STIFF = ["robertson", "vanderpol", "e5", "oregonator", "pollution"]


@pytest.mark.parametrize("name", STIFF)
@pytest.mark.parametrize("share", [0.31, 0.83])
def test_published_end_values_hold_in_a_row_in_mid_run(name: str, share: float) -> None:
    """The run goes on behind the published instant, so that no step would end there by itself."""
    problem = PROBLEMS[name]
    stop = problem.model.experiment.stop_time
    r = acausal.simulate(
        problem.model(), solver="rosenbrock", tolerance=1e-8, stop_time=stop / share, output_interval=stop
    )
    row = int(np.argmin(np.abs(r.time - stop)))
    assert r.time[row] == pytest.approx(stop, rel=1e-12)
    assert problem.digits_reached(lambda path: r[path][row]) >= 7.0
