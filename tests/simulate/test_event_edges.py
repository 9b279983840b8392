"""Events where a run has nothing to integrate, and where it ends."""

from __future__ import annotations

import math
from itertools import product

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fabs,
    fixed,
    initial,
    reset,
    sample,
    sqrt,
    structural,
    terminal,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.library.electrical import Ground, IdealDiode, Resistor, SineVoltage


class HalfWave(Component):
    """A diode between a source of 50 Hz and a resistor: no state at all."""

    source: SineVoltage = SineVoltage(V=10.0, f=50.0)
    diode: IdealDiode = IdealDiode()
    load: Resistor = Resistor(R=10.0)
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.diode.p)
        yield connect(self.diode.n, self.load.p)
        yield connect(self.load.n, self.source.n, self.ground.p)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_rectifier_without_states(solver: str) -> None:
    """The diode changes at every zero crossing of the source; its 1e-5 Ohm takes a millionth of the peak."""
    r = acausal.simulate(HalfWave(), stop_time=0.095, solver=solver)
    assert [e.time for e in r.events] == pytest.approx([0.01 * k for k in range(1, 10)], abs=1e-9)
    assert r.at(0.005, "load.v") == pytest.approx(10.0 / (1 + 1e-6), rel=1e-9)
    assert r["load.v"].min() > -1.1e-3  # the leakage of 1e-5 S


class Stairs(Component):
    """n counts samples, x is its integral."""

    n: Real = discrete()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.n
        yield when(sample(0.0, 0.25), reset(self.n, self.n + 1))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_a_sample_at_the_stop_time_acts(solver: str) -> None:
    """Five samples from 0 to 1; x = (1 + 2 + 3 + 4) / 4."""
    r = acausal.simulate(Stairs(), stop_time=1.0, solver=solver)
    assert r.final("n") == 5.0
    assert r.final("x") == pytest.approx(2.5, rel=1e-6)


class Ended(Component):
    """x' = 1, at an end when it is above 0.3, or at once."""

    x: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.3, terminate("high"))
        yield when(terminal(), reset(self.n, 5.0))


class EndedAtOnce(Ended):
    def equations(self) -> Equations:
        yield when(initial(), terminate("at once"))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_the_reason_of_an_end_is_kept_through_the_last_event(solver: str) -> None:
    r = acausal.simulate(Ended(), stop_time=1.0, solver=solver)
    assert r.stats["terminated"] == "high"
    assert (r.time[-1], r.final("n")) == (pytest.approx(0.3, abs=1e-9), 5.0)


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_an_end_at_the_start_has_a_row(solver: str) -> None:
    r = acausal.simulate(EndedAtOnce(), stop_time=1.0, solver=solver)
    assert r.stats["terminated"] == "at once"
    assert (r.time[0], r.time[-1], r.final("n")) == (0.0, 0.0, 5.0)


class Draining(Component):
    """h' = -sqrt(h) from 1: empty at 2 s, from where it sinks with 1 m/s on: h(5) = -3."""

    h: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.h) == where(self.h > 0.0, -sqrt(self.h), -1.0)


class Lying(Component):
    """The same tank that is empty from 2 s on and refilled from 3 s on; how long there is water in it."""

    h: Real = variable(default=fixed(1.0))
    wet: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == where(self.h > 0.0, -sqrt(self.h), 0.0) + where(time > 3.0, 0.3, 0.0)
        yield der(self.wet) == where(self.h > 0.0, 1.0, 0.0)


class Leaking(Component):
    """Empty at 2 s; below zero it would rise again, so that it is held at zero from then on."""

    h: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.h) == where(self.h > 0.0, -sqrt(self.h), 0.2)


@pytest.mark.parametrize(
    ("solver", "rows"),
    [
        ("erk", 500),
        pytest.param("erk", 3, marks=pytest.mark.slow),  # seven times as long
        *product(["rosenbrock", "idas", "cvodes"], [3, 500]),
    ],
)
def test_a_tank_that_runs_empty_is_empty(solver: str, rows: int) -> None:
    """The instant is known to the root of the tolerance. An explicit method ran along zero, just above it, for ever."""
    options = {"solver": solver, "tolerance": 1e-6, "stop_time": 5.0, "output_interval": 5.0 / rows}
    r = acausal.simulate(Draining(), **options)  # type: ignore[arg-type]
    assert r.final("h") == pytest.approx(-3.0, abs=2e-3)
    r = acausal.simulate(Lying(), **options)  # type: ignore[arg-type]
    assert r.final("wet") == pytest.approx(4.0, abs=2e-3)
    # h' = 0.3 - s with s the root: s + 0.3 ln(1 - s/0.3) = -t/2
    s = r.final("h") ** 0.5
    assert s + 0.3 * math.log(1 - s / 0.3) == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.parametrize("solver", ["erk", "rosenbrock", "idas", "cvodes"])
def test_what_is_held_at_zero_rests(solver: str) -> None:
    r = acausal.simulate(Leaking(), stop_time=5.0, solver=solver, tolerance=1e-6)
    assert r.at(2.5, "h") == pytest.approx(0.0, abs=1e-9)
    assert len(r.events) <= 2


class Tip(Component):
    """A push of integral one while x passes a tip of half the width w."""

    w: float = structural(default=1e-6)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(1.0 - fabs((self.x - 0.5) / self.w) > 0.0, 0.5 / self.w, 0.0)


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize(
    ("w", "solver"), [(1e-6, "rosenbrock"), (1e-6, "idas"), (3e-7, "erk"), (3e-7, "cvodes"), (3e-5, "rosenbrock")]
)
def test_an_excursion_within_the_error_of_its_relation_is_one(w: float, solver: str, native: bool) -> None:
    """By errors of 1e-5 of x it may as well be none; the solution itself has it, and interpreted runs passed it."""
    result = acausal.simulate(Tip(w=w), stop_time=1.0, tolerance=1e-6, solver=solver, native=native)
    assert result.final("y") == pytest.approx(1.0, abs=1e-3)
    assert [event.time for event in result.events] == pytest.approx([0.5 - w, 0.5 + w], abs=1e-8)
