"""Delays and events: edges, relays on delayed signals, sliding modes, clauses, delays of delays."""

from __future__ import annotations

import math
from itertools import product
from math import log
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    cos,
    delay,
    der,
    discrete,
    fixed,
    parameter,
    part,
    pre,
    reset,
    sample,
    sin,
    terminate,
    time,
    variable,
    when,
    where,
)
from tests.marks import slow_but
from tests.simulate.delayed import Decay

ADAPTIVE = ["idas", "cvodes", "rosenbrock", "erk"]


class Squares(Component):
    """A square wave, a discrete variable, and both as they were."""

    y: Real = variable()
    d: Real = variable()
    n: Real = discrete()
    e: Real = variable()

    def equations(self) -> Equations:
        yield self.y == where(time < 1.0, 0.0, where(time < 2.3, 1.0, -1.0))
        yield self.d == delay(self.y, 0.3)
        yield when(sample(0.5, 0.5), reset(self.n, 1.0 - pre(self.n)))
        yield self.e == delay(self.n, 0.123)


@pytest.mark.parametrize("solver", ["auto", "rosenbrock", "erk", "cvodes"])
def test_edges_are_delayed_exactly(solver: str) -> None:
    """Both sides of every edge are in the result, and the values between are exact."""
    r = acausal.simulate(Squares(), stop_time=4.0, output_interval=1.0, solver=solver)
    jumps = [e.time for e in r.events if e.condition == "delay(y, 0.3) jumps"]
    assert jumps == pytest.approx([1.3, 2.6], abs=1e-15)
    assert set(r["d"]) == {0.0, 1.0, -1.0}
    assert set(r["e"]) == {0.0, 1.0}
    for t, left, right in ((1.3, 0.0, 1.0), (2.6, 1.0, -1.0)):
        assert r["d"][np.abs(r.time - t) < 1e-12].tolist() == [left, right]


class Integrated(Component):
    """The integral of a delayed switch that a state throws."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    s: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0 + self.x
        yield self.s == where(self.x > 1.0, 1.0, 0.0)
        yield der(self.y) == delay(self.s, 0.25) + 10.0 * delay(self.s, 0.4)


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_events_of_states_are_delayed_too(solver: str) -> None:
    """x = exp(t) - 1 passes 1 at ln 2; y is the area behind both edges."""
    r = acausal.simulate(Integrated(), stop_time=2.0, tolerance=1e-8, solver=solver)
    assert r.final("y") == pytest.approx((1.75 - log(2)) + 10 * (1.6 - log(2)), abs=3e-7)
    assert [e.time for e in r.events] == pytest.approx([log(2), log(2) + 0.25, log(2) + 0.4], abs=1e-7)


class Switching(Component):
    """A relay on a delayed signal: on and off T late, so that x swings beyond its limits by T."""

    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(delay(self.x, 0.2) > 1.0, -1.0, 1.0)


@pytest.mark.parametrize("solver", ADAPTIVE)
def test_a_relay_on_a_delayed_signal(solver: str) -> None:
    """Straight lines: up to 1.2, from there every 0.4 s a turn at the delay after x has passed 1."""
    r = acausal.simulate(Switching(), stop_time=3.0, tolerance=1e-8, solver=solver)
    assert r["x"].max() == pytest.approx(1.2, abs=1e-9)
    assert [e.time for e in r.events if "> 1" in e.condition] == pytest.approx([1.2, 1.6, 2.0, 2.4, 2.8], abs=1e-8)


class Sliding(Component):
    """x slides at its switch from 10/7 s on, and what the switch does then is read later."""

    x: Real = variable(default=fixed(1.0))
    s: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.s == where(self.x > 0.0, -1.0, 1.0)
        yield der(self.x) == 0.3 + self.s
        yield self.y == delay(self.s, 0.25)


def test_a_sliding_mode_is_remembered() -> None:
    """Sliding means that s is -0.3: the mean that keeps x at zero."""
    r = acausal.simulate(Sliding(), stop_time=2.5, tolerance=1e-8)
    assert r.final("y") == pytest.approx(-0.3, abs=1e-9)
    assert [e.time for e in r.events] == pytest.approx([10 / 7, 10 / 7 + 0.25], abs=1e-9)


class Ending(Component):
    """A delayed signal that resets a state, and one that ends the run."""

    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(delay(self.x, 0.25) > 1.0, reset(self.x, delay(self.x, 0.25)))
        yield when(delay(self.x, 0.5) > 1.0, terminate("late"))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_delayed_signals_in_clauses(solver: str) -> None:
    """At 1.25 s x goes back to 1; half a second after it was there first, at 1.5 s, it is 1.25."""
    r = acausal.simulate(Ending(), stop_time=4.0, tolerance=1e-8, solver=solver)
    assert r.time[-1] == pytest.approx(1.5, abs=1e-8)
    assert r.final("x") == pytest.approx(1.25, abs=1e-8)
    assert r.stats["terminated"] == "late"


class Twice(Component):
    """A delay of a delay, and twelve equal parts with delays of their own."""

    x: Real = variable(default=fixed(1.0))
    a: Real = variable()
    b: Real = variable()
    loops: list[Decay] = part()

    def build(self) -> None:
        self.loops = [Decay(T=0.1 * (k + 1)) for k in range(12)]

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.a == delay(delay(self.x, 0.1), 0.2)
        yield self.b == delay(self.x, 0.3)


def test_delays_of_delays_and_of_many_parts() -> None:
    r = acausal.simulate(Twice(), stop_time=1.5, tolerance=1e-8, output_interval=0.1)
    assert r["a"] == pytest.approx(r["b"], abs=1e-9)
    for k in (0, 5, 11):
        own = acausal.simulate(Decay(T=0.1 * (k + 1)), stop_time=1.5, tolerance=1e-8)
        assert r.final(f"loops[{k}].x") == pytest.approx(own.final("x"), abs=1e-7)


class Approached(Component):
    """A corner of x at 0.4 s is read through a delay T that is a state, and an event that changes nothing is before it.

    T' = -0.1 - 0.2 sin(3 t), so that T = 0.3 - 0.1 t - (1 - cos(3 t))/15; x is t up to the corner, then 0.8 - t.
    """

    at: Real = parameter(default=0.5)
    x: Real = variable(default=fixed(0.0))
    T: Real = variable(default=fixed(0.3))
    clock: Real = variable(default=fixed(0.0))
    passed: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(time < 0.4, 1.0, -1.0)
        yield der(self.T) == -0.1 - 0.2 * sin(3.0 * self.clock)
        yield der(self.clock) == 1.0
        yield der(self.passed) == where(self.clock > self.at, 1.0, 0.0)
        yield der(self.y) == delay(self.x, self.T, 0.35)


@pytest.mark.parametrize("solver", slow_but(["rosenbrock", "idas"], "idas"))
def test_an_event_just_before_a_break_is_read_hides_none_of_it(solver: str) -> None:
    """y(1) by quadrature, whatever the distance from the event to where the corner is read."""
    from scipy.integrate import quad
    from scipy.optimize import brentq

    def read(t: float) -> float:
        return t - 0.3 + 0.1 * t + (1.0 - math.cos(3.0 * t)) / 15.0

    root: Any = brentq
    first, corner = (float(root(lambda t, s=s: read(t) - s, 0.0, 1.0, xtol=1e-15)) for s in (0.0, 0.4))
    exact = quad(read, first, corner)[0] + quad(lambda t: 0.8 - read(t), corner, 1.0)[0]
    compiled = acausal.compile(Approached())
    for before in (1e-2, 1e-4, 3e-5, 1e-6, 1e-8, -1e-5):
        result = acausal.simulate(
            compiled, stop_time=1.0, tolerance=1e-8, solver=solver, parameters={"at": corner - before}
        )
        assert result.final("y") == pytest.approx(exact, abs=1e-8)
        assert len({e.time for e in result.events}) == 2, "the corner and the event; nothing jumps"


class Shrinking(Component):
    """A delay that is a state and grows shorter: T = 0.3 exp(-t/2); a clock resets x at 0.5 s."""

    T: Real = variable(default=fixed(0.3))
    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.T) == -0.5 * self.T
        yield self.y == delay(self.x, self.T, 0.3)
        yield der(self.x) == -self.y
        yield when(sample(0.5, 10.0), reset(self.x, 2.0))


@pytest.mark.parametrize("solver", ["rosenbrock", "idas"])
def test_the_rows_are_those_asked_for(solver: str) -> None:
    """The start, both sides of what happens, and nothing of the stretches that a delay needs.

    x jumps at 0.5 s, and is read as it was there when t - 0.3 exp(-t/2) = 0.5: at 0.71031853 s.
    """
    result = acausal.simulate(Shrinking(), stop_time=1.0, output_interval=0.1, solver=solver)
    rows = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.6, 0.7, 0.71031853, 0.71031853, 0.8, 0.9, 1.0]
    assert result.time == pytest.approx(np.array(rows), abs=1e-6)
    assert [result["x"][6], result["y"][10]] == pytest.approx([2.0, 2.0], abs=1e-9)
    assert result["x"][5] == pytest.approx(result["y"][9], abs=1e-6)


class Touched(Component):
    """Relations of a delayed signal beside samples, one of them at an instant at which another has just been passed."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(-0.7))
    q: Real = variable(default=fixed(0.2))
    h: Real = discrete(default=0.3)
    n: Real = discrete(default=0.0)
    w: Real = variable()

    def equations(self) -> Equations:
        yield self.w == delay(sin(3 * time), 0.3)
        yield der(self.x) == -0.5 * self.x - where(self.w > 0.35, self.w, -0.2) + sin(2 * time)
        yield der(self.y) == -0.5 * self.y + 0.8 * where(self.w > 0.35, self.w, -0.2) + sin(2 * time)
        yield der(self.q) == where(self.w > self.x, 1.0, 0.3)
        yield when(sample(0.2, 0.4), reset(self.n, self.w)).elsewhen(self.q > 0.4, reset(self.n, 0))
        yield when(sample(0.15, 0.37), reset(self.h, -pre(self.h)))


@pytest.mark.parametrize("tolerance", [1e-6, 1e-7, 3e-8])
def test_stretches_between_events_may_have_no_length(tolerance: float) -> None:
    """With cvodes at 1e-7 one is located where it begins."""
    found, other = (
        acausal.simulate(Touched(), stop_time=1.3, tolerance=tolerance, solver=solver) for solver in ("cvodes", "erk")
    )
    assert found.final("q") == pytest.approx(other.final("q"), abs=1e2 * tolerance)


class Counted(Component):
    """x = sin(w t), n how often it has risen above c; y reads it later."""

    w: Real = parameter(default=1.0)
    c: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.w * cos(self.w * time)
        yield der(self.y) == delay(self.x, 0.55)
        yield when(self.x > self.c, reset(self.n, pre(self.n) + 1))


@pytest.mark.parametrize(
    ("solver", "w", "c", "tolerance"),
    slow_but(
        [(*p[:1], *p[1], p[2]) for p in product(ADAPTIVE, [(5.8, 0.161), (10.0, 0.5)], [1e-5, 1e-7])],
        *((solver, 5.8, 0.161, 1e-5) for solver in ("rosenbrock", "idas")),
    ),
)
def test_what_is_delayed_passes_its_relation_once(solver: str, w: float, c: float, tolerance: float) -> None:
    """Between -1 and 1, a sine rises above c once in each period; idas and cvodes counted up to 13 for 10."""
    r = acausal.simulate(
        Counted(), parameters={"w": w, "c": c}, stop_time=6.0, solver=solver, tolerance=tolerance, output_interval=6.0
    )
    first = math.asin(c) % (2 * math.pi)
    assert r.final("n") == math.floor((6.0 * w - first) / (2 * math.pi)) + 1
