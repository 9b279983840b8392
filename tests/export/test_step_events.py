"""Steps of models with events: impacts, clocks, friction, switches, in expressions and in C."""

from __future__ import annotations

import math
import re
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    assert_,
    connect,
    delay,
    der,
    discrete,
    fabs,
    fixed,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    signal_input,
    sin,
    terminate,
    time,
    variable,
    when,
    where,
)
from acausal.errors import ExportError, UsageError
from acausal.export.step.real_time import real_time
from acausal.export.step.source import StepFunction
from acausal.export.step.step import step_function
from acausal.library.blocks import Constant
from acausal.library.rotational import Clutch, Inertia
from acausal.models.bouncing_ball import BouncingBall
from acausal.models.drilling_dynamic import ThickBlock
from acausal.simulate.native import cache
from tests.expected import fails_with
from tests.stepping import walk

Vector = NDArray[np.float64]
needs_compiler = pytest.mark.skipif(cache.compiler() is None, reason="no C compiler")


def steps(step: StepFunction, count: int, u: tuple[float, ...] = ()) -> Vector:
    """x after each step, the start first."""
    found = walk(step, count, u)
    return np.vstack([step.x.start, np.column_stack([found[name] for name in step.x.names])])


def flight(t: float, e: float = 0.7, g: float = 9.81, h0: float = 1.0) -> tuple[float, float, int]:
    """Height, velocity and bounces of a ball dropped from rest: parabolas, each a factor `e` shorter."""
    v, start, count = math.sqrt(2 * g * h0), math.sqrt(2 * h0 / g), 0
    if t < start:
        return h0 - g * t * t / 2, -g * t, 0
    while count < 200:
        v, count = e * v, count + 1
        if t < start + 2 * v / g:
            return v * (t - start) - g * (t - start) ** 2 / 2, v - g * (t - start), count
        start += 2 * v / g
    return 0.0, 0.0, count


@pytest.mark.parametrize("h", [4e-3, 2e-3, 1e-3])
def test_a_ball_bounces_as_its_parabolas_say_and_comes_to_rest(h: float) -> None:
    step = step_function(acausal.compile(BouncingBall()), h, "rk4", [])
    assert step.x.names == ("h", "v", "bounces", "pre(bounces)", "h < 0")
    rows = steps(step, round(3.0 / h))
    for k, row in enumerate(rows):
        height, speed, bounces = flight(k * h)
        if bounces <= 8:  # flights longer than several steps
            assert row[0] == pytest.approx(height, abs=1e-9)
            assert row[1] == pytest.approx(speed, abs=1e-7)
            assert row[2] == bounces
    # the last bounce is at 2.56 s; those closer together than a step are not told apart
    np.testing.assert_allclose(rows[round(2.6 / h) :, :2], 0.0, atol=1e-12)
    assert rows[-1, 2] == rows[round(2.6 / h), 2] >= 15


class Pair(Component):
    """Two balls that fall from nearly the same height: both reach the floor within one step of 20 ms."""

    a: Real = variable(default=fixed(1.0), unit="m")
    b: Real = variable(default=fixed(0.99), unit="m")
    va: Real = variable(default=fixed(0.0), unit="m/s")
    vb: Real = variable(default=fixed(0.0), unit="m/s")

    def equations(self) -> Equations:
        for s, v in ((self.a, self.va), (self.b, self.vb)):
            yield der(s) == v
            yield der(v) == -9.81
            yield when(s < 0.0, reset(v, -0.5 * v))


def test_a_second_event_in_a_step_is_taken_at_its_end() -> None:
    # an error of the order of the step, no more; and neither ball falls through
    rows = steps(step_function(acausal.compile(Pair()), 0.02, "rk4", []), 100)
    for k, row in enumerate(rows):
        assert row[:2].min() > -1e-9
        for position, h0 in ((0, 1.0), (1, 0.99)):
            if k * 0.02 < 0.8:
                assert row[position] == pytest.approx(flight(k * 0.02, e=0.5, h0=h0)[0], abs=0.02 * 4.4)
    np.testing.assert_allclose(rows[-1, :4], 0.0, atol=1e-9)


class SampledPI(Component):
    """x' = u - x under a PI controller with a clock, u held in between."""

    T: Real = parameter(default=0.05, unit="s")
    x: Real = variable(default=fixed(0.0))
    w: Real = signal_input(doc="Set point")
    held: Real = discrete()
    integral: Real = discrete()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)

    def equations(self) -> Equations:
        yield der(self.x) == (self.held - self.x) / 1.0
        error = self.w - self.x
        integral = pre(self.integral) + 0.2 * error
        yield when(
            sample(0.0, self.T),
            reset(self.integral, integral),
            reset(self.held, 2.0 * error + integral),
        )


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("sdirk", 2)])
def test_samples_on_the_grid_are_exact(method: str, order: int) -> None:
    # between two ticks x follows its exponential: x <- u + (x - u) e^-T
    x, integral, exact = 0.0, 0.0, []
    for _ in range(21):
        integral += 0.2 * (1.0 - x)
        held = 2.0 * (1.0 - x) + integral
        exact.append((x, held))
        x = held + (x - held) * math.exp(-0.05)
    errors = []
    for h in (0.01, 0.005):
        step = step_function(acausal.compile(SampledPI()), h, method, [])
        first = np.array(step.x.start)
        assert first[step.x.position("held")] == 0.0  # the set point is not known yet: u starts at 0
        first[[step.x.position("held"), step.x.position("integral")]] = exact[0][1], 0.2
        first[step.x.position("pre(integral)")] = 0.2
        row, worst = first, 0.0
        for k in range(1, round(1.0 / h) + 1):
            row = np.array(step.function(row, [1.0], step.p.start)[0]).ravel()
            if k % round(0.05 / h) == 0:
                found = row[step.x.position("x")], row[step.x.position("held")]
                worst = max(worst, float(np.abs(np.subtract(found, exact[k // round(0.05 / h)])).max()))
        errors.append(worst)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)
    assert errors[1] < (1e-11 if order == 4 else 1e-5)


def test_time_does_not_drift_off_the_samples() -> None:
    # 0.01 s is no binary number: the sum of 10 million of them is off by 1e-4 steps and more
    step = step_function(acausal.compile(SampledPI()), 0.01, "rk4", [])
    found = walk(step, 10, [1.0], {"time": 100_000.03})
    changes = np.diff(found["held"], prepend=step.x.start[step.x.position("held")]) != 0.0
    assert np.round(found["time"][changes] - 100_000, 9).tolist() == [0.05, 0.1]


class Coupling(Component):
    """A flywheel that a clutch joins to one at rest: at equal speeds they stick."""

    left: Inertia = part()
    right: Inertia = part()
    clutch: Clutch = part()
    press: Constant = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)

    def build(self) -> None:
        self.left, self.right = Inertia(J=1.0, phi=0.0, w=10.0), Inertia(J=3.0, phi=0.0, w=0.0)
        self.clutch = Clutch(fn_max=12.0)  # torque mu cgeo fn = 6 N.m
        self.press = Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.left.flange_b, self.clutch.flange_a)
        yield connect(self.clutch.flange_b, self.right.flange_a)
        yield connect(self.press.y, self.clutch.f_normalized)


@pytest.mark.parametrize("method", ["rk4", "sdirk"])
def test_a_clutch_sticks_when_speeds_are_equal(method: str) -> None:
    # -6 and +2 rad/s2: equal after 1.25 s at 2.5 rad/s, by the balance of angular momentum too
    h = 0.007  # 1.25 s is no multiple of it
    step = step_function(acausal.compile(Coupling()), h, method, [])
    rows = steps(step, 285)
    for k, row in enumerate(rows):
        t = min(k * h, 1.25)
        assert row[step.x.position("left.w")] == pytest.approx(10.0 - 6.0 * t, abs=1e-8)
        assert row[step.x.position("right.w")] == pytest.approx(2.0 * t, abs=1e-8)
        mode = row[step.x.position("clutch.mode")]
        assert mode == (-1.0 if k * h < 1.25 else 0.0)  # w_rel is that of the right one against the left


@needs_compiler
@pytest.mark.parametrize("model", [BouncingBall(), Coupling()], ids=["ball", "clutch"])
def test_compiled_steps_with_events_have_bounded_loops_only_and_give_the_same(model: Component) -> None:
    step = step_function(acausal.compile(model), 2e-3, "rk4", [])
    body = step.source()[step.source().index("*/") :]
    assert not [word for word in ("while", "goto", "alloc", "static double") if word in body]
    # CasADi's copies, counted loops: from or to another place by a pointer where a part of a vector is meant
    assert all(re.search(r"(\+\+\w+|\+=1)$", head) for head in re.findall(r"for \(([^)]*)\)", body))
    times, x = real_time(step, 1000)
    np.testing.assert_allclose(x, steps(step, 1000)[-1], rtol=1e-12, atol=1e-12)
    assert times.finite


@pytest.mark.slow
@needs_compiler
def test_a_drill_on_its_stiff_contact_at_a_millisecond() -> None:
    # a contact of 1e8 N/m on 5 kg rings in 1.4 ms; explicit and Rosenbrock steps of 1 ms throw the drill out
    model = acausal.compile(ThickBlock())
    step = step_function(model, 1e-3, "sdirk", [])
    _, x = real_time(step, 10_000)
    run = acausal.simulate(model, tolerance=1e-9, stop_time=10.0)
    for name in ("slide.s", "drill.s_tar"):
        assert x[step.x.position(name)] == pytest.approx(run.final(name), abs=1e-7)


class Lag(Component):
    """x' = -x(t - 1)."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -delay(self.x, 1.0)


def test_what_has_no_step_is_named_with_its_line() -> None:
    with fails_with(ExportError, "AC605", match=r"ticks every 0\.05 s") as fast:
        step_function(acausal.compile(SampledPI()), 0.1)
    assert "when(" in fast.value.where[0].text
    with pytest.raises(UsageError, match="AC035") as late:
        step_function(acausal.compile(Lag()), 0.1)
    assert "delay(" in late.value.where[0].text


class Ender(Component):
    """A lag that ends its run, and says where it must not be."""

    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield when(self.x < 0.3, terminate("done"))
        yield assert_(self.x > 0.1, "too small")


def test_what_a_step_does_not_do_is_in_its_notes() -> None:
    notes = step_function(acausal.compile(Ender()), 0.01).notes
    assert any("does not end the run" in note and "terminate" in note for note in notes)
    assert any("too small" in note for note in notes)


class Passing(Component):
    """x' = 1; y rises by 0.02 while x is within 0.01 of 0.53."""

    kind: str = acausal.structural(default="kink")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        near = {
            "kink": fabs(self.x - 0.53) < 0.01,
            "parabola": (self.x - 0.53) * (self.x - 0.53) < 1e-4,
            "two": (self.x > 0.52) & (self.x < 0.54),
            "one": self.x > 0.54,
        }[self.kind]
        yield der(self.x) == 1.0
        yield der(self.y) == where(near, 1.0, 0.0)


@pytest.mark.parametrize("method", ["rk2", "rk4", "rosenbrock", "sdirk"])
@pytest.mark.parametrize(
    ("kind", "h"), [("kink", 0.1), ("parabola", 0.1), ("two", 0.1), ("one", 0.1), ("kink", 0.0025)]
)
def test_what_a_step_does_not_locate_is_said(kind: str, h: float, method: str) -> None:
    """The window is 0.53 +- 0.01: it lies in the step from 0.5 to 0.6. The flag is 1 in the one step that misses it."""
    step = step_function(acausal.compile(Passing(kind=kind)), h, method, ["y"])
    found = walk(step, round(1.0 / h))
    exact = 0.46 if kind == "one" else 0.02
    is_right = abs(found["y"][-1] - exact) < 1e-6
    assert np.flatnonzero(found["step.unlocated"]).tolist() == ([] if is_right else [5])
    assert is_right == (kind == "one" or h < 0.01)
    assert any("step.unlocated" in note for note in step.notes)


class Swinging(Component):
    """y rises while sin(w t) > 0.9: for acos(0.9)/pi of the time."""

    w: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where(sin(self.w * self.x) > 0.9, 1.0, 0.0)


@pytest.mark.parametrize("method", ["rk2", "rk4", "rosenbrock", "sdirk"])
@pytest.mark.parametrize("swings", [0.2, 0.5, 1.0, 1.5, 2.0, 3.0])
def test_guards_that_swing_within_a_step_are_said(swings: float, method: str) -> None:
    """`swings` periods to a step: with whole ones a guard and its rate are the same at both ends of each step."""
    h = 0.05
    step = step_function(acausal.compile(Swinging(w=2 * math.pi * swings / h)), h, method, ["y"])
    found = walk(step, 40)
    off, said = abs(found["y"][-1] / (40 * h) - math.acos(0.9) / math.pi), found["step.unlocated"].any()
    assert said == (swings > 0.2)
    assert said or off < 0.01


class Timed(Component):
    """y rises for 4 ms from `at` on, and n counts the ticks of a clock of 0.1 s that begins at `first`."""

    at: Real = parameter(default=0.523)
    first: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    n: Real = discrete(default=0.0)

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == where((time > self.at) & (time < self.at + 4e-3), 1.0, 0.0)
        yield when(sample(self.first, 0.1), reset(self.n, pre(self.n) + 1.0))


@pytest.mark.parametrize("method", ["rk4", "sdirk"])
@pytest.mark.parametrize(
    ("h", "at", "first", "expected"),
    [
        (0.1, 0.523, 0.0, [5]),
        (0.1, 0.523, 0.05, list(range(10))),
        (1e-3, 0.523, 0.0, []),
        (1e-3, 0.5235, 0.0, [523, 527]),
    ],
)
def test_instants_within_a_step_are_said(h: float, at: float, first: float, expected: list[int], method: str) -> None:
    """What time alone decides is known exactly: a pulse of 4 ms was lost in a step of 0.1 s without a word."""
    step = step_function(acausal.compile(Timed()), h, method, ["y"])
    found = walk(step, round(1.0 / h), p={"at": at, "first": first})
    assert np.flatnonzero(found["step.unlocated"]).tolist() == expected
    if not expected:
        assert found["y"][-1] == pytest.approx(4e-3, rel=1e-6)
    assert any("time events and clock ticks" in note for note in step.notes)


class Switched(Component):
    """y rises from 0.523 s on, and nothing else happens."""

    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == where(time > 0.523, 1.0, 0.0)


def test_instants_within_a_step_are_said_without_other_events() -> None:
    step = step_function(acausal.compile(Switched()), 0.1, "rk4", ["y"])
    assert walk(step, 10)["step.unlocated"].tolist() == [0.0] * 5 + [1.0] + [0.0] * 4


class Elastic(Component):
    """A ball that hops within a few hundredths of a second, for ever."""

    h: Real = variable(default=fixed(1e-3))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield when(self.h < 0.0, reset(self.v, -pre(self.v)))


def test_impacts_that_follow_each_other_within_a_step_are_flagged() -> None:
    """Its 28 ms between impacts are resolved by steps of 13 ms, and not by one of 50 ms, which puts it to rest."""
    for size, flagged in ((0.013, 0.0), (0.05, 1.0)):
        step = step_function(acausal.compile(Elastic()), size, "rk4", ["h"])
        assert walk(step, 1)["step.unlocated"] == flagged


class Halves(Component):
    """An integer that a clock takes up by `by`."""

    by: Real = parameter(default=1.0)
    n: Real = integer(default=fixed(0))

    def equations(self) -> Equations:
        yield when(sample(0.1, 0.1), reset(self.n, pre(self.n) + self.by))


@pytest.mark.parametrize(("by", "after"), [(1.0, 1.0), (2.0, 2.0), (1.5, math.nan)])
def test_an_integer_that_gets_a_fraction_is_nan(by: float, after: float) -> None:
    """Where a run ends with AC147."""
    step = step_function(acausal.compile(Halves(by=by)), 0.1, "rk4", [])
    assert walk(step, 1)["n"] == pytest.approx(after, nan_ok=True)


@pytest.mark.parametrize(("by", "after"), [(1.0, 1.0), (1.5, math.nan)])
def test_an_integer_that_gets_a_fraction_is_nan_in_react(by: float, after: float) -> None:
    model = acausal.compile(Halves(by=by)).casadi(events=True)
    assert model.events is not None
    arguments = [0.1, model.x.start, [], [], model.p.start, model.events.m.start, [1.0]]
    found = np.array(model.events.react(*arguments)[0]).ravel()
    assert found == pytest.approx(after, nan_ok=True)


class Contradicting(Component):
    """Two clauses that set n at one instant, to the same value or not."""

    other: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(0.0))
    n: Real = discrete()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.05, reset(self.n, 1.0))
        yield when(self.x > 0.05, reset(self.n, self.other))


@pytest.mark.parametrize(("other", "unsettled"), [(1.0, 0.0), (2.0, 1.0)])
def test_clauses_that_contradict_each_other_are_said(other: float, unsettled: float) -> None:
    """Where a run ends with AC504."""
    step = step_function(acausal.compile(Contradicting(other=other)), 0.1, "rk4", [])
    assert walk(step, 1)["step.unsettled"] == unsettled
