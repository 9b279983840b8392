"""Assertions without an event of their own, limits of variables, and what discrete equations may read."""

from __future__ import annotations

import math
from typing import Any

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
    change,
    cos,
    der,
    discrete,
    edge,
    fixed,
    floor,
    initial,
    integer,
    no_event,
    pre,
    quantity,
    reset,
    sample,
    structural,
    terminal,
    time,
    variable,
    when,
    where,
)
from acausal.errors import EventError


class Swing(Component):
    """x = sin(t)."""

    x: Real = variable(default=fixed(0.0))
    warning: bool = structural(default=False)

    def condition(self) -> Expr | None:
        return None

    def equations(self) -> Equations:
        yield der(self.x) == cos(time)
        condition = self.condition()
        if condition is not None:
            yield assert_(condition, "too far", level="warning" if self.warning else "error")


class Unlocated(Swing):
    def condition(self) -> Expr:
        return no_event(self.x < 0.5)


class Hidden(Swing):
    """The same below a variable."""

    y: Real = variable()

    def condition(self) -> Expr:
        return no_event(self.y < 0.5)

    def equations(self) -> Equations:
        yield self.y == where(self.x > 0.0, self.x, 0.0, smooth=True)


class Joined(Swing):
    def condition(self) -> Expr:
        return (self.x < 0.1) | no_event(self.x < 0.5)


@pytest.mark.parametrize("model", [Unlocated, Hidden, Joined])
@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "erk", "rk2"])
def test_an_assertion_below_no_event_holds_in_all_rows(model: type[Swing], solver: str) -> None:
    """sin(t) passes 0.5 at pi/6; the run ends at the first row behind it."""
    with pytest.raises(EventError) as caught:
        acausal.simulate(model(), stop_time=1.0, output_interval=0.01, solver=solver, **_step(solver))
    assert caught.value.code == "AC503"
    assert "t = 0.53 s: too far" in str(caught.value)
    assert caught.value.result is not None
    assert float(caught.value.result.time[-1]) <= 0.53


def _step(solver: str) -> dict[str, Any]:
    return {"step": 0.01} if solver == "rk2" else {}


def test_a_warning_below_no_event_is_noted_once() -> None:
    stats: Any = acausal.simulate(Unlocated(warning=True), stop_time=1.0, output_interval=0.01).stats
    assert [n for n in stats["notes"] if "too far" in n] == ["t = 0.53 s: too far"]


class AtStart(Swing):
    def condition(self) -> Expr:
        return ~initial() | (self.x < 0.5)


class AtStartInside(AtStart):
    """It does not hold at the start, where x = 0."""

    def condition(self) -> Expr:
        return ~initial() | (self.x > 0.5)


class AtEnd(Swing):
    def condition(self) -> Expr:
        return ~terminal() | (self.x < 0.5)


class AtTicks(Swing):
    def condition(self) -> Expr:
        return ~sample(0.0, 0.3) | (self.x < 0.5)


@pytest.mark.parametrize(("model", "when_"), [(AtStartInside, "0"), (AtEnd, "1"), (AtTicks, "0.6")])
def test_assertions_on_instants_are_checked_there(model: type[Swing], when_: str) -> None:
    """sin(0.3) < 1/2 < sin(0.6)."""
    with pytest.raises(EventError, match=f"t = {when_} s: too far"):
        acausal.simulate(model(), stop_time=1.0)


def test_an_assertion_on_the_start_changes_no_run() -> None:
    """It makes no event, so that solver and accuracy are those of the model without it."""
    plain, asserted = (acausal.simulate(m(), stop_time=1.0) for m in (Swing, AtStart))
    assert asserted.stats["solver"] == plain.stats["solver"]
    assert asserted.stats["reason"] == plain.stats["reason"]
    assert len(asserted.events) == 0
    np.testing.assert_array_equal(asserted["x"], plain["x"])


class Discrete(Swing):
    """Values that change at events only, though they are made of what varies."""

    held: Real = discrete(default=0.0)
    ticks: Real = discrete(default=0.0)
    steps: Real = integer()
    at_step: Real = discrete(default=0.0)
    beyond: Real = boolean()

    def equations(self) -> Equations:
        yield self.held == where(edge(self.x > 0.5), time, pre(self.held))
        yield self.ticks == where(sample(0.0, 0.4), self.x, pre(self.ticks))
        yield self.steps == floor(self.x * 5.0)
        yield self.at_step == where(change(self.steps), self.x, pre(self.at_step))
        yield when(edge(self.x > 0.5) & no_event(time > 0.4), reset(self.beyond, True))


def test_discrete_equations_take_what_varies_at_instants() -> None:
    """Closed forms: asin(1/2), sin(0.8), and 4/5, the last fifth below sin(1)."""
    r = acausal.simulate(Discrete(), stop_time=1.0, tolerance=1e-9)
    assert float(r.final("held")) == pytest.approx(math.pi / 6.0, abs=1e-7)
    assert float(r.final("ticks")) == pytest.approx(math.sin(0.8), abs=1e-7)
    assert float(r.final("at_step")) == pytest.approx(0.8, abs=1e-7)
    assert float(r.final("beyond")) == 1.0


class Limited(Swing):
    """x, twice it, and an approach to a limit, which errors of the run pass."""

    z: Real = variable(max=0.5)
    y: Real = variable(shape=2, min=-1.0, unit="m")
    near: Real = variable(default=fixed(1.0), min=0.0)

    def equations(self) -> Equations:
        yield self.z == self.x
        yield self.y == (quantity(2.0, "m") * self.x, quantity(-2.0, "m") * self.x)
        yield der(self.near) == -50.0 * self.near


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_variables_beyond_their_limits_are_noted(solver: str) -> None:
    """sin(t) passes 1/2 at pi/6 = 0.5236; exp(-50 t) does not pass zero."""
    stats: Any = acausal.simulate(Limited(), stop_time=1.0, output_interval=0.01, solver=solver).stats
    (note,) = (n for n in stats["notes"] if n.startswith("beyond limits"))
    assert "z (0.50553 at t = 0.53 s, declared with max = 0.5)" in note
    assert "y[1] (-1.0111 at t = 0.53 s, declared with min = -1)" in note
    assert "y[0]" not in note
    assert "near" not in note
