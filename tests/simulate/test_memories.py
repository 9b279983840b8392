"""`pre`, `edge` and `change` in equations: an edge takes no time, and between events a memory equals what it remembers.

Expected values are integrals in closed form; Modelica 3.6, section 3.7.5.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    boolean,
    change,
    cos,
    der,
    discrete,
    edge,
    fixed,
    no_event,
    pre,
    reset,
    sample,
    structural,
    time,
    variable,
    when,
    where,
)


class Counted(Component):
    """x grows at 1000 where a condition holds, and at 1 elsewhere; y is the time."""

    condition: Callable[[Counted], Expr] = structural(default=None)
    has_events: bool = structural(default=False, doc="Something else happens, too")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    b: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.y) == 1.0
        yield der(self.x) == where(self.condition(self), 1e3, 1.0)
        if self.has_events:
            yield self.b == (self.y > 0.25)


CASES: dict[str, tuple[Callable[[Counted], Expr], float]] = {
    "edge of time": (lambda s: edge(time > 0.5), 1.0),
    "change at an instant": (lambda s: change(time > 0.5), 1.0),
    "edge of a state": (lambda s: edge(s.y > 0.5), 1.0),
    "a clock": (lambda s: sample(0.0, 0.1), 1.0),
    "memory of time": (lambda s: pre(time > 0.5), 500.5),
    "memory of a state": (lambda s: pre(s.y > 0.5), 500.5),
    "memory below no_event": (lambda s: no_event(pre(s.y > 0.5)), 500.5),
}


@pytest.mark.parametrize("has_events", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_memories_follow_without_other_events(name: str, has_events: bool) -> None:
    condition, expected = CASES[name]
    model = Counted(condition=condition, has_events=has_events)
    compiled = acausal.compile(model)
    for solver in ("idas", "rosenbrock"):
        found = float(acausal.simulate(compiled, stop_time=1.0, solver=solver).final("x"))
        assert found == pytest.approx(expected, rel=1e-6)
    step = acausal.step_function(compiled, 0.01, "rk4", ["x"])
    x = np.array(step.x.start)
    for _ in range(100):
        x, y = step.function(x, [], step.p.start)
    assert float(y[0]) == pytest.approx(expected, rel=1e-6)


class Kept(Component):
    """n takes a value when y reaches 0.9, as x, the sine of t, is set to -1."""

    value: Callable[[Kept], Expr] = structural(default=None)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == cos(time)
        yield der(self.y) == 1.0
        yield when(self.y > 0.9, reset(self.n, self.value(self)), reset(self.x, -1.0))


@pytest.mark.parametrize(
    "value",
    [
        lambda s: where(pre(no_event(s.x > 0.5)), 1.0, 2.0),
        lambda s: where(no_event(pre(s.x > 0.5)), 1.0, 2.0),
        lambda s: where(no_event(pre(s.x) > 0.5), 1.0, 2.0),
        lambda s: pre(where(s.x > 0.5, 1.0, 2.0, smooth=True)),
        lambda s: where(pre(s.x > 0.5), 1.0, 2.0),
    ],
)
def test_what_was_before_an_event_is_known_without_events(value: Callable[[Kept], Expr]) -> None:
    """sin(0.9) > 1/2."""
    assert float(acausal.simulate(Kept(value=value), stop_time=1.0).final("n")) == 1.0
