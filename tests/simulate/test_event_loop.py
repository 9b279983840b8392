"""Events passed in compiled code are those of the event iteration: the same instants, words, changes and values.

Expected values are those of closed forms where there is one, else of the interpreted run, which is tested against
closed forms in test_events.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    boolean,
    der,
    discrete,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    sample,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import EventError
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.clutches import ClutchChain, ThreeClutchDrive
from acausal.models.rectifier import BridgeRectifier, SCRBridge
from acausal.models.sampled_control import SampledSpeedControl
from acausal.models.switched_converter import BuckConverter
from acausal.simulate.driver import event_loop, loop_memory
from acausal.simulate.native import cache

pytestmark = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler on this machine")


class Wanderer(Component):
    """A point that a thermostat, a counter, a sampler and two walls act upon."""

    slow: Real = parameter(default=0.7, unit="1/s")
    x: Real = variable(default=fixed(0.3), unit="")
    v: Real = variable(default=fixed(1.0), unit="")
    held: Real = discrete(default=0.0, unit="")
    turns: Real = integer(default=0)
    on: Real = boolean(default=True)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == where(self.on, 1.0, -1.0) - 0.1 * self.slow * self.v + where(time < 2.0, 0.0, 0.2)
        yield self.on == ((self.x < -0.5) | (pre(self.on) & (self.x < 0.5)))
        yield when((self.x > 1.5) | (self.x < -1.5), reset(self.v, -0.8 * pre(self.v)))
        yield when(self.v < 0.0, reset(self.turns, pre(self.turns) + 1))
        yield when(sample(0.0, 0.25), reset(self.held, self.x))


class TickedOscillator(Component):
    """x = cos(t), which counts how often it exceeds a level, beside a clock that ends stretches."""

    level: Real = parameter(default=0.9, unit="")
    tick: Real = parameter(default=1.0, unit="s")
    x: Real = variable(default=fixed(1.0), unit="")
    v: Real = variable(default=fixed(0.0), unit="")
    passes: Real = integer(default=0)
    ticks: Real = integer(default=0)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield when(self.x > self.level, reset(self.passes, pre(self.passes) + 1))
        yield when(sample(0.0, self.tick), reset(self.ticks, pre(self.ticks) + 1))


class Ending(Component):
    """A clock that ends the run."""

    x: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.25, terminate("enough"))


class Breaking(Component):
    """A clock that must not pass 1."""

    x: Real = variable(default=fixed(0.0), unit="")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield assert_(self.x < 1.0, "x is too large")


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Libraries of these tests in a folder of their own, so that a changed event_loop.c is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACAUSAL_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> list[event_loop.LoopState | None]:
    """Where the calls of the compiled loop have come to."""
    found: list[event_loop.LoopState | None] = []
    plain = event_loop.EventLoop.go

    def noted(self: event_loop.EventLoop, *arguments: Any) -> event_loop.LoopState | None:
        found.append(plain(self, *arguments))
        return found[-1]

    monkeypatch.setattr(event_loop.EventLoop, "go", noted)
    return found


MODELS: list[tuple[Callable[[], Component], float]] = [
    (BouncingBall, 1.0),
    (BuckConverter, 5e-3),
    (SampledSpeedControl, 0.05),
    (ThreeClutchDrive, 2.0),
    (BridgeRectifier, 0.05),
    (SCRBridge, 0.05),
    (Wanderer, 6.0),
]


# Most models with one of the solvers; the others are slow.
QUICK = {
    *((model, "rosenbrock") for model in (BouncingBall, SampledSpeedControl, SCRBridge)),
    *((model, "erk") for model in (BuckConverter, Wanderer)),
}
PAIRS = [
    pytest.param(model, stop, solver, marks=() if (model, solver) in QUICK else pytest.mark.slow)
    for model, stop in MODELS
    for solver in ("rosenbrock", "erk")
    if (model, solver) != (SampledSpeedControl, "erk")  # a stiff plant, not one for an explicit method
]


@pytest.mark.parametrize(("model", "stop", "solver"), PAIRS)
def test_a_compiled_run_passes_the_events_of_an_interpreted_one(
    model: Callable[[], Component], stop: float, solver: str, passes: list[event_loop.LoopState | None]
) -> None:
    compiled = acausal.compile(model())
    runs = [
        acausal.simulate(compiled, stop_time=stop, output_interval=stop / 40, tolerance=1e-7, solver=solver, native=n)
        for n in (True, False)
    ]
    assert any(reached is not None for reached in passes)
    ours, theirs = runs
    assert [(e.condition, e.changed, e.component, e.where) for e in ours.events] == [
        (e.condition, e.changed, e.component, e.where) for e in theirs.events
    ]
    # a compiled stretch ends at its event, an interpreted one steps on: the next ones begin with other steps, and each
    # run may be off by the share of the tolerance that solvers get
    assert [e.time for e in ours.events] == pytest.approx([e.time for e in theirs.events], rel=1e-8, abs=2e-8 * stop)
    assert ours.time.shape == theirs.time.shape
    for name in compiled.states:
        scale = float(np.max(np.abs(theirs[name]))) + 1e-9
        assert np.max(np.abs(ours[name] - theirs[name])) <= 1e-6 * scale, name


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_short_stretches_between_ticks_lose_no_pass(solver: str, passes: list[event_loop.LoopState | None]) -> None:
    # a stretch of a small part of the run has a few mesh points only; the passes are at t = 2 pi k - acos(level)
    compiled, ticks = acausal.compile(TickedOscillator()), 100
    for level, periods in ((0.9, 0.37), (0.999, 0.81), (0.999, 2.3), (0.9999, 3.7)):
        tick = 2.0 * math.pi * periods
        stop = (ticks + 0.3) * tick
        given = {"level": level, "tick": tick}
        r = acausal.simulate(
            compiled, stop_time=stop, output_interval=stop, parameters=given, tolerance=1e-9, solver=solver, native=True
        )
        expected = math.floor((stop + math.acos(level)) / (2.0 * math.pi))
        assert r.final("passes") == expected, (level, periods)
        assert r.final("ticks") == ticks + 1
    assert all(reached is not None for reached in passes)


def test_a_short_stretch_takes_the_steps_that_its_states_need() -> None:
    # half a period of the converter, 50 us, is a fortieth of the period of coil and capacitor, 2 pi sqrt(L C) = 2 ms:
    # one step of a method of third order at 1e-5. Mesh points within a stretch ended five
    r = acausal.simulate(BuckConverter(), stop_time=0.01, tolerance=1e-5, solver="rosenbrock", native=True)
    assert len(r.events) == 200
    assert cast("float", r.stats["steps"]) < 4 * len(r.events)


def test_clutches_that_break_loose_and_stick_are_passed_in_one_call(passes: list[event_loop.LoopState | None]) -> None:
    # several guards are reached at once, and discrete states change that no impact has changed: both once made each
    # stretch one for Python, and the run ten times as long
    r = acausal.simulate(ClutchChain(n=3), stop_time=2.0, output_interval=2.0, solver="rosenbrock", native=True)
    assert len(r.events) > 6
    assert [reached is not None for reached in passes] == [True]
    # an integrator that is stopped goes no farther: standing still up to the next look took half of all steps
    assert cast("float", r.stats["steps"]) < 25 * len(r.events)


@pytest.mark.parametrize("points", [1, 100, 3000])
def test_bounces_do_not_depend_on_the_outputs(points: int) -> None:
    # free fall from 1 m: sqrt(2/g), then flights of 2*e**k*sqrt(2/g)
    stop = 1.5
    r = acausal.simulate(BouncingBall(), stop_time=stop, output_interval=stop / points, tolerance=1e-9, native=True)
    first, e = math.sqrt(2.0 / 9.81), 0.7  # the defaults of the model
    expected = [first, first * (1 + 2 * e), first * (1 + 2 * e + 2 * e**2)]
    assert [event.time for event in r.events] == pytest.approx([t for t in expected if t < stop], abs=1e-9)


def test_the_end_that_a_model_asks_for() -> None:
    r = acausal.simulate(Ending(), stop_time=1.0, solver="rosenbrock", native=True)
    assert r.stats["terminated"] == "enough"
    assert r.time[-1] == pytest.approx(0.25, abs=1e-9)


def test_an_assertion_ends_the_run_with_its_words() -> None:
    with pytest.raises(EventError, match="x is too large") as caught:
        acausal.simulate(Breaking(), stop_time=2.0, solver="rosenbrock", native=True)
    assert caught.value.result is not None
    assert caught.value.result.time[-1] == pytest.approx(1.0, abs=1e-6)


def test_a_record_that_is_full_is_emptied(
    monkeypatch: pytest.MonkeyPatch, passes: list[event_loop.LoopState | None]
) -> None:
    monkeypatch.setattr(loop_memory, "MOST_EVENTS", 7)
    compiled = acausal.compile(Wanderer())
    few = acausal.simulate(compiled, stop_time=20.0, solver="rosenbrock", tolerance=1e-8, native=True)
    assert sum(reached is not None for reached in passes) > 10
    monkeypatch.undo()
    many = acausal.simulate(compiled, stop_time=20.0, solver="rosenbrock", tolerance=1e-8, native=True)
    assert [e.time for e in few.events] == [e.time for e in many.events]
    assert np.array_equal(few["x"], many["x"])


def test_the_source_is_part_of_the_package() -> None:
    assert (Path(event_loop.__file__).parents[1] / "native" / "event_loop.c").is_file()
