"""Constraints that are switched on and off, or changed, at events: refused by that name, or right in both modes."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    der,
    discrete,
    fixed,
    integer,
    reset,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.errors import AcausalError
from tests.expected import fails_with

Law = Callable[["Pair", Any], Any]


class Pair(Component):
    """Masses of 1 and 2 kg on one line; the law says what the force between them is or what it holds."""

    law: Law = structural()
    switch: str = structural(default="time")
    begins: bool = structural(default=False)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    w: Real = variable(default=fixed(-0.5))
    f: Real = variable()
    on: Real = boolean(doc="Set by a `when`")
    other: Real = boolean(default=True, doc="Cleared by a `when`")

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.f
        yield 2.0 * der(self.w) == self.f
        yield when(time > 0.5, reset(self.on, True), reset(self.other, False))
        yield self.law(self, self.condition())

    def condition(self) -> Any:
        """True after 0.5 s, or before."""
        if self.switch == "boolean":
            return self.other if self.begins else self.on
        if self.switch == "state":
            return self.x < 0.4 if self.begins else self.x > 0.4
        timely = time < 0.5 if self.begins else time > 0.5
        return timely if self.switch == "time" else acausal.no_event(timely)


def _velocity(m: Pair, on: Any) -> Any:
    return where(on, m.w - m.v, m.f) == 0.0


def _position(m: Pair, on: Any) -> Any:
    return where(on, m.y - m.x - 0.7, m.f) == 0.0


def _turned(m: Pair, on: Any) -> Any:
    return m.f == where(on, m.f + m.y - m.x - 0.7, 0.0)


def _nested(m: Pair, on: Any) -> Any:
    return where(m.y > 0.8, where(on, m.w - m.v, m.f), m.f - m.y) == 0.0


def _factors(m: Pair, on: Any) -> Any:
    return where(on, 1.0, 0.0) * (m.w - m.v) + where(on, 0.0, 1.0) * m.f == 0.0


def _opposite(m: Pair, on: Any) -> Any:
    return where(~on, m.f, m.w + 2.0 * m.v) == 0.0


SWITCHES = ("time", "state", "boolean", "no_event")


@pytest.mark.parametrize("law", [_velocity, _position, _turned, _nested, _factors, _opposite])
def test_a_constraint_that_comes_and_goes_is_refused_in_either_mode(law: Law) -> None:
    """The number of states is four without, three or two with it: no one structure is right for both."""
    for switch, begins in itertools.product(SWITCHES, (False, True)):
        with pytest.raises(AcausalError) as caught:
            acausal.simulate(Pair(law=law, switch=switch, begins=begins), stop_time=1.0)
        assert caught.value.code == "AC213", (switch, begins)
        assert "the structure depends on the mode" in str(caught.value)
        assert "determines f" in str(caught.value)


def _spring(m: Pair, on: Any) -> Any:
    return m.f == where(on, 10.0 * (m.x + 1.0 - m.y), 0.0)


def _damper(m: Pair, on: Any) -> Any:
    return where(on, m.f - 3.0 * (m.v - m.w), m.f) == 0.0


def _held(m: Pair, on: Any) -> Any:
    """Accelerations, not velocities: the structure is that of a clutch."""
    return where(on, der(m.w) - der(m.v), m.f) == 0.0


@pytest.mark.parametrize("law", [_spring, _damper, _held])
def test_what_has_one_structure_runs_in_both_modes(law: Law) -> None:
    """Momentum 1*1 - 2*0.5 = 0 is kept by any force between the two; without a force so is each velocity."""
    for switch, begins in itertools.product(SWITCHES[:3], (False, True)):
        result = acausal.simulate(Pair(law=law, switch=switch, begins=begins), stop_time=1.0, tolerance=1e-8)
        momentum = result.final("v") + 2.0 * result.final("w")
        assert momentum == pytest.approx(0.0, abs=1e-7)
        if law is _held or not begins:
            assert result.at(0.3, "v") == pytest.approx(1.0, abs=1e-7)


class Shaft(Component):
    """Masses of 1 and 2 kg with a force between them, and positions or speeds in a ratio that the law says."""

    law: Callable[[Shaft], Any] = structural()
    a: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    b: Real = variable()
    w: Real = variable()
    f: Real = variable()
    gear: Real = discrete(default=1.0)
    low: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.a) == self.v
        yield der(self.b) == self.w
        yield der(self.v) == -self.f
        yield 2.0 * der(self.w) == self.f
        yield when(time > 0.5, reset(self.gear, 3.0), reset(self.low, True))
        yield self.law(self)


JUMPING: dict[str, Callable[[Shaft], Any]] = {
    "time": lambda m: m.w == where(time > 0.5, 2.0, 1.0) * m.v,
    "discrete": lambda m: m.w == m.gear * m.v,
    "boolean": lambda m: where(m.low, m.w - 2.0 * m.v, m.w - m.v) == 0.0,
    "kink": lambda m: m.b == where(m.a > 0.5, 2.0 * m.a - 0.5, m.a),
    "step": lambda m: m.b == m.a + where(m.a > 0.5, 0.3, 0.0),
}


@pytest.mark.parametrize(
    ("name", "solver"),
    [
        *((name, "idas") for name in JUMPING),
        *(("time", "rosenbrock"), ("kink", "rosenbrock"), ("step", "erk"), ("discrete", "erk")),
    ],
)
def test_a_constraint_that_changes_by_a_jump_is_refused_when_it_does(name: str, solver: str) -> None:
    """Without an impulse on the first mass, momentum would come from nothing: 1*1 + 2*1 becomes 1*1 + 2*2."""
    law = JUMPING[name]
    with fails_with(AcausalError, "AC507") as caught:
        acausal.simulate(Shaft(law=law), stop_time=1.0, solver=solver)
    assert "t = 0.5" in str(caught.value)
    before = acausal.simulate(Shaft(law=law), stop_time=0.4, solver=solver)
    assert before.final("w") == pytest.approx(1.0, abs=1e-6)


def test_a_constraint_that_changes_smoothly_runs() -> None:
    """b = a + s^2 where s = a - 1/2 > 0: from v + 2 w = 3 follows 3 s + 2 s^2 = 3 (t - 1/2)."""
    smooth = Shaft(law=lambda m: m.b == where(m.a > 0.5, m.a + (m.a - 0.5) ** 2, m.a))
    result = acausal.simulate(smooth, stop_time=1.0, tolerance=1e-9)
    assert result.final("a") == pytest.approx(0.5 + (21.0**0.5 - 3.0) / 4.0, abs=1e-8)


class Engaged(Component):
    """Two masses; a force between them is zero until a discrete factor makes its equation one of their speeds."""

    law: Callable[[Engaged], Any] = structural()
    v: Real = variable(default=fixed(1.0))
    w: Real = variable(default=fixed(0.0))
    f: Real = variable()
    k: Real = discrete(default=0.0)
    n: Real = integer()
    on: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.v) == -self.f
        yield 2.0 * der(self.w) == self.f
        yield when(time > 0.5, reset(self.k, 1.0), reset(self.on, True))
        yield self.n == where(time > 0.5, 1, 0)
        yield self.law(self)


@pytest.mark.parametrize(
    "law",
    [
        lambda m: m.k * (m.v - m.w) + (1 - m.k) * m.f == 0.0,
        lambda m: m.n * (m.v - 2.0 * m.w) + (1 - m.n) * m.f == 0.0,
        lambda m: (1 - m.k) * (m.f - 0.1) == m.k * m.v,
    ],
    ids=["discrete", "integer", "factor that vanishes"],
)
@pytest.mark.parametrize("form", ["torn", "dae"])
def test_a_factor_that_switches_a_constraint_on_is_refused(law: Callable[[Engaged], Any], form: str) -> None:
    """Up to there the force is known; then nothing says it: 1 - k is zero (it was "the start", with other guesses)."""
    compiled = acausal.compile(Engaged(law=law), formulation=form)
    assert acausal.simulate(compiled, stop_time=0.4).final("v") <= 1.0
    with fails_with(AcausalError, "AC507") as caught:
        acausal.simulate(compiled, stop_time=1.0)
    assert "says nothing about f after the event at t = 0.5 s" in str(caught.value)
    assert "start elsewhere" not in str(caught.value)


class Complementary(Component):
    """A mass on a string that pulls where it is taut, without a branch: force and slack are one zero, none negative."""

    law: Callable[[Any, Any], Any] = structural()
    x: Real = variable(default=fixed(0.3))
    y: Real = variable(default=fixed(-0.2))
    v: Real = variable(default=fixed(0.5))
    w: Real = variable(default=fixed(0.0))
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.y) == self.w
        yield der(self.v) == -self.f * self.x
        yield der(self.w) == -self.f * self.y - 9.81
        yield self.law(self.f, 1.0 - self.x**2 - self.y**2) == 0.0


@pytest.mark.parametrize(
    "law",
    [
        acausal.minimum,
        lambda f, slack: f - acausal.maximum(0.0, f - slack),
        lambda f, slack: f + slack - acausal.sqrt(f**2 + slack**2),
        lambda f, slack: f + slack - acausal.sqrt(f**2 + slack**2 + 1e-12),
    ],
    ids=["minimum", "maximum", "Fischer-Burmeister", "smoothed"],
)
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_string_that_becomes_taut_without_a_branch_is_named(law: Callable[[Any, Any], Any], solver: str) -> None:
    """Free fall until (0.3 + t/2)^2 + (0.2 + 4.905 t^2)^2 = 1, at t = 0.3708: states would go from there on."""
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(Complementary(law=law), stop_time=1.0, solver=solver)
    text = str(caught.value)
    assert caught.value.code == "AC402"
    assert "nothing determines f from there on: its equation holds x and y instead" in text
    assert "t = 0.3707" in text or "t = 0.3708" in text
    assert "reset(away, 0, by=pull)" in text
