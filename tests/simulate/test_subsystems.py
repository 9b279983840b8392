"""Systems of one model that share no equation, each with its own steps: against each of them alone.

The law: what is put side by side behaves as it does alone, whatever the others do, with every solver.
"""

from __future__ import annotations

import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    Result,
    assert_,
    der,
    discrete,
    fixed,
    parameter,
    part,
    pre,
    reset,
    sample,
    sin,
    structural,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import EventError
from acausal.lower.subsystems.split import subsystems
from tests.marks import slow_but

G = 9.81


class Ball(Component):
    """Bounces on a floor and counts."""

    e: Real = parameter(default=0.8, unit="1")
    height: Real = parameter(default=1.0, unit="m")
    lowest: Real = parameter(default=-1.0, unit="m")
    h: Real = variable(unit="m")
    v: Real = variable(unit="m/s", default=fixed(0.0))
    n: Real = discrete()

    def initial_equations(self) -> Equations:
        yield self.h == self.height

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -G
        yield when(self.h < 0, reset(self.v, -self.e * pre(self.v)), reset(self.n, self.n + 1))
        yield assert_(self.h > self.lowest, "the ball is too low")


class Thermostat(Component):
    """Heats below 19, until 21; what is outside swings with time."""

    tau: Real = parameter(default=0.3, unit="s")
    T: Real = variable(default=fixed(15.0))
    on: Real = discrete(default=fixed(1.0))

    def equations(self) -> Equations:
        yield self.tau * der(self.T) == 10.0 + sin(3.0 * time) + 20.0 * self.on - self.T
        yield when(self.T > 21.0, reset(self.on, 0.0))
        yield when(self.T < 19.0, reset(self.on, 1.0))


class Sampled(Component):
    """An integrator whose input is held between the ticks of a clock, driven by a pulse."""

    every: Real = parameter(default=0.13, unit="s")
    x: Real = variable(default=fixed(0.0))
    u: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == self.u - self.x + where(time > 0.7, 1.0, 0.0)
        yield when(sample(0.05, self.every), reset(self.u, 1.0 - self.x))
        yield when(self.x > 0.6, reset(self.u, 0.0))


class Relay(Component):
    """Slides on its switching line after it has come to it."""

    gain: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(0.5))

    def equations(self) -> Equations:
        yield der(self.x) == 0.4 * sin(5.0 * time) - self.gain * where(self.x > 0, 1.0, -1.0)


KINDS: dict[str, type[Component]] = {k.__name__: k for k in (Ball, Thermostat, Sampled, Relay)}
MEMBERS: tuple[tuple[str, dict[str, float]], ...] = (
    ("Ball", {}),
    ("Ball", {"e": 0.7, "height": 0.4}),
    ("Thermostat", {}),
    ("Thermostat", {"tau": 0.2}),
    ("Sampled", {}),
    ("Sampled", {"every": 0.21}),
    ("Relay", {}),
    ("Ball", {"e": 0.6, "height": 0.31}),
    ("Relay", {"gain": 3.0}),
)
SIGNALS = {"Ball": ("h", "v", "n"), "Thermostat": ("T", "on"), "Sampled": ("x", "u"), "Relay": ("x",)}


class Together(Component):
    """All of them, and what is observed of all of them."""

    members: tuple[tuple[str, dict[str, float]], ...] = structural(default=MEMBERS)
    parts: list[Any] = part()
    total: Real = variable()

    def build(self) -> None:
        self.parts = [KINDS[kind](**given) for kind, given in self.members]

    def equations(self) -> Equations:
        yield self.total == sum(
            getattr(p, SIGNALS[kind][0]) for p, (kind, _) in zip(self.parts, self.members, strict=True)
        )


RUN: dict[str, Any] = {"stop_time": 1.3, "tolerance": 1e-8, "output_interval": 0.05}


@cache
def alone(kind: str, given: tuple[tuple[str, float], ...]) -> Result:
    return acausal.simulate(KINDS[kind](**dict(given)), solver="rosenbrock", native=False, **RUN)


@pytest.mark.parametrize("solver", slow_but(["auto", "idas", "cvodes", "erk"], "auto"))
def test_side_by_side_as_alone(solver: str) -> None:
    """Values at outputs and at every event, and the number of events."""
    run = acausal.simulate(Together(), solver=solver, native=False, **RUN)
    assert run.stats["subsystems"] == len(MEMBERS)
    times, total = np.unique(run.time), np.zeros(len(run.time))
    for k, (kind, given) in enumerate(MEMBERS):
        expected = alone(kind, tuple(given.items()))
        for name in SIGNALS[kind]:
            found = run[f"parts[{k}].{name}"]
            assert found[-1] == pytest.approx(expected.final(name), abs=2e-6), (k, name)
            # away from own events, where a row of the one is on the other side in the other
            own = np.unique(expected.time[:-1][np.diff(expected.time) == 0.0])
            far = np.min(np.abs(times[:, None] - own), axis=1, initial=1.0) > 1e-5
            last = found[np.searchsorted(run.time, times, side="right") - 1]
            assert np.allclose(last[far], expected.at(times[far], name), atol=1e-5), (k, name)
        total = total + run[f"parts[{k}].{SIGNALS[kind][0]}"]
    assert np.allclose(run["total"], total, atol=1e-12)
    for k, (kind, given) in enumerate(MEMBERS):
        events = [e.time for e in run.events if f"parts[{k}]." in e.condition]
        known = alone(kind, tuple(given.items())).events
        assert events == pytest.approx([e.time for e in known if not e.condition.startswith("time")], abs=1e-6), k


BALLS = tuple(("Ball", {"height": h}) for h in (0.2, 0.5, 0.7, 0.9, 1.1))


def falls(height: float) -> float:
    """Duration of the fall [s]."""
    return float(np.sqrt(2.0 * height / G))


def test_equal_systems_share_their_functions() -> None:
    """Whatever their heights and coefficients are; parameters of a run are those of each."""
    model = acausal.compile(Together(members=BALLS))
    assert len({id(s.model.common) for s in subsystems(model)}) == 1
    for copy in (model, pickle.loads(pickle.dumps(model))):
        for e in (0.8, 0.5):
            run = acausal.simulate(copy, stop_time=0.6, tolerance=1e-8, parameters={"parts[2].e": e})
            assert run.stats["subsystems"] == len(BALLS)
            fall = falls(0.7)
            assert run.final("parts[2].v") == pytest.approx(e * G * fall - G * (0.6 - fall), abs=1e-6)
            assert run.final("parts[4].v") == pytest.approx(0.8 * G * falls(1.1) - G * (0.6 - falls(1.1)), abs=1e-6)


def test_progress_changes_nothing() -> None:
    """A run that reports is passed in parts."""
    told: list[float] = []
    runs = [
        acausal.simulate(Together(members=BALLS), stop_time=0.6, tolerance=1e-8, progress=progress)
        for progress in (None, lambda share, t: told.append(t))
    ]
    assert len(told) >= 20
    for k in range(len(BALLS)):
        assert runs[1].final(f"parts[{k}].h") == pytest.approx(runs[0].final(f"parts[{k}].h"), abs=1e-7)
    assert [e.time for e in runs[1].events] == pytest.approx([e.time for e in runs[0].events], abs=1e-8)
    assert len(runs[1].time) == len(runs[0].time)


def test_between_rows() -> None:
    """Values at any time, also where another system has an event between two rows."""
    run = acausal.simulate(Together(members=BALLS), stop_time=0.6, tolerance=1e-8, output_interval=0.2)
    times = np.linspace(0.01, 0.59, 30)
    for k, h in enumerate((0.2, 0.5, 0.7, 0.9, 1.1)):
        since = times - falls(h)
        expected = np.where(since < 0, h - G * times**2 / 2, 0.8 * G * falls(h) * since - G * since**2 / 2)
        one = since < 0.8 * 2 * falls(h)  # until the second bounce
        found = np.asarray(run.at(times, f"parts[{k}].h"))
        np.testing.assert_allclose(found[one], expected[one], atol=1e-6)


class Ending(Together):
    """The run ends when the last ball has touched; that of one ball is no matter of the others."""

    level: Real = parameter(default=0.0)

    def equations(self) -> Equations:
        yield when(self.parts[3].h < self.level, terminate("landed"))


def test_one_ends_the_run_of_all() -> None:
    run = acausal.simulate(Ending(members=BALLS), stop_time=1.0, tolerance=1e-8)
    assert run.stats["terminated"] == "landed"
    assert run.time[-1] == pytest.approx(falls(0.9), abs=1e-7)
    fall, stop = falls(0.5), falls(0.9)
    assert run.final("parts[1].v") == pytest.approx(0.8 * G * fall - G * (stop - fall), abs=1e-6)


def test_a_broken_assertion_is_told_of_its_place() -> None:
    """With what was computed up to there of all."""
    members = (*BALLS[:3], ("Ball", {"height": 2.0, "lowest": 1.0}), BALLS[4])
    with pytest.raises(EventError, match="too low") as found:
        acausal.simulate(Together(members=members), stop_time=1.0, tolerance=1e-8)
    assert "parts[3]" in str(found.value)
    run = found.value.result
    assert run is not None
    assert run.time[-1] == pytest.approx(falls(1.0), abs=1e-6)
    assert run.final("parts[1].v") == pytest.approx(0.8 * G * falls(0.5) - G * (run.time[-1] - falls(0.5)), abs=1e-5)


def test_notes_of_what_was_thrown_away_are_none() -> None:
    """A relay comes to its switching line at 0.3 s; a ball falls by 0.1 m before, and ends the run."""
    members = (("Relay", {}), *BALLS[1:4], ("Ball", {"height": 2.0, "lowest": 1.9}))
    with pytest.raises(EventError, match="too low") as found:
        acausal.simulate(Together(members=members), stop_time=1.0, tolerance=1e-8)
    run = found.value.result
    assert run is not None
    assert run.stats["subsystems"] == len(members)
    assert run.time[-1] == pytest.approx(falls(0.1), abs=1e-6)
    assert run.stats["notes"] == ()


class Passed(Together):
    """A clause that reads two systems makes them one."""

    overtaken: Real = discrete()

    def equations(self) -> Equations:
        yield when(self.parts[0].h > self.parts[4].h, reset(self.overtaken, self.overtaken + 1))


def test_a_clause_over_two_joins_them() -> None:
    members = (*BALLS, BALLS[1])
    model = acausal.compile(Passed(members=members))
    assert sorted(len(s.states) for s in subsystems(model)) == [3, 3, 3, 3, 7]
    run = acausal.simulate(model, stop_time=0.8, tolerance=1e-8)
    upward = np.diff((run["parts[0].h"] > run["parts[4].h"]).astype(int)) > 0
    assert run.final("overtaken") == np.count_nonzero(upward)


def test_what_is_driven_by_an_input_is_driven_apart() -> None:
    """One input of the whole acts on each."""

    class Driven(Component):
        u: Real = acausal.signal_input()
        parts: list[Lag] = part()

        def build(self) -> None:
            self.parts = [Lag(tau=0.1 * (k + 1)) for k in range(5)]

        def equations(self) -> Equations:
            for p in self.parts:
                yield p.u == self.u

    run = acausal.simulate(Driven(), inputs={"u": 2.0}, stop_time=0.5, tolerance=1e-8)
    assert run.stats["subsystems"] == 5
    for k in range(5):
        tau = 0.1 * (k + 1)
        reached = tau * np.log(2.0)  # where x = 1, from which on it relaxes to 1.5
        x = 2.0 - 2.0 * np.exp(-0.5 / tau) if reached > 0.5 else 1.5 - 0.5 * np.exp(-(0.5 - reached) / tau)
        assert run.final(f"parts[{k}].x") == pytest.approx(x, abs=1e-7)


class Lag(Component):
    """Follows its input, less so above 1."""

    tau: Real = parameter(default=1.0, unit="s")
    u: Real = variable()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.tau * der(self.x) == self.u - self.x - where(self.x > 1.0, 0.5, 0.0)
