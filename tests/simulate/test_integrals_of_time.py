"""Integrals of functions of time: they act where an event reads what follows from them, whatever name that has."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    assert_,
    boolean,
    cos,
    delay,
    der,
    fixed,
    integer,
    pre,
    reset,
    sin,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import EventError
from acausal.library.blocks import Relay

SOLVERS = ["rosenbrock", "erk", "idas", "cvodes"]


class Passed(Component):
    """x = t, and u = sin(x), a variable or an expression, is above 1/2 between pi/6 and 5 pi/6, once in 3 s."""

    what: str = structural(default="discrete equation")
    x: Real = variable(default=fixed(0.0))
    area: Real = variable(default=fixed(0.0))
    u: Real = variable()
    on: Real = boolean()
    n: Real = integer()
    is_named: bool = structural(default=True)

    def equations(self) -> Equations:
        yield der(self.x) == where(time < 1.0, 1.0, 1.0)
        yield self.u == sin(self.x)
        above: Expr = (self.u if self.is_named else sin(self.x)) > 0.5
        yield self.on == (above if self.what == "discrete equation" else False)
        yield when(above if self.what == "when" else self.on, reset(self.n, pre(self.n) + 1))
        if self.what == "assertion":
            yield assert_(~above, "u is above one half")
        late = delay(self.u if self.is_named else sin(self.x), 0.5) if self.what == "delay" else 0.0
        yield der(self.area) == where(self.n > 0.5, 1.0, 0.0) + late


@pytest.mark.parametrize(("solver", "is_named"), list(zip(SOLVERS, [False, True, True, False], strict=True)))
@pytest.mark.parametrize("what", ["discrete equation", "when", "assertion", "delay"])
def test_events_read_them(what: str, solver: str, is_named: bool) -> None:
    """From asin(1/2) = pi/6 on; the delayed sine is integrated from 0.5 s on."""
    model = Passed(what=what, is_named=is_named)
    if what == "assertion":
        with pytest.raises(EventError) as caught:
            acausal.simulate(model, stop_time=3.0, solver=solver)
        assert "0.5235" in str(caught.value)
        return
    result = acausal.simulate(model, stop_time=3.0, solver=solver)
    want = 1.0 - math.cos(2.5) if what == "delay" else 3.0 - math.pi / 6
    assert result.final("area") == pytest.approx(want, abs=1e-5)
    assert result.final("n") == (0.0 if what == "delay" else 1.0)


class Switched(Component):
    """A relay behind a sine of an integral."""

    relay: Relay = acausal.part()
    x: Real = variable(default=fixed(0.0))
    area: Real = variable(default=fixed(0.0))

    def build(self) -> None:
        self.relay = Relay(u_low=-0.5, u_high=0.5)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.relay.u == sin(self.x)
        yield der(self.area) == self.relay.y


def test_a_relay_switches() -> None:
    """On from pi/6 to 7 pi/6, off again up to 2 pi."""
    found = acausal.simulate(Switched(), stop_time=2.0 * math.pi)
    assert found.final("area") == pytest.approx(0.0, abs=1e-6)
    assert [e.time for e in found.events] == pytest.approx([k * math.pi / 6 for k in (1, 5, 7, 11)], abs=1e-6)


class Beside(Component):
    """x = t passes 1/2, 3/2 and 5/2; the area below cos(t) acts on nothing, and is solved apart."""

    x: Real = variable(default=fixed(0.0))
    area: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == where(self.n > 9.0, 0.0, 1.0)
        yield der(self.area) == cos(time)
        yield when(self.x > self.n + 0.5, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize(("solver", "native"), [("rk2", False), ("rk2", True), ("rk", False), ("collocation", False)])
def test_they_are_right_at_all_rows_of_fixed_steps(solver: str, native: bool) -> None:
    """At outputs, which are no mesh points of a search of events by even steps, and on both sides of each event."""
    result = acausal.simulate(Beside(), stop_time=3.0, solver=solver, step=1e-3, output_interval=0.0137, native=native)
    assert result.final("n") == 3.0
    assert [e.time for e in result.events] == pytest.approx([0.5, 1.5, 2.5], abs=1e-9)
    assert np.abs(result["area"] - np.sin(result.time)).max() < 1e-8
    assert result.at(1.234, "area") == pytest.approx(math.sin(1.234), abs=1e-8)
