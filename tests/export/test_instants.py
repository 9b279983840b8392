"""Exported functions at instants: the values after a switch of time, discrete variables exactly as they were set."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    change,
    der,
    discrete,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    signal_output,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.export.step.methods import METHODS

SPELLINGS: dict[str, Any] = {
    "time > p": lambda p: time > p,
    "time >= p": lambda p: time >= p,
    "p < time": lambda p: p < time,
    "p <= time": lambda p: p <= time,
    "~(time < p)": lambda p: ~(time < p),
    "~(time <= p)": lambda p: ~(time <= p),
    "-time < -p": lambda p: -time < -p,
    "3 time >= 3 p": lambda p: 3.0 * time >= 3.0 * p,
    "time / 3 > p / 3": lambda p: time / 3.0 > p / 3.0,
    "time - p > 0": lambda p: time - p > 0.0,
}


class Switched(Component):
    """x' = 5 after the instant p, 2 before it."""

    p: Real = parameter(default=0.7)
    on: str = structural()
    x: Real = variable(default=fixed(0.0))
    y: Real = signal_output()

    def equations(self) -> Equations:
        yield self.y == where(SPELLINGS[self.on](self.p), 5.0, 2.0)
        yield der(self.x) == self.y * (1.0 + self.x)


@pytest.mark.parametrize("on", SPELLINGS)
def test_functions_take_the_value_after_a_switch(on: str) -> None:
    """Each of many instants p, whose products and quotients round either way; the value before is 2, after 5."""
    compiled = acausal.compile(Switched(on=on))
    plain, events = compiled.casadi(), compiled.casadi(events=True).events
    assert events is not None
    for p in (0.7, 0.1, 0.3, 1.1, 2.3, 1e-3, 7.7e3):
        at = float(plain.instants([p]))
        assert at == pytest.approx(p, rel=1e-14)
        for t, rate in ((at * (1 - 1e-9), 2.0), (at, 5.0), (at * (1 + 1e-9), 5.0)):
            assert float(plain.ode(t, 0.0, [], [p])[0]) == rate
            m = events.react(t, 0.0, [], [], [p], events.m.start, [])[2]
            assert float(events.dae(t, 0.0, [], [], [p], m)[0]) == rate
            assert float(acausal.linearize(compiled, t, parameters={"p": p}).A[0, 0]) == rate


@pytest.mark.parametrize("on", SPELLINGS)
def test_a_switch_at_the_start_has_happened(on: str) -> None:
    """A run begins behind it, and so do `init`, `linearize`, steady states and exported steps."""
    compiled = acausal.compile(Switched(on=on, p=0.0))
    run = acausal.simulate(compiled, stop_time=0.1)
    assert run["y"][0] == 5.0
    assert compiled.casadi(["y"]).y.start[0] == 5.0
    assert float(acausal.linearize(compiled, outputs=["y"]).y[0]) == 5.0
    step = acausal.step_function(compiled, 1e-3, "rosenbrock", ["x"])
    assert float(np.array(step.function(step.x.start, [], step.p.start)[1]).ravel()[0]) == pytest.approx(
        np.expm1(5e-3), rel=1e-6
    )


class Counted(Component):
    """Each passage sets d, on which the rates of two states depend; `n` counts how often d has changed."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.4))
    w: Real = variable(default=fixed(0.4))
    d: Real = discrete()
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0 + 0.3 * self.w
        yield der(self.y) == -self.y - self.w + self.d
        yield der(self.w) == self.y - 0.3 * self.d
        yield when(self.x > 0.5, reset(self.d, self.y), reset(self.x, pre(self.x) - 0.5))
        yield when(change(self.d), reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize("method", METHODS)
def test_steps_leave_discrete_variables_exactly_as_they_are(method: str) -> None:
    """`change(d)` asks whether d is exactly what it was: implicit methods do not solve for it. Four passages in 2 s."""
    compiled = acausal.compile(Counted())
    assert acausal.simulate(compiled, stop_time=2.0).final("n") == 4.0
    step = acausal.step_function(compiled, 5e-3, method, ["d", "n"])
    x, seen = np.array(step.x.start), []
    for _ in range(400):
        new, y = (np.array(v).ravel() for v in step.function(x, [], step.p.start))
        x = new
        seen.append((y[0], y[1]))
        assert not y[2:-1].any()
    assert len(set(seen)) == 5, "d has five values, and n counts them"
    assert seen[-1][1] == 4.0


def test_reactions_do_not_take_rounding_for_a_change() -> None:
    """A loop that integrates all of x, d with the rate zero, moves d by rounding; `react` counts what an event sets."""
    made = acausal.compile(Counted()).casadi(events=True)
    assert made.events is not None
    d = made.x.position("d")
    for moved in (0.0, 1e-22, -3e-17):
        x = np.array(made.x.start)
        x[made.x.position("x")], x[d] = 0.5 + 1e-12, moved
        after = np.array(made.events.react(x, [], [], [], made.events.m.start, [])[0]).ravel()
        assert after[made.x.position("n")] == 1.0
        assert after[d] == x[made.x.position("y")]
