"""Logic, relays, samplers and sources at work: every expected value is the definition of the block, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, boolean, connect, part, time
from acausal.library import blocks


class Board(Component):
    """A sine of 1 Hz and a row of pulses, through every kind of hybrid block."""

    sine: blocks.Sine = blocks.Sine(f=1.0)
    pulse: blocks.BooleanPulse = blocks.BooleanPulse(period=0.3, width=0.25, start_time=0.1)
    table: blocks.BooleanTable = blocks.BooleanTable(table=(0.2, 0.45, 0.9))
    switch: blocks.Switch = blocks.Switch(u1=1.0, u3=-2.0)
    hysteresis: blocks.Hysteresis = blocks.Hysteresis(u_low=-0.5, u_high=0.5)
    controller: blocks.OnOffController = blocks.OnOffController(bandwidth=0.4, reference=0.3)
    flip_flop: blocks.RSFlipFlop = blocks.RSFlipFlop()
    triggered: blocks.TriggeredSampler = blocks.TriggeredSampler()
    delay: blocks.UnitDelay = blocks.UnitDelay(sample_period=0.1, y_start=5.0)
    hold: blocks.ZeroOrderHold = blocks.ZeroOrderHold(sample_period=0.1)
    first_order: blocks.FirstOrderHold = blocks.FirstOrderHold(sample_period=0.1)
    noise: blocks.UniformNoise = blocks.UniformNoise(sample_period=0.05, seed=3)
    normal: blocks.NormalNoise = blocks.NormalNoise(sample_period=0.05, seed=3, mu=1.0, sigma=2.0)
    relay: blocks.Relay = blocks.Relay(u_low=-0.2, u_high=0.2, y_on=3.0)
    dead_zone: blocks.DeadZone = blocks.DeadZone(u_max=0.5)

    def equations(self) -> Equations:
        yield connect(self.pulse.y, self.switch.u2, self.triggered.trigger, self.flip_flop.S)
        yield connect(self.table.y, self.flip_flop.R)
        yield connect(
            self.sine.y,
            self.hysteresis.u,
            self.controller.u,
            self.triggered.u,
            self.delay.u,
            self.hold.u,
            self.first_order.u,
            self.relay.u,
            self.dead_zone.u,
        )


@pytest.fixture(scope="module", params=["rosenbrock", "idas"])
def run(request: pytest.FixtureRequest) -> acausal.Result:
    return acausal.simulate(Board(), stop_time=1.0, tolerance=1e-8, output_interval=0.01, solver=request.param)


def changes(r: acausal.Result, name: str) -> list[float]:
    """Instants at which a piecewise constant signal changes."""
    return [float(t) for t in r.time[1:][np.abs(np.diff(r[name])) > 0.5]]


def level(angle: float) -> float:
    """When a sine of 1 Hz reaches sin(angle) on its first way up."""
    return angle / (2.0 * math.pi)


def test_pulses_and_tables_change_exactly_when_they_say(run: acausal.Result) -> None:
    assert changes(run, "pulse.y") == pytest.approx([0.1, 0.175, 0.4, 0.475, 0.7, 0.775, 1.0], abs=1e-14)
    assert changes(run, "table.y") == pytest.approx([0.2, 0.45, 0.9], abs=1e-14)
    assert set(np.unique(run["switch.y"])) == {1.0, -2.0}
    assert changes(run, "switch.y") == changes(run, "pulse.y")


def test_relays_switch_at_the_ends_of_their_bands(run: acausal.Result) -> None:
    """sin(2 pi t) above 0.5 from 1/12 s, below -0.5 from 7/12 s; the relay at 0.2 and -0.2; the controller between."""
    assert changes(run, "hysteresis.y") == pytest.approx([1.0 / 12.0, 7.0 / 12.0], abs=1e-7)
    a = math.asin(0.2)
    assert changes(run, "relay.y") == pytest.approx([level(a), 0.5 + level(a)], abs=1e-7)
    assert run["relay.y"].max() == 3.0
    on, off = level(math.asin(0.1)), level(math.asin(0.5))
    assert changes(run, "controller.y") == pytest.approx([off, 0.5 - on], abs=1e-7)


def test_the_flip_flop_keeps_what_it_was_told_last(run: acausal.Result) -> None:
    """Set at 0.1; reset at 0.2; at 0.4 both are true: it stays reset, until the reset ends while it is set at 0.45."""
    assert changes(run, "flip_flop.Q") == pytest.approx([0.1, 0.2, 0.45, 0.9], abs=1e-14)
    np.testing.assert_array_equal(run["flip_flop.Q"] + run["flip_flop.QI"], 1.0)


@pytest.mark.parametrize("t", [0.031, 0.149, 0.352, 0.777])
def test_samplers_hold_their_samples(run: acausal.Result, t: float) -> None:
    def u(at: float) -> float:
        return math.sin(2.0 * math.pi * at)

    k = math.floor(t / 0.1)
    last = k * 0.1
    before = max((p for p in (0.1, 0.4, 0.7) if p <= t), default=None)
    assert run.at(t, "hold.y") == pytest.approx(u(last), abs=1e-9)
    assert run.at(t, "delay.y") == pytest.approx(u(last - 0.1) if k else 5.0, abs=1e-9)
    assert run.at(t, "triggered.y") == pytest.approx(0.0 if before is None else u(before), abs=1e-9)
    slope = (u(last) - u(last - 0.1)) / 0.1 if k else 0.0
    assert run.at(t, "first_order.y") == pytest.approx(u(last) + slope * (t - last), abs=1e-9)
    assert run.at(t, "dead_zone.y") == pytest.approx(math.copysign(max(abs(u(t)) - 0.5, 0.0), u(t)), abs=1e-9)


def test_noise_is_the_same_in_every_run_and_in_its_range(run: acausal.Result) -> None:
    """Twenty draws; the last of seed 3, one by one in whole numbers (`test_noise.py` has the generator)."""
    from acausal.library.blocks.noise import _first_state

    state = int(_first_state(3))
    for _ in range(20):
        state = 16807 * state % (2**31 - 1)
    assert run.at(0.975, "noise.y") == pytest.approx(state / (2**31 - 1), abs=1e-12)
    assert len(np.unique(run["noise.y"])) == 21  # and one more at the stop time
    assert 0.0 < run["noise.y"].min() < run["noise.y"].max() < 1.0
    assert abs(run["normal.y"].mean() - 1.0) < 1.5


class Begun(Component):
    """Blocks with a memory of time, behind a sine of 1 Hz."""

    sine: blocks.Sine = blocks.Sine(f=1.0, phase=1.0, start_time=-10.0)
    pulse: blocks.Pulse = blocks.Pulse(period=0.7, width=0.5, start_time=-0.2)
    mean: blocks.Mean = blocks.Mean(f=0.8)
    hold: blocks.FirstOrderHold = blocks.FirstOrderHold(sample_period=0.1)

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.mean.u, self.hold.u)


@pytest.mark.parametrize("begin", [0.0, 1.37, 1.65, -2.6])
def test_a_run_may_begin_at_any_time(begin: float) -> None:
    """Within a pulse or between two, within a period, between two ticks: nothing is made up of what was not seen."""
    found = acausal.simulate(Begun(), start_time=begin, stop_time=begin + 5.0, output_interval=0.05)
    t = begin + 0.025 + np.arange(90) * 0.05  # at no edge
    assert found.at(t, "pulse.y") == pytest.approx(((t >= -0.2) & (((t + 0.2) % 0.7) < 0.35)).astype(float))
    # periods count from the start of the run, as in Modelica.Blocks.Math
    ends = begin + np.floor((t - begin) / 1.25) * 1.25
    integral = (np.cos(2.0 * math.pi * (ends - 1.25) + 1.0) - np.cos(2.0 * math.pi * ends + 1.0)) / (2.0 * math.pi)
    assert found.at(t, "mean.y") == pytest.approx(np.where(ends - 1.25 >= begin - 1e-9, 0.8 * integral, 0.0), abs=1e-5)
    tick = np.floor(t / 0.1 + 1e-9) * 0.1
    last, before = np.sin(2.0 * math.pi * tick + 1.0), np.sin(2.0 * math.pi * (tick - 0.1) + 1.0)
    slope = np.where(tick - 0.1 >= max(begin, 0.0) - 1e-9, (last - before) / 0.1, 0.0)
    seen = tick >= max(begin, 0.0) - 1e-9
    assert np.asarray(found.at(t, "hold.y"))[seen] == pytest.approx((last + slope * (t - tick))[seen], abs=1e-6)


class Triggered(Component):
    """A sampler of 7 + t behind a source that is true when the run begins."""

    source: Component = part()
    sampler: blocks.TriggeredSampler = blocks.TriggeredSampler(y_start=-5.0, u=7.0 + time)
    y: Real = boolean()

    def equations(self) -> Equations:
        row = isinstance(self.source, blocks.Pulse)
        yield self.y == ((self.source.y > 0.5) if row else self.source.y)  # type: ignore[attr-defined]
        yield self.sampler.trigger == self.y


@pytest.mark.parametrize(
    "source",
    [
        blocks.BooleanPulse(period=0.6),
        blocks.BooleanPulse(period=0.6, start_time=-0.6),
        blocks.BooleanTable(table=(0.0, 0.3, 0.6, 0.9)),
        blocks.Pulse(period=0.6),
        blocks.Pulse(period=0.6, nperiod=3),
    ],
)
def test_what_is_true_from_the_start_does_not_become_true(source: Component) -> None:
    """One signal, written in five ways: it rises at 0.6 s only, as in Modelica."""
    r = acausal.simulate(Triggered(source=source), stop_time=1.0, output_interval=0.25)
    np.testing.assert_allclose(r.at([0.1, 0.5, 0.7, 1.0], "sampler.y"), [-5.0, -5.0, 7.6, 7.6])
