"""Delays that vary, with a maximum: known signals at known times, edges, delays that follow from states; and errors."""

from __future__ import annotations

import math
from math import sin
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    cos,
    delay,
    der,
    fixed,
    parameter,
    part,
    pre,
    quantity,
    reset,
    sample,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError, DeclarationError, EventError, UsageError
from tests.marks import slow_but
from tests.simulate.delayed import Decay


def lag(t: float) -> float:
    """The delay of `Phase` and `Edges`."""
    return 0.5 + 0.3 * sin(2.0 * t)


class Phase(Component):
    """sin(t) as it was 0.5 + 0.3 sin(2 t) ago."""

    w: Real = parameter(default=1.0, unit="rad/s")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.w * cos(self.w * time)
        yield self.y == delay(self.x, quantity(0.5, "s") + quantity(0.3, "s") * acausal.sin(2.0 * self.w * time), 1.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_a_sine_as_it_was(solver: str, tolerance: float) -> None:
    r = acausal.simulate(Phase(), stop_time=6.0, tolerance=tolerance, solver=solver, output_interval=0.1)
    for t, y in zip(r.time, r["y"], strict=True):
        assert y == pytest.approx(sin(max(t - lag(t), 0.0)), abs=10 * tolerance)


class Edges(Component):
    """A pulse from 1 to 2.3, read with the same delay, and its integral."""

    w: Real = parameter(default=1.0, unit="rad/s")
    y: Real = variable()
    d: Real = variable()
    z: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.y == where(time < 1.0, 0.0, where(time < 2.3, 1.0, -1.0))
        yield self.d == delay(self.y, quantity(0.5, "s") + quantity(0.3, "s") * acausal.sin(2.0 * self.w * time), 1.0)
        yield der(self.z) == self.d


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_edges_are_found_where_they_are_read(solver: str) -> None:
    """t - T(t) = 1 and = 2.3, by bisection; between them z rises, then falls."""
    root: Any = brentq
    up, down = (float(root(lambda t, b: t - lag(t) - b, 0.0, 5.0, args=(b,), xtol=1e-15)) for b in (1.0, 2.3))
    r = acausal.simulate(Edges(), stop_time=4.0, solver=solver, output_interval=1.0)
    assert [e.time for e in r.events if "jumps" in e.condition] == pytest.approx([up, down], abs=1e-13)
    assert r.final("z") == pytest.approx((down - up) - (4.0 - down), abs=1e-9)


class Stretching(Component):
    """x' = -x(t/2 - 1/2): a delay that grows with time."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -delay(self.x, 0.5 + 0.5 * time, 10.0)


def test_a_delay_that_grows() -> None:
    """x = 1 - t up to t = 1, then x' = -(1 - (t - 1)/2) up to t = 3, and a cubic up to 7: x(7) = 2.1666..."""
    r = acausal.simulate(Stretching(), stop_time=3.0, tolerance=1e-9)
    assert r.final("x") == pytest.approx(-1.0, abs=1e-8)

    def rate(t: float, x: np.ndarray) -> list[float]:
        s = 0.5 * t - 0.5
        return [-(1 - s) if s < 1 else -(-(s - 1) + (s - 1) ** 2 / 4)]

    exact = solve_ivp(rate, (3.0, 7.0), [-1.0], rtol=1e-12, atol=1e-12).y[0, -1]
    r = acausal.simulate(Stretching(), stop_time=7.0, tolerance=1e-9)
    assert r.final("x") == pytest.approx(exact, abs=1e-8)


class Settling(Component):
    """A delay that follows from the state that is read."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -0.5 * delay(self.x, 0.2 + self.x**2, 5.0)


def test_a_delay_that_follows_from_a_state_is_the_same_for_all_solvers() -> None:
    """No closed form beyond the first stretch, where x = 1 - t/2; two methods, three tolerances."""
    found = [
        acausal.simulate(Settling(), stop_time=4.0, tolerance=tolerance, solver=solver).final("x")
        for solver in ("rosenbrock", "idas")
        for tolerance in (1e-10, 1e-7, 1e-5)
    ]
    for value, allowed in zip(found, (1e-9, 1e-6, 1e-4, 1e-8, 1e-6, 1e-4), strict=True):
        assert value == pytest.approx(found[0], abs=allowed)
    assert acausal.simulate(Settling(), stop_time=0.5).final("x") == pytest.approx(0.75, abs=1e-7)


class Outer(Component):
    """A part with a delay."""

    T: Real = parameter(default=1.0, unit="s")
    loop: Decay = part()

    def build(self) -> None:
        self.loop = Decay(T=self.T)


def test_a_negative_delay_is_refused_with_the_component() -> None:
    with pytest.raises(DeclarationError, match="AC182") as caught:
        acausal.compile(Outer(T=-0.5))
    assert "in loop: the delay is -0.5 s" in str(caught.value)
    compiled = acausal.compile(Outer())
    with pytest.raises(UsageError, match="AC182") as late:
        acausal.simulate(compiled, parameters={"T": -0.5})
    assert "in loop" in str(late.value)


def test_zero_and_not_zero_are_other_equations() -> None:
    for model, value in ((Decay(T=0.0), 0.5), (Decay(T=0.5), 0.0)):
        with pytest.raises(UsageError, match="AC037"):
            acausal.simulate(acausal.compile(model), parameters={"T": value})


class Unbounded(Component):
    """A delay that varies and says no maximum."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == delay(self.x, 0.1 * self.x)


class Overlong(Component):
    """One that outgrows its maximum."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == delay(self.x, 0.1 * self.x, 0.2)


class Vanishing(Component):
    """One that becomes nothing."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -delay(self.x, acausal.maximum(1.0 - time, 0.0), 2.0)


def test_a_delay_that_varies_needs_a_maximum_and_keeps_to_it() -> None:
    with pytest.raises(DeclarationError, match="AC183"):
        acausal.compile(Unbounded())
    with pytest.raises(EventError, match="AC182") as caught:
        acausal.simulate(Overlong(), stop_time=3.0)
    assert "at most 0.2 s" in str(caught.value)


def test_a_delay_that_vanishes_is_refused() -> None:
    with pytest.raises(AcausalError, match="AC185"):
        acausal.simulate(Vanishing(), stop_time=3.0, tolerance=1e-5)


class Rate(Component):
    """The rate of a delayed signal."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.v == der(delay(self.x, 0.1))


def test_the_rate_of_a_delayed_signal_is_refused_with_a_remedy() -> None:
    with pytest.raises(DeclarationError, match="AC184") as caught:
        acausal.compile(Rate())
    assert "delay(der(x), T)" in str(caught.value)


def test_conditions_and_vectors() -> None:
    x = Decay().x
    with pytest.raises(DeclarationError, match="AC181"):
        delay(x > 1.0, 0.1)
    assert delay((x, 2.0 * x), 0.1).shape == (2,)
    with pytest.raises(DeclarationError, match="AC105"):
        delay(x, (0.1, 0.2))


def test_a_delay_far_too_short_for_the_run_is_refused() -> None:
    with pytest.raises(UsageError, match="AC036"):
        acausal.simulate(Decay(T=1e-9), stop_time=1.0)


class Switched(Component):
    """A sawtooth of 0.5 s and sin(t), delayed by 0.5 s that become 0.3 s and 0.5 s again."""

    kind: str = structural(default="state")
    late: Real = parameter(default=0.0, doc="Seconds by which the long delay exceeds the period of the sawtooth")
    s: Real = variable(default=fixed(0.0))
    c: Real = variable(default=fixed(1.0))
    saw: Real = variable(default=fixed(0.0))
    near: Real = boolean()
    T: Real = variable()
    y: Real = variable(default=fixed(0.0), doc="Integral of the delayed sine")
    q: Real = variable(default=fixed(0.0), doc="Integral of the delayed sawtooth")

    def equations(self) -> Equations:
        yield der(self.s) == self.c
        yield der(self.c) == -self.s
        yield der(self.saw) == 1.0
        yield when(self.saw > 0.5, reset(self.saw, 0.0))
        if self.kind == "clock":
            yield when(sample(SWITCHES[0], SWITCHES[1] - SWITCHES[0]), reset(self.near, ~pre(self.near)))
        else:
            inside = (time > SWITCHES[0]) & (time < SWITCHES[1])
            yield self.near == (self.s > 0.2 if self.kind == "state" else inside)
        yield self.T == where(self.near, 0.3, 0.5 + self.late)
        yield der(self.y) == delay(self.s, self.T, 2.0)
        yield der(self.q) == delay(self.saw, self.T, 2.0)


SWITCHES = math.asin(0.2), math.pi - math.asin(0.2)


def _area(u: float) -> float:
    """Of the sawtooth from 0 to u."""
    return math.floor(u / 0.5) * 0.125 + 0.5 * math.fmod(u, 0.5) ** 2


@pytest.mark.parametrize("late", [4e-15, 2e-11, -2e-11])
def test_an_edge_as_near_as_no_stretch_can_be_short_is_passed(late: float) -> None:
    """The sawtooth jumps just before, or just after, its own jump is read: there and back was tried without end.

    The integral moves by less than `late`.
    """
    r = acausal.simulate(Switched(late=late), stop_time=3.8, solver="idas", tolerance=1e-7, output_interval=0.05)
    last = SWITCHES[1]
    assert r.final("q") == pytest.approx(_area(last - 0.3) + _area(3.3) - _area(last - 0.5), abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "solver"),
    slow_but([("clock", "idas"), ("clock", "auto"), ("state", "auto"), ("time", "auto")], ("clock", "idas")),
)
def test_a_delay_that_jumps_reads_on_from_where_it_has_jumped_to(kind: str, solver: str) -> None:
    """Until asin(0.2) both read before the start, where they are zero; from there on 0.3 s, from pi - that 0.5 s."""
    last = SWITCHES[1]
    for stop, interval in ((4.0, 4.0), (3.8, 0.05)):
        r = acausal.simulate(
            Switched(kind=kind), stop_time=stop, solver=solver, tolerance=1e-7, output_interval=interval
        )
        sine = 1.0 - math.cos(last - 0.3) + math.cos(last - 0.5) - math.cos(stop - 0.5)
        assert r.final("y") == pytest.approx(sine, abs=1e-6)
        assert r.final("q") == pytest.approx(_area(last - 0.3) + _area(stop - 0.5) - _area(last - 0.5), abs=1e-6)
