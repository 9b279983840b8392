"""Integrals of time solved apart, against closed forms; they act where an event reads what follows from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

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
    parameter,
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
from acausal.simulate.record.quadratures import integrals
from acausal.simulate.solvers.segment import Tolerances

Array = NDArray[np.float64]


def test_smooth_rates_to_rounding() -> None:
    """Wave, constant, decay and a steep rise, over one panel or many."""
    times = np.linspace(0.03, 10.0, 333)
    found = integrals(
        lambda t, _: np.vstack([np.sin(40 * t), 3.0 + 0 * t, np.exp(-t), 1 / np.cosh(50 * (t - 5)) ** 2]),
        np.zeros(1),
        times,
        np.zeros(len(times), dtype=np.int64),
        Tolerances(1e-10),
    )
    expected = [
        (1 - np.cos(40 * times)) / 40,
        3 * times,
        1 - np.exp(-times),
        (np.tanh(50 * (times - 5)) + np.tanh(250)) / 50,
    ]
    np.testing.assert_allclose(found, np.vstack(expected), rtol=0, atol=1e-10)


def test_a_jump_inside_is_enclosed() -> None:
    """A step at pi integrates to max(t - pi, 0)."""
    times = np.linspace(0.1, 10.0, 100)
    stretches = np.zeros(len(times), dtype=np.int64)
    found = integrals(
        lambda t, _: np.where(t < np.pi, 0.0, 1.0)[None, :], np.zeros(1), times, stretches, Tolerances(1e-8)
    )
    np.testing.assert_allclose(found[0], np.maximum(times - np.pi, 0.0), atol=1e-10)


def test_one_output_time() -> None:
    found = integrals(lambda t, _: 2 * t[None, :], np.ones(1), np.array([3.0]), np.array([0]), Tolerances(1e-8))
    np.testing.assert_allclose(found, [[8.0]])


def test_several_stretches_at_once() -> None:
    """k*t over [0, 1] and [2, 4] with k = 1, 2, and a step inside the third stretch."""

    def rates(t: Array, stretch: NDArray[np.int64]) -> Array:
        return np.where(stretch < 2, (1.0 + stretch) * t, np.where(t < 0.3, 0.0, 1.0))[None, :]

    times, stretches = np.array([0.5, 1.0, 3.0, 4.0, 0.2, 0.4, 1.0]), np.array([0, 0, 1, 1, 2, 2, 2])
    found = integrals(rates, np.array([0.0, 2.0, 0.0]), times, stretches, Tolerances(1e-10, 0.01))
    np.testing.assert_allclose(found, [[0.125, 0.5, 5.0, 12.0, 0.0, 0.1, 0.7]], atol=1e-10)


def test_a_pole_is_an_error() -> None:
    def pole(t: Array, _: NDArray[np.int64]) -> Array:
        with np.errstate(divide="ignore"):
            return 1 / np.round(t - 2.0, 12)[None, :]

    with pytest.raises(RuntimeError, match="not finite"):
        integrals(pole, np.zeros(1), np.array([4.0]), np.array([0]), Tolerances(1e-8))


class Shaft(Component):
    """A decay that is integrated, and an angle driven by time alone that nothing reads."""

    x: Real = variable(default=fixed(1.0), unit="1")
    angle: Real = variable(default=fixed(0.5), unit="rad", nominal=100.0)
    rise: Real = parameter(default=2.0, unit="rad/s2")
    tau: Real = parameter(default=1.0, unit="s")

    def equations(self) -> Equations:
        yield self.tau * der(self.x) == -self.x
        yield der(self.angle) == where(time < 1.0, 0.0 * self.rise * time, self.rise * (time - 1.0))


def test_island_of_a_model() -> None:
    """rise/2 (t - 1)**2 after 1 s, on top of the start; the state beside it decays."""
    run = acausal.simulate(Shaft(), stop_time=4.0, tolerance=1e-8)
    assert (run.stats["states"], run.stats["quadratures"]) == (1, 1)
    np.testing.assert_allclose(run["angle"], 0.5 + np.maximum(run.time - 1.0, 0.0) ** 2, atol=1e-12)
    assert run.at(2.345, "angle") == pytest.approx(0.5 + 1.345**2, abs=1e-12)
    np.testing.assert_allclose(run["x"], np.exp(-run.time), atol=1e-7)


def test_nothing_grows_in_no_time() -> None:
    """An event at the very start of its stretch: the integral over no time is 0."""

    def rates(times: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        return np.ones((1, len(times)))

    one = np.array([0.5])
    assert integrals(rates, one, one, np.zeros(1, dtype=np.int64), Tolerances(1e-8, 0.01)).tolist() == [[0.0]]


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
