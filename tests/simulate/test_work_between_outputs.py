"""Runs that need many steps between two outputs: whether they are refused depends on none of them."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    pre,
    reset,
    sample,
    structural,
    tanh,
    time,
    variable,
    when,
    where,
)

FASTEST, WIDTH = 1e5, 0.005


class Burst(Component):
    """A turn that is fast for a hundredth of the run, and a guard that it passes once, as it goes by."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    late: Real = variable(default=fixed(0.0))
    s: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        w = FASTEST / (1.0 + ((time - 0.5) / WIDTH) ** 2)
        yield der(self.x) == -w * self.y
        yield der(self.y) == w * self.x
        yield der(self.s) == 1.0
        yield der(self.late) == where(self.s > 0.7, 1.0, 0.0)


def test_many_steps_between_two_outputs() -> None:
    """70 000 steps, most of them within one interval of twenty: refused (AC401) with these rows, passed with others.

    The angle at the end is the integral of the rate, the guard is passed at 0.7.
    """
    compiled = acausal.compile(Burst())
    angle = 2.0 * FASTEST * WIDTH * math.atan(0.5 / WIDTH)
    ends = []
    for interval in (0.05, 0.005):
        r = acausal.simulate(compiled, stop_time=1.0, output_interval=interval, solver="idas", tolerance=1e-8)
        assert [e.time for e in r.events] == pytest.approx([0.7], abs=1e-8)
        assert [r.final("x"), r.final("y")] == pytest.approx([math.cos(angle), math.sin(angle)], abs=1e-4)
        ends.append([r.final("x"), r.final("y")])
    assert ends[1] == pytest.approx(ends[0], abs=1e-9)


class Late(Component):
    """A turn that is fast in the last hundredth of the run; with a clock beside it the run has events, but no guard."""

    clock: bool = structural(default=False)
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    ticks: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        w = 6e5 * (1.0 + tanh((time - 0.99) / 1e-3))
        yield der(self.x) == -w * self.y
        yield der(self.y) == w * self.x
        if self.clock:
            yield when(sample(0.0, 5.0), reset(self.ticks, pre(self.ticks) + 1.0))


@pytest.mark.slow
@pytest.mark.parametrize(("solver", "clock"), [("idas", False), ("cvodes", False), ("idas", True)])
def test_runs_without_guards_count_no_steps_between_outputs(solver: str, clock: bool) -> None:
    """550 000 steps, in the last of 20 intervals: refused (AC401) with these rows, and passed with 2000.

    The integral of w from 0 to 1 is 6e5 (1 + 1e-3 (ln cosh 10 - ln cosh 990)) = 6e5 (1 + 1e-3 (10 - 990)), where
    ln cosh u is u - ln 2 but for exp(-2 u).
    """
    compiled = acausal.compile(Late(clock=clock))
    angle = 6e5 * (1.0 - 0.98 + 1e-3 * math.log1p(math.exp(-20.0)))
    r = acausal.simulate(compiled, stop_time=1.0, output_interval=0.05, solver=solver, tolerance=1e-8)
    assert [r.final("x"), r.final("y")] == pytest.approx([math.cos(angle), math.sin(angle)], abs=1e-4)
    assert len(r.time) == 21
