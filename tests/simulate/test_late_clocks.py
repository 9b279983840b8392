"""Clocks late in time: the rounding of a time is then a large share of an interval, and no tick may be lost."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    der,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    time,
    variable,
    when,
    where,
)
from acausal.export.step.step import step_function
from tests.stepping import walk


class TwoClocks(Component):
    """Two clocks, counted; the second one at `shift` behind the first."""

    first: Real = parameter(default=0.0, unit="s")
    interval: Real = parameter(default=1e-3, unit="s")
    shift: Real = parameter(default=0.0, unit="s")
    m: Real = integer()
    n: Real = integer()
    late: Real = integer()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield when(sample(self.first, self.interval), reset(self.m, pre(self.m) + 1))
        yield when(sample(self.first + self.shift, self.interval), reset(self.n, pre(self.n) + 1))
        yield when(time >= self.first + 5 * self.interval, reset(self.late, self.m))


@pytest.mark.parametrize("start", [0.0, -1e4, 1e5, 1e6, 1e9])
@pytest.mark.parametrize("interval", [1e-3, 0.0007, 0.3])
def test_no_tick_is_lost_late_in_time(start: float, interval: float) -> None:
    """Twenty intervals and a half hold 21 ticks; the sixth is at the instant at which a relation of time changes."""
    given = {"first": start, "interval": interval, "shift": interval / 2}
    r = acausal.simulate(TwoClocks(), start_time=start, stop_time=start + 20.3 * interval, parameters=given)
    assert (r.final("m"), r.final("n"), r.final("late")) == (21, 20, 6)


def test_a_tick_at_the_start_of_a_late_run_counts() -> None:
    """123 456.789 s are 123 456 789 ms, but not as numbers of double precision."""
    for start in np.round(np.linspace(123456.0, 123457.0, 40), 3):
        r = acausal.simulate(TwoClocks(), start_time=float(start), stop_time=float(start) + 2.5e-3)
        assert r.final("m") == 3


def test_clocks_that_a_long_run_cannot_tell_apart_tick_both() -> None:
    """3e-8 s are nothing in 1e6 s: the two ticks are one instant of the run."""
    r = acausal.simulate(TwoClocks(), stop_time=1e6, parameters={"interval": 5e4, "shift": 3e-8}, output_interval=1e6)
    assert (r.final("m"), r.final("n")) == (21, 20 + 1)


def test_a_step_takes_every_tick_late_in_time() -> None:
    """A clock with the interval of the step ticks once in each."""
    step = step_function(acausal.compile(TwoClocks()), 1e-3, "rk4", [])
    for start in (1e5, 3e7):
        before = step.x.start[step.x.position("m")]
        assert walk(step, 50, start={"time": start})["m"][-1] - before == 50


class Late(Component):
    """A rate that is switched on a while after `first`."""

    first: Real = parameter(default=0.0, unit="s")
    x: Real = variable(default=fixed(0.0), unit="s")

    def equations(self) -> Equations:
        yield der(self.x) == where(time - self.first > 0.3, 1.0, 0.0)


@pytest.mark.parametrize("start", [0.0, -1e6, 1e9, 1e11])
def test_a_run_is_the_same_later_or_says_that_its_times_are_coarse(start: float) -> None:
    """0.7 s of growth, whenever it begins: 1e9 s are rounded to 1e-7 s, more than the tolerance allows."""
    run: dict[str, Any] = {"start_time": start, "stop_time": start + 1.0, "parameters": {"first": start}}
    r = acausal.simulate(Late(), tolerance=1e-8, **run)
    notes: Any = r.stats["notes"]
    is_coarse = any("times of this run are rounded" in note for note in notes)
    assert is_coarse == (abs(start) > 1e8)
    assert is_coarse or r.final("x") == pytest.approx(0.7, abs=1e-8)
