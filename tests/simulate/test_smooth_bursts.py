"""Smooth rates that wake for a moment after a long rest: every solver integrates the burst, wherever it is."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.special import i0e

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    atan,
    cos,
    cosh,
    der,
    exp,
    fixed,
    parameter,
    part,
    pre,
    reset,
    sin,
    sqrt,
    structural,
    tanh,
    time,
    variable,
    when,
    where,
)
from acausal.lower.compiled import CompiledModel
from acausal.lower.variants.watched import with_watched
from acausal.simulate.driver.missed.missed_events import MissedEvents
from acausal.simulate.equations.problem import Problem
from acausal.simulate.solvers.segment import Piece, Segment
from tests.marks import slow_but

SOLVERS = ["idas", "cvodes", "rosenbrock", "erk"]
SPAN = 100.0


def _lorentz_squared(v: float) -> float:
    return 0.5 * (v / (1.0 + v * v) + math.atan(v))


def _box(v: float) -> float:
    """The integral of (1 + tanh(v + 3))*(1 - tanh(v - 3))/4, with a = exp(-12) and ln(cosh(v + 3)/cosh(v - 3))."""
    difference = abs(v + 3.0) - abs(v - 3.0)
    logs = math.log1p(math.exp(-2.0 * abs(v + 3.0))) - math.log1p(math.exp(-2.0 * abs(v - 3.0)))
    return 0.5 * (difference + logs) / (1.0 - math.exp(-12.0))


def _arcs(v: float) -> float:
    def one(u: float) -> float:
        return u * math.atan(u) - 0.5 * math.log1p(u * u)

    return (one(v + 3.0) - one(v - 3.0)) / math.pi


# A pulse of width and height one around zero, and its integral.
PULSES: dict[str, tuple[Callable[[Any], Expr], Callable[[float], float]]] = {
    "Gauss": (lambda v: exp(-(v**2)), lambda v: 0.5 * math.sqrt(math.pi) * math.erf(v)),
    "product": (lambda v: exp(-v * v), lambda v: 0.5 * math.sqrt(math.pi) * math.erf(v)),
    "Lorentz": (lambda v: 1.0 / (1.0 + v**2), math.atan),
    "Lorentz squared": (lambda v: 1.0 / (1.0 + v**2) ** 2, _lorentz_squared),
    "tanh squared": (lambda v: 1.0 - tanh(v) ** 2, math.tanh),
    "logistic": (lambda v: 0.25 * (1.0 - tanh(0.5 * v) * tanh(0.5 * v)), lambda v: 0.5 * math.tanh(0.5 * v)),
    "two tanh": (lambda v: 0.25 * (1.0 + tanh(v + 3.0)) * (1.0 - tanh(v - 3.0)), _box),
    "two atan": (lambda v: (atan(v + 3.0) - atan(v - 3.0)) / math.pi, _arcs),
}


class Burst(Component):
    """y' = k F((s - c)/w) with s = t: as time, as a state, as a variable that is iterated, or behind a definition."""

    pulse: str = structural(default="Gauss")
    argument: str = structural(default="state")
    c: Real = parameter(default=50.0)
    w: Real = parameter(default=0.01)
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        if self.argument == "iterated":
            yield self.z + 0.01 * self.z**3 == self.x + 0.01 * self.x**3
        else:
            yield self.z == (self.x - self.c) / self.w
        s = {"time": time, "state": self.x, "iterated": self.z}.get(self.argument)
        v = self.z if s is None else (s - self.c) / self.w
        yield der(self.y) == self.k * PULSES[self.pulse][0](v)


@cache
def _compiled(pulse: str, argument: str) -> CompiledModel:
    return acausal.compile(Burst(pulse=pulse, argument=argument))


@pytest.mark.parametrize("solver", slow_but(SOLVERS, "rosenbrock"))
def test_random_bursts(solver: str) -> None:
    """Peaks of 1e-5 to 1e-1 of the run, of height or area one, anywhere in it, against the integral in closed form.

    The argument is known to a tolerance of x only, and errors add up over a burst: ten tolerances of the area, a
    hundred at 1e-4, where the first step behind a rest is large.
    """
    rng = random.Random(SOLVERS.index(solver))
    for _ in range(8 if solver == "erk" else 16):  # a rootfinder in its rates takes most of the time
        pulse, argument = rng.choice(list(PULSES)), rng.choice(["time", "state", "iterated", "defined"])
        w, c = SPAN * 10.0 ** rng.uniform(-5.0, -1.0), SPAN * rng.uniform(0.05, 0.95)
        k, tolerance = rng.choice([1.0, 1.0 / w]), rng.choice([1e-4, 1e-6, 1e-8, 1e-10])
        values = {"c": c, "w": w, "k": k}
        integral = PULSES[pulse][1]
        exact = k * w * (integral((SPAN - c) / w) - integral(-c / w))
        run: dict[str, Any] = {"stop_time": SPAN, "solver": solver, "tolerance": tolerance, "native": False}
        r = acausal.simulate(_compiled(pulse, argument), parameters=values, **run)
        allowed = (100.0 if tolerance >= 1e-4 else 10.0) * tolerance * max(1.0, exact)
        assert r.final("y") == pytest.approx(exact, abs=allowed), (pulse, argument, values, tolerance)
        assert not r.events


class Periodic(Component):
    """Rates of an angle q = t that wake once or twice a turn, and of a body that passes a point."""

    kind: str = structural(default="power")
    q: Real = variable(default=fixed(0.0))
    r: Real = variable(default=fixed(0.0))
    s: Real = variable(default=fixed(0.0))
    u: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.q) == 1.0
        yield der(self.r) == 0.6
        yield der(self.s) == self.u
        yield der(self.u) == -self.s
        near = (self.q - 20.0) ** 2 + (self.r - 12.0) ** 2
        yield (
            der(self.y)
            == {
                "power": sin(self.q) ** 20000,
                "exponential": exp(150.0 * (cos(self.q) - 1.0)),
                "quotient": 1.0 / (1.0 + 1e8 * cos(self.q) ** 2),
                "oscillator": self.s**20000,
                "peak": exp(1e6 * (self.s - 1.0)),
                "point": exp(-near / 1e-4),
                "bell": 1.0 / (1.0 + near / 1e-4) ** 2,
            }[self.kind]
        )


# Over 4 pi, in which q passes (20, 12) not at all, and over 12 pi, in which it does.
TURN = 2.0 * math.pi
POWER = 2.0 * math.exp(math.lgamma(10000.5) - math.lgamma(10001.0)) * math.sqrt(math.pi)
SPEED = math.hypot(1.0, 0.6)
PERIODIC = {
    "power": 2 * POWER,
    "exponential": 2 * TURN * float(i0e(150.0)),
    "quotient": 2 * TURN / math.sqrt(1.0 + 1e8),
    "oscillator": 2 * POWER,
    "peak": 10 * TURN * float(i0e(1e6)),
    "point": 1e-2 * math.sqrt(math.pi) / SPEED,
    "bell": 1e-2 * 0.5 * math.pi / SPEED,
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", PERIODIC)
def test_periodic_bursts_and_closest_approaches(kind: str, solver: str) -> None:
    """Integrals over a turn: Wallis' for the power, 2 pi exp(-k) I0(k) and 2 pi/sqrt(1 + k) for the next two.

    The oscillator is s = sin t; its power amplifies what s is off by 20000, its exponential by 1e6. A body that goes
    straight through the point sees a pulse of width 1e-2 over its speed. Of ten peaks idas missed five, cvodes four.
    """
    stop = 40.0 if kind in ("point", "bell") else (10.0 if kind == "peak" else 2.0) * TURN + 1.0
    r = acausal.simulate(Periodic(kind=kind), stop_time=stop, solver=solver, tolerance=1e-8)
    expected = PERIODIC[kind]
    if kind == "exponential":  # half of a third peak, and what begins at the end is none
        expected *= 1.25
    assert r.final("y") == pytest.approx(expected, rel={"oscillator": 1e-2, "peak": 5e-2}.get(kind, 1e-4))


# A step of height one at zero, for expressions and for numbers.
STEPS: dict[str, tuple[Callable[[Any], Expr], Callable[[Any], Any]]] = {
    "tanh": (lambda u: 0.5 * (1.0 + tanh(u)), lambda u: 0.5 * (1.0 + np.tanh(u))),
    "atan": (lambda u: 0.5 + atan(u) / math.pi, lambda u: 0.5 + np.arctan(u) / math.pi),
    "exp": (lambda u: exp(u - 3.0), lambda u: np.exp(u - 3.0)),
    "root": (lambda u: 0.5 + 0.5 * u / sqrt(1.0 + u**2), lambda u: 0.5 + 0.5 * u / np.sqrt(1.0 + u**2)),
    "power": (lambda u: (0.5 + atan(u) / math.pi) ** 4, lambda u: (0.5 + np.arctan(u) / math.pi) ** 4),
    "Gauss": (lambda u: exp(-(u**2)), lambda u: np.exp(-(u**2))),
}


class Crest(Component):
    """y' = a F(k (s - cos h)) - b y with s = sin(w t): around each crest s is above cos h for the angles -h to h.

    Perhaps beside something that switches as s passes 0.3.
    """

    step: str = structural(default="tanh")
    argument: str = structural(default="time")
    switches: bool = structural(default=False)
    w: Real = parameter(default=1.0)
    h: Real = parameter(default=0.1)
    k: Real = parameter(default=100.0)
    a: Real = parameter(default=1.0)
    b: Real = parameter(default=0.0)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    z: Real = variable()
    y: Real = variable(default=fixed(0.0))
    g: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.g) == (where(self.x > 0.3, 1.0, -self.g) if self.switches else -self.g)
        yield der(self.x) == self.w * self.v
        yield der(self.v) == -self.w * self.x
        if self.argument == "iterated":
            yield self.z + 0.01 * self.z**3 == self.x + 0.01 * self.x**3
        else:
            yield self.z == self.x
        s = {
            "time": sin(self.w * time),
            "state": self.x,
            "iterated": self.z,
            "chosen": where(self.v > -0.3, self.x, 0.5 * self.x),
        }[self.argument]
        rise = STEPS[self.step][0](self.k * (s - cos(self.h)))
        yield der(self.y) == self.a * rise - self.b * self.y


def _crests(step: str, argument: str, values: dict[str, float], stop: float) -> float:
    """y at the end, by Gauss-Legendre panels that shrink towards each crest and each passage of cos h."""
    w, h = values["w"], values["h"]
    crests = math.pi * (np.arange(-1.0, stop * w / math.pi + 2.0) + 0.5)
    chosen = math.acos(-0.3) - 0.5 * math.pi  # v is above -0.3 from so far before a valley to so far behind a crest
    marks = np.concatenate([crests, crests - h, crests + h, crests + chosen, crests - chosen])
    away = np.append(0.0, np.logspace(-8.0, 0.0, 60)) * math.pi
    edges = np.concatenate([(marks[:, None] + s * away).ravel() / w for s in (1.0, -1.0)])
    ends = np.unique(np.clip(np.append(edges, [0.0, stop]), 0.0, stop))
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = 0.5 * np.diff(ends)[:, None]
    t = ends[:-1, None] + half * (1.0 + nodes)
    s = np.sin(w * t) * np.where((np.cos(w * t) > -0.3) | (argument != "chosen"), 1.0, 0.5)
    rise = STEPS[step][1](values["k"] * (s - math.cos(h)))
    return float(values["a"] * np.sum(half * weights * rise * np.exp(values["b"] * (t - stop))))


@cache
def _crest(step: str, argument: str, switches: bool = False) -> CompiledModel:
    return acausal.compile(Crest(step=step, argument=argument, switches=switches))


@pytest.mark.parametrize(
    ("solver", "series", "count"),
    slow_but(
        [("rosenbrock", 3, 3), *((s, 8, 5 if s in ("idas", "cvodes") else 8) for s in SOLVERS)], ("rosenbrock", 3, 3)
    ),
)
def test_a_single_step_that_comes_and_goes(solver: str, series: int, count: int) -> None:
    """One step on the crests of a sine, awake for 1e-4 to 0.3 rad of them, against quadrature.

    Where the sine is a state, BDF knows its amplitude to some 70 tolerances after 20 turns: a hundred are allowed, by
    which it may not come up to the step at all. Else 20 are, and 3 for each crest, since errors of steps add up: `idas`
    is 61 off after twenty crests at 4e-7. Of 84 such models 23 runs of 336 were wrong, by up to 1e7 tolerances and
    without a word.
    """
    rng = random.Random(100 * series + SOLVERS.index(solver))
    kinds = ["time", "time", "state", "chosen", *(["iterated"] if solver == "idas" else [])]
    for _ in range(count):
        step, argument = rng.choice(list(STEPS)), rng.choice(kinds)
        argument = "time" if step == "exp" else argument  # it makes any error of a state as large as one likes
        w, h = 0.2 * math.pi * rng.choice([0.4, 1.0, 2.3, 7.0, 20.0]), 10.0 ** rng.uniform(-4.0, -0.5)
        values = {
            "w": w,
            "h": h,
            "k": 10.0 ** rng.uniform(-0.5, 1.0 if step == "exp" else 2.0) / h**2,
            "a": rng.choice([1.0, w / h]),
        }
        values["b"], tolerance = rng.choice([0.0, 0.1, 1.0]), 10.0 ** -rng.uniform(5.0, 9.0)
        exact = _crests(step, argument, values, 10.0)
        known = 0.0
        if argument != "time":
            levels = [math.cos(h) + s * 100.0 * tolerance for s in (1.0, -1.0)]
            moved = [_crests(step, argument, {**values, "h": math.acos(min(c, 1.0))}, 10.0) for c in levels]
            known = max(abs(y - exact) for y in (*moved, *([0.0] if levels[0] > 1.0 else [])))
        run: dict[str, Any] = {"stop_time": 10.0, "solver": solver, "tolerance": tolerance, "native": False}
        switches = rng.random() < 0.5
        r = acausal.simulate(_crest(step, argument, switches), parameters=values, **run)
        crests = 10.0 * w / TURN
        allowed = (20.0 + 3.0 * crests) * tolerance * max(1.0, exact) + known
        assert r.final("y") == pytest.approx(exact, abs=allowed), (step, argument, switches, values, tolerance)


class Beside(Component):
    """y' = (1 + tanh(k (sin t - cos h)))/2, which acts on nothing, beside a ball that bounces."""

    y: Real = variable(default=fixed(0.0))
    p: Real = variable(default=fixed(1.0))
    q: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == 0.5 * (1.0 + tanh(1e9 * (sin(time) - math.cos(3e-4))))
        yield der(self.p) == self.q
        yield der(self.q) == -9.81
        yield when(self.p < 0.0, reset(self.q, -0.8 * pre(self.q)))


@pytest.mark.parametrize("solver", slow_but(SOLVERS, "rosenbrock", "erk"))
def test_an_integral_of_time_that_wakes_beside_something_else(solver: str) -> None:
    """Awake from h before the crest to h behind it: it was 0, as a series on panels saw nothing of it."""
    r = acausal.simulate(Beside(), stop_time=1.8, solver=solver, tolerance=1e-6)
    assert r.final("y") == pytest.approx(6e-4, abs=1e-6)


CRESTS = {
    "two peaks on each crest, closer than rows": ("idas", "Gauss", 1.4 * math.pi, 3.1590876773075603e-4, 94.79),
    "crests at quarters between rows": ("cvodes", "exp", 4.0 * math.pi, 1.2508e-3, 6.62),
}


@pytest.mark.parametrize("case", CRESTS.values(), ids=CRESTS)
def test_crests_that_were_passed_over(case: tuple[str, str, float, float, float]) -> None:
    """An argument is no polynomial between rows though the sine in it is one, and its slope may be zero on a row."""
    solver, step, w, h, steep = case
    values, tolerance = {"w": w, "h": h, "k": steep / h**2, "a": w / h, "b": 1.0}, 2.6e-9
    exact = _crests(step, "time", values, 10.0)
    run: dict[str, Any] = {"stop_time": 10.0, "solver": solver, "tolerance": tolerance, "native": False}
    r = acausal.simulate(_crest(step, "time"), parameters=values, **run)
    assert r.final("y") == pytest.approx(exact, abs=20.0 * tolerance * max(1.0, exact))


VALLEYS: dict[str, tuple[Callable[[Any], Expr], float]] = {
    # the integral of 1/(a - cos)**2 over a period is 2 pi a/(a**2 - 1)**1.5, here with a = 1 + 5e-9
    "pole": (lambda t: 1e-12 / (1.0 + 5e-9 - cos(t)) ** 2, 2.0 * math.pi * (1.0 + 5e-9) / (1.0 + 2.5e-9) ** 1.5),
    # that of 1/cosh over all is pi
    "pulse": (lambda t: 150.0 / cosh(300.0 * sin(0.5 * t)), math.pi),
}


@pytest.mark.parametrize("solver", ["idas", "cvodes", "erk"])
@pytest.mark.parametrize("valley", VALLEYS)
def test_a_divisor_that_comes_near_zero(valley: str, solver: str) -> None:
    """Two peaks, 1e-4 and 1e-2 wide, of a divisor without any square in it."""
    rate, one = VALLEYS[valley]

    class Peaks(Component):
        y: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.y) == rate(time - 1.0)

    r = acausal.simulate(Peaks(), stop_time=4 * math.pi, solver=solver, tolerance=1e-5, output_interval=4 * math.pi)
    assert r.final("y") == pytest.approx(2.0 * one, rel=2e-3)


HARMLESS: dict[str, Callable[[Any, Any], Expr]] = {
    "diode": lambda x, v: 1e-9 * (exp(x / 0.025) - 1.0),
    "friction": lambda x, v: -tanh(v / 1e-3),
    "regularised": lambda x, v: -v / sqrt(1e-6 + v**2),
    "softened": lambda x, v: -x / (1.0 + 0.5 * cos(x) ** 2),
    "attraction": lambda x, v: -x / sqrt(x**2 + v**2) ** 3,
    "polynomial": lambda x, v: x**2 * v**4,
}


@pytest.mark.parametrize("most", [20_000, 50])
def test_what_is_not_searched_is_said(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stretch of more steps than the search takes may pass something: not without a word, and no word else."""
    from acausal.simulate.driver.missed import missed_events

    monkeypatch.setattr(missed_events, "_MOST_ROWS", most)
    r = acausal.simulate(_crest("tanh", "time"), stop_time=10.0, solver="cvodes", tolerance=1e-8)
    notes: Any = r.stats["notes"]
    assert any("too many steps to be searched" in note for note in notes) == (most == 50)


class Harmless(Component):
    force: Callable[[Any, Any], Expr] = structural(default=HARMLESS["diode"])
    x: Real = variable(default=fixed(0.1))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == self.force(self.x, self.v) - self.x


@pytest.mark.parametrize("force", HARMLESS.values(), ids=HARMLESS)
def test_one_step_for_itself_is_no_burst(force: Callable[[Any, Any], Expr]) -> None:
    """The error control sees both sides of it: nothing is watched, and such runs cost what they did."""
    model, *notes = with_watched(acausal.compile(Harmless(force=force)), 1e-6)
    assert not model.state_events
    assert not any(notes)


class Bounces(Component):
    """A ball bounces; perhaps beside a step `1 + tanh(1e3 (h - 50))` at a height that it never comes near."""

    has_step: bool = structural(default=True)
    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        step = 1.0 + tanh(1e3 * (self.h - 50.0)) if self.has_step else 0.0
        yield der(self.h) == self.v
        yield der(self.v) == -9.81 - 0.1 * self.v * abs(self.v) - step
        yield when(self.h < 0.0, reset(self.v, -0.8 * pre(self.v)))


@pytest.mark.parametrize("solver", ["rosenbrock", "erk"])
def test_a_step_that_is_far_away_leaves_the_steps_of_a_run_as_they_are(solver: str) -> None:
    """It is zero to the last digit: nothing is looked at more closely, and no solver is replaced by another way."""
    run: dict[str, Any] = {"stop_time": 2.0, "solver": solver, "tolerance": 1e-7, "native": False}
    with_step, without = (acausal.simulate(Bounces(has_step=h), **run) for h in (True, False))
    assert len(without.events) == 3
    assert with_step.stats["steps"] == without.stats["steps"]
    assert with_step.final("h") == without.final("h")


class Woken(Component):
    """A ball bounces, and each crest of a sine makes y larger by one, awake for 2 h of its angle."""

    w: Real = parameter(default=31.0)
    h: Real = parameter(default=6.5910735e-4)
    y: Real = variable(default=fixed(0.0))
    p: Real = variable(default=fixed(1.0))
    q: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        crest = 1.0 + tanh(75.0 / self.h**2 * (sin(self.w * time) - cos(self.h)))
        yield der(self.y) == self.w / (4.0 * self.h) * crest
        yield der(self.p) == self.q
        yield der(self.q) == -9.81 - 0.1 * self.q * abs(self.q) + 0.02 * self.y
        yield when(self.p < 0.0, reset(self.q, -0.8 * pre(self.q)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solver", "w", "stop"), [("rosenbrock", 57.88, 2.5), ("erk", 57.88, 2.5), ("idas", 31.0, 1.0)]
)
def test_what_wakes_shortly_before_an_event_is_kept(solver: str, w: float, stop: float) -> None:
    """A run goes to an event once more from where it was last known, and passes there over what it had found.

    At 31 rad/s a crest is 3.5 ms before the first impact.
    """
    run: dict[str, Any] = {"stop_time": stop, "solver": solver, "tolerance": 1e-6, "native": False}
    r = acausal.simulate(Woken(), parameters={"w": w}, **run)
    assert r.final("y") == pytest.approx(math.floor(stop * w / (2.0 * math.pi) + 0.75), abs=0.05)


@pytest.mark.parametrize("solver", ["rosenbrock", pytest.param("erk", marks=pytest.mark.slow)])
def test_compiled_runs_find_what_wakes_between_steps(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Crests of three speeds, each awake for a few thousandths of a turn.

    With `rosenbrock` in the compiled event loop, without a second search; `erk` is searched after each stretch.
    """
    asked: list[float] = []

    def cleared(self: MissedEvents, problem: Problem, segment: Segment, piece: Piece) -> bool:
        asked.append(segment.start)
        return clears(self, problem, segment, piece)

    clears = MissedEvents.clears
    monkeypatch.setattr(MissedEvents, "clears", cleared)
    model = acausal.compile(Woken())
    for w in (31.0, 57.88, 211.0) if solver == "rosenbrock" else (57.88,):
        r = acausal.simulate(model, stop_time=2.5, solver=solver, native=True, parameters={"w": w})
        assert r.stats["native"]
        assert r.final("y") == pytest.approx(math.floor(2.5 * w / (2.0 * math.pi) + 0.75), abs=0.05)
    assert solver == "erk" or len(asked) <= 3  # of what ends in Python: an event at the stop


class Peaks(Component):
    """y' = |sin(t)|**k, beside a relation, with k a parameter: the same equations whatever it is."""

    k: Real = parameter(default=2.0)
    y: Real = variable(default=fixed(0.0))
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == (0.5 + 0.5 * sin(time)) ** self.k
        yield der(self.x) == where(self.y > 1.0, 1.0, 0.0)


@pytest.mark.slow
def test_libraries_know_which_functions_are_steep() -> None:
    """An exponent of 2 is not steep and one of 40 is; a turn of ((1 + sin t)/2)**n is 2 pi C(2n, n)/4**n."""
    for n in (2, 40, 3):
        r = acausal.simulate(
            Peaks(k=float(n)), stop_time=4.0 * math.pi, solver="rosenbrock", native=True, tolerance=1e-8
        )
        assert r.final("y") == pytest.approx(4.0 * math.pi * math.comb(2 * n, n) / 4.0**n, rel=1e-6)


class Joined(Beside):
    """The same, as one system: the ball would stop at a y that is never reached."""

    def equations(self) -> Equations:
        yield when(self.y > 1.0, reset(self.q, 0.0))


class Four(Component):
    parts: list[Joined] = part()

    def build(self) -> None:
        self.parts = [Joined(p=fixed(0.5 + 0.1 * k)) for k in range(4)]


def test_steep_functions_of_systems_apart_are_found_in_each() -> None:
    """Balls that fall from four heights, each beside a step that is awake for 6e-4 s, as it is alone."""
    r = acausal.simulate(Four(), stop_time=1.8, solver="rosenbrock", tolerance=1e-6)
    assert r.stats["subsystems"] == 4
    assert [r.final(f"parts[{k}].y") for k in range(4)] == pytest.approx([6e-4] * 4, abs=1e-6)
