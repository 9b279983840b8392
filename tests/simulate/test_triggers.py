"""Boolean variables that are true at instants only: what reads a trigger acts at each of its ticks."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    boolean,
    boolean_input,
    boolean_output,
    change,
    connect,
    der,
    discrete,
    edge,
    fixed,
    initial,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    structural,
    variable,
    when,
    where,
)
from acausal.export.step.step import step_function
from acausal.library.blocks import BooleanStep, SampleTrigger, Sine, TriggeredSampler, Xor
from tests.stepping import walk

RUNS = [("rosenbrock", False), ("rosenbrock", True), ("idas", False), ("erk", True)]


class Triggered(Component):
    """All that can be asked of a trigger."""

    trigger: Real = boolean()
    beginning: Real = boolean()
    edges: Real = integer()
    times: Real = integer()
    ends: Real = integer()
    changes: Real = integer()
    starts: Real = integer()
    x: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == where(self.trigger | self.beginning, 100.0, 1.0)
        yield self.trigger == sample(0.1, 0.1)
        yield self.beginning == initial()
        yield when(edge(self.trigger), reset(self.edges, pre(self.edges) + 1))
        yield when(self.trigger, reset(self.times, pre(self.times) + 1))
        yield when(~self.trigger, reset(self.ends, pre(self.ends) + 1))
        yield when(change(self.trigger), reset(self.changes, pre(self.changes) + 1))
        yield when(self.beginning, reset(self.starts, pre(self.starts) + 1))


EXPECTED = {"trigger": 0, "beginning": 0, "edges": 5, "times": 5, "ends": 5, "changes": 10, "starts": 0, "x": 0.55}


@pytest.mark.parametrize(("solver", "native"), RUNS)
def test_a_trigger_is_true_at_its_instants_only(solver: str, native: bool) -> None:
    """Five ticks in 0.55 s, each with two edges; the integral sees nothing of instants."""
    r = acausal.simulate(Triggered(), stop_time=0.55, solver=solver, native=native)
    assert {name: r.final(name) for name in EXPECTED} == pytest.approx(EXPECTED)


def test_a_trigger_in_exported_steps() -> None:
    names = list(EXPECTED)
    step = step_function(acausal.compile(Triggered()), 0.01, "rk4", names)
    found = walk(step, 55)
    assert {name: found[name][-1] for name in names} == pytest.approx(EXPECTED)
    assert not any(found[name][-1] for name in step.y.names[len(names) :])


class Ticking(Component):
    """A discrete equation that reads a tick, in a model that remembers nothing."""

    x: Real = variable(default=fixed(0.0))
    y: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == where(sample(0.0, 0.5), 1.0, 2.0)


def test_a_tick_in_exported_steps_that_remember_nothing() -> None:
    """Behind each tick y is 2 again."""
    step = step_function(acausal.compile(Ticking()), 0.25, "rk4", ["x", "y"])
    found = walk(step, 4)
    assert [found["x"][-1], found["y"][-1]] == pytest.approx([1.0, 2.0])


class Held(Component):
    """A sine, sampled by a trigger of the library."""

    sine: Sine = Sine(f=1.0)
    trigger: SampleTrigger = SampleTrigger(period=0.13, start_time=0.02)
    sampler: TriggeredSampler = TriggeredSampler()

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.sampler.u)
        yield connect(self.trigger.y, self.sampler.trigger)


def test_a_triggered_sampler_takes_every_sample() -> None:
    r = acausal.simulate(Held(), stop_time=2.0)
    for t in (0.01, 0.1, 0.5, 1.3, 1.99):
        last = 0.02 + 0.13 * np.floor((t - 0.02) / 0.13)
        expected = np.sin(2 * np.pi * last) if last > 0.0 else 0.0
        assert r.at(t, "sampler.y") == pytest.approx(expected, abs=1e-9)


class FlipFlop(Component):
    """It takes its input as it was before the clock."""

    d: Real = boolean_input()
    clock: Real = boolean_input()
    q: Real = boolean_output()

    def equations(self) -> Equations:
        yield when(edge(self.clock), reset(self.q, pre(self.d)))


class JohnsonCounter(Component):
    """A row of flip-flops behind one clock, the last one inverted into the first."""

    n: int = structural(default=3)
    row: list[FlipFlop] = part()
    clock: SampleTrigger = SampleTrigger(period=0.1, start_time=0.1)

    def build(self) -> None:
        self.row = [FlipFlop() for _ in range(self.n)]

    def equations(self) -> Equations:
        for left, right in zip(self.row, self.row[1:], strict=False):
            yield connect(left.q, right.d)
        for flip_flop in self.row:
            yield connect(self.clock.y, flip_flop.clock)
        yield self.row[0].d == ~self.row[-1].q


@pytest.mark.parametrize("ticks", [1, 2, 4, 6, 11])
def test_a_johnson_counter(ticks: int) -> None:
    row = [0, 0, 0]
    for _ in range(ticks):
        row = [1 - row[-1], *row[:-1]]
    r: Any = acausal.simulate(JohnsonCounter(), stop_time=0.1 * ticks + 0.05)
    assert [r.final(f"row[{k}].q") for k in range(3)] == row


class Dosed(Component):
    """A decay, multiplied by `a` at each tick of a trigger."""

    a: Real = parameter(default=1.3)
    trigger: Real = boolean()
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield self.trigger == sample(0.1, 0.1)
        yield when(self.trigger, reset(self.x, self.a * pre(self.x)))


def test_derivatives_see_every_tick() -> None:
    """x(0.55) = a^5 e^-0.55."""
    found = acausal.sensitivities(Dosed(), ["a"], ["x"], stop_time=0.55, tolerance=1e-9)
    assert np.asarray(found.final).ravel()[0] == pytest.approx(5 * 1.3**4 * np.exp(-0.55), rel=1e-6)


class Counter(Component):
    """Counts the edges of its input."""

    u: Real = boolean_input()
    n: Real = integer()

    def equations(self) -> Equations:
        yield when(edge(self.u), reset(self.n, pre(self.n) + 1))


class Coinciding(Component):
    """A step and a trigger at 1.75 s: exactly one of them is true from then on, but not at that instant."""

    step: BooleanStep = BooleanStep(start_time=1.75)
    trigger: SampleTrigger = SampleTrigger(period=1.0, start_time=1.75)
    either: Xor = Xor()
    counters: list[Counter] = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)

    def build(self) -> None:
        self.counters = [Counter() for _ in range(3)]

    def equations(self) -> Equations:
        yield connect(self.step.y, self.either.u1, self.counters[0].u)
        yield connect(self.trigger.y, self.either.u2, self.counters[1].u)
        yield connect(self.either.y, self.counters[2].u)


class CoincidingBesideAState(Coinciding):
    """The same with something to integrate."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x


COUNTS = [f"counters[{k}].n" for k in range(3)]


@pytest.mark.parametrize("model", [Coinciding, CoincidingBesideAState])
@pytest.mark.parametrize(("solver", "native"), RUNS)
def test_a_relation_of_time_and_a_tick_at_one_instant_are_seen_together(model: Any, solver: str, native: bool) -> None:
    """A step that came a round behind the tick would have let the other one become true twice."""
    r = acausal.simulate(model(), solver=solver, native=native)
    assert [r.final(name) for name in COUNTS] == [1, 1, 1]


def test_exported_steps_see_them_together() -> None:
    step = step_function(acausal.compile(CoincidingBesideAState()), 0.05, "rk4", COUNTS)
    found = walk(step, 40)
    assert [found[name][-1] for name in COUNTS] == [1, 1, 1]
