"""Rates that are constant for long and wake for a moment: no step passes that unseen, and it is no event."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    clamp,
    cos,
    der,
    fabs,
    fixed,
    log,
    maximum,
    minimum,
    no_event,
    parameter,
    sin,
    structural,
    time,
    variable,
    where,
)
from acausal.analyse.events.located_kinks import LocatedKinks
from acausal.lower.variants.watched import with_watched

SOLVERS = ["idas", "cvodes", "rosenbrock", "erk"]
Rate = Callable[[Any], Expr]
RATES: dict[str, Rate] = {
    "maximum": lambda u: maximum(u, 0.0),
    "minimum": lambda u: -minimum(-u, 0.0),
    "fabs": lambda u: 0.5 * fabs(u) + 0.5 * u,
    "no_event": lambda u: where(no_event(u > 0.0), u, 0.0),
    "around": lambda u: no_event(where(u > 0.0, u, 0.0)),
    "smooth": lambda u: where(u > 0.0, u, 0.0, smooth=True),
    "shifted": lambda u: maximum(u, -0.5) - maximum(-0.5, minimum(u, 0.0)),
}


class Glimpse(Component):
    """x = sin(t); y' = (x - c)+ / (integral of one glimpse): y rises by one around each pi/2 + 2 pi k.

    With h = acos(c) that integral is 2 (sin h - h c); for c = 0.99999 it lasts 9 ms.
    """

    rate: Rate = structural(default=RATES["maximum"])
    implicit: bool = structural(default=False)
    c: Real = parameter(default=0.99999)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    z: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        h = math.acos(0.99999)
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        # the monotone cubic makes z an iterated variable of a DAE; at x = c it is c
        yield self.z == self.x if not self.implicit else self.z + 0.1 * self.z**3 == self.x + 0.1 * self.x**3
        yield der(self.y) == self.rate(self.z - self.c) / (2.0 * (math.sin(h) - h * 0.99999))


@pytest.mark.parametrize("rate", RATES.values(), ids=RATES)
def test_every_way_to_write_it(rate: Rate) -> None:
    r = acausal.simulate(Glimpse(rate=rate), stop_time=9.0, solver="idas", output_interval=9.0)
    # a relative error of 1e-6 in x is one of 1e-6/(1 - c) = 0.1 in the height of a glimpse
    assert r.final("y") == pytest.approx(2.0, abs=0.05)
    assert not r.events


@pytest.mark.parametrize("native", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("implicit", [False, True], ids=["ODE", "DAE"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_no_solver_steps_over_it(solver: str, implicit: bool, native: bool) -> None:
    compiled = acausal.compile(Glimpse(implicit=implicit))
    ends = []
    for run in (
        {"stop_time": 9.0, "output_interval": 9.0},
        {"stop_time": 12.5},
        {"stop_time": 9.0, "output_interval": 9.0},
    ):
        r = acausal.simulate(compiled, solver=solver, native=native, tolerance=1e-8, **run)  # type: ignore[arg-type]
        ends.append(r.final("y"))
        assert not r.events
    # ten tolerances are a hundredth of 1 - c
    assert ends == pytest.approx([2.0] * 3, abs=1e-2)
    assert ends[0] == ends[2]


def test_other_parameters_of_the_same_compiled_model() -> None:
    """y rises by (sin h - h c)/(sin h' - h' c') with h = acos(c), for c = 0.9999 beside the 0.99999 it is scaled by."""
    run: dict[str, Any] = {"stop_time": 3.0, "solver": "idas", "tolerance": 1e-8}
    r = acausal.simulate(acausal.compile(Glimpse()), parameters={"c": 0.9999}, **run)
    integrals = [math.sin(h) - h * math.cos(h) for h in (math.acos(0.9999), math.acos(0.99999))]
    assert r.final("y") == pytest.approx(integrals[0] / integrals[1], rel=1e-4)


class Tent(Component):
    """p' = 2 f, f a tent of 2.2 ms on a constant of -1: the rate sleeps, not at zero, under a name of its own."""

    x: Real = variable(default=fixed(0.0))
    p: Real = variable(default=fixed(0.0))
    f: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.f == maximum(1e4 * (1e-3 - fabs(self.x - 5.0)), -1.0)
        yield der(self.p) == 2.0 * self.f


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_rate_that_sleeps_at_a_constant(solver: str) -> None:
    """The tent is 10 high, 1.1 ms to each side down to -1: area above -1 is 11 * 1.1e-3, so p(9) = 2 (0.0121 - 9)."""
    r = acausal.simulate(Tent(), stop_time=9.0, solver=solver)
    assert r.final("p") == pytest.approx(2.0 * (11.0 * 1.1e-3 - 9.0), abs=1e-4)


class Pulse(Component):
    """y' = 1e3 where |sin(t)| < 1e-3, below `no_event`: pulses of 2 ms at every multiple of pi, of time only."""

    y: Real = variable(default=fixed(0.0))
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.y) == where(no_event(fabs(sin(time)) < 1e-3), 1e3, 0.0) - 0.1 * self.y
        yield der(self.w) == self.y


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_function_of_time(solver: str) -> None:
    """Pulses at 0 (half of one), pi and 2 pi of 2 asin(1e-3) s; y decays by exp(-0.1 t) behind each."""
    r = acausal.simulate(Pulse(), stop_time=7.0, solver=solver, tolerance=1e-8)
    half = math.asin(1e-3)
    spans = [(0.0, half), (math.pi - half, math.pi + half), (2 * math.pi - half, 2 * math.pi + half)]
    exact = sum(1e4 * (math.exp(-0.1 * (7.0 - b)) - math.exp(-0.1 * (7.0 - a))) for a, b in spans)
    assert r.final("y") == pytest.approx(exact, rel=1e-5)


class Bounded(Component):
    """A limit of a factor of what moves: f = 5 sin(4 t) - 4.9 is above it for a tenth of a period."""

    rate: Callable[[Any, Any], Expr] = structural()
    c: Real = variable(default=fixed(1.0))
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.c) == -0.01 * self.c
        yield der(self.x) == self.rate(self.c, 5.0 * sin(4.0 * time) - 4.9)


FACTORS: dict[str, tuple[Callable[[Any, Any], Expr], Callable[[float], float], float]] = {
    "product": (lambda c, f: c * maximum(f, -0.5), lambda f: max(f, -0.5), -0.5),
    "quotient": (lambda c, f: c / maximum(f, 0.02), lambda f: 1.0 / max(f, 0.02), 0.02),
    "square": (lambda c, f: c * minimum(-f, 0.5) ** 2, lambda f: min(-f, 0.5) ** 2, -0.5),
    "choice": (lambda c, f: c * where(no_event(f > -0.5), f, -0.5), lambda f: max(f, -0.5), -0.5),
    "dip": (lambda c, f: c * fabs(f), abs, 0.0),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("factor", FACTORS)
def test_a_limit_of_a_factor(factor: str, solver: str) -> None:
    """Against Gauss's rule between the kinks, over five periods; c = exp(-t/100)."""
    rate, value, limit = FACTORS[factor]
    stop = 2.5 * math.pi
    first = math.asin((limit + 4.9) / 5.0)
    kinks = [(turn * 2.0 * math.pi + t) / 4.0 for turn in range(5) for t in (first, math.pi - first)]
    nodes, weights = np.polynomial.legendre.leggauss(10)
    exact = 0.0
    for a, b in itertools.pairwise([0.0, *kinks, stop]):
        for left, right in itertools.pairwise(np.linspace(a, b, 9)):
            t = 0.5 * (left + right) + 0.5 * (right - left) * nodes
            values = [math.exp(-0.01 * s) * value(5.0 * math.sin(4.0 * s) - 4.9) for s in t]
            exact += 0.5 * (right - left) * float(weights @ values)
    r = acausal.simulate(Bounded(rate=rate), stop_time=stop, solver=solver, tolerance=1e-7, output_interval=stop)
    assert r.final("x") == pytest.approx(exact, rel=1e-6, abs=2e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_dip_between_two_points_of_a_polynomial(solver: str) -> None:
    """y' = 2 |(t - 1) (t - 1.3)|: a method of third order takes it in one step, but for the dip, 4/6 0.3**3."""

    class Dip(Component):
        y: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            yield der(self.y) == 2.0 * fabs((time - 1.0) * (time - 1.3))

    exact = 2.0 * (27.0 / 3.0 - 2.3 * 9.0 / 2.0 + 1.3 * 3.0) + 4.0 / 6.0 * 0.3**3
    r = acausal.simulate(Dip(), stop_time=3.0, solver=solver, tolerance=1e-9, output_interval=3.0)
    assert r.final("y") == pytest.approx(exact, abs=1e-7)


def test_rows_are_those_of_the_grid_and_of_the_wakings() -> None:
    r = acausal.simulate(Glimpse(), stop_time=3.0, solver="idas", output_interval=0.5, tolerance=1e-8)
    assert np.all(np.diff(r.time) >= 0.0)
    assert set(np.round(np.arange(0.0, 3.01, 0.5), 9)) <= set(np.round(r.time, 9))


@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_kinks_that_cannot_be_watched_do_not_end_a_run(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An operand that rests a hair beside its kink is on both sides of it to rounding: nothing may hang on it.

    Where `located_kinks` takes one all the same, the run is made without watching, and says so. With x' = 1 from 0 and
    y' = (x - 1)+, y(3) is 2.
    """
    from acausal.lower.variants import watched

    class Resting(Component):
        x: Real = variable(default=fixed(0.0))
        y: Real = variable(default=fixed(0.0))

        def equations(self) -> Equations:
            second = acausal.quantity(1.0, "s")
            yield second * der(self.x) == 1.0
            yield second * der(self.y) == maximum(maximum(self.x - 1.0, 0.0), 1e-300)

    def all_kinks(solution: Any, located: Any, discrete: Any, system: Any, **_: Any) -> LocatedKinks:
        pool = solution.structure.reduced.pool
        nodes = [n for n in pool.reachable(solution.residuals) if pool.nodes[n][0] == "max"]
        nodes += [n for _, d in solution.definitions for n in pool.reachable([d]) if pool.nodes[n][0] == "max"]
        return LocatedKinks(tuple(dict.fromkeys(pool.make("gt", *pool.nodes[n][1:]) for n in nodes)))

    plain = acausal.compile(Resting())
    found = with_watched(plain, 1e-6)[0].state_events.watched
    assert len(found) == 1
    monkeypatch.setattr(watched, "located_kinks", all_kinks)
    compiled = acausal.compile(Resting())
    for _ in range(2):  # a run that goes without watching changes nothing for the next one
        result = acausal.simulate(compiled, stop_time=3.0, solver=solver, tolerance=1e-8)
        assert result.final("y") == pytest.approx(2.0, abs=1e-6)
    assert with_watched(compiled, 1e-6)[0].state_events.watched


@pytest.mark.parametrize("solver", ["idas", "rosenbrock", "cvodes"])
def test_the_drill_of_one_axis_is_not_held_at_its_touch(solver: str) -> None:
    """Its drill is pushed by 2000 N/s from 1 s on: 1 mm with 5 kg takes cbrt(6 m s / (dF/dt)) = 24.66 ms to the touch.

    It hung at 1.0245 s, where forces that are zero until then were watched at 1e-300.
    """
    from acausal.models.drilling_one_axis import OneAxisDrilling

    result = acausal.simulate(OneAxisDrilling(), stop_time=1.1, solver=solver, tolerance=1e-8, output_interval=1e-3)
    touch = 1.0 + (6.0 * 5.0 * 1e-3 / 2000.0) ** (1.0 / 3.0)
    assert result.at(touch, "s") == pytest.approx(0.0, abs=2e-6)
    assert result["s"].max() < 1e-3


Pair = Callable[[Any, Any], Expr]


def outside() -> Callable[[Any], Any]:
    """What is given, computed by a function from outside."""
    u = ca.SX.sym("u")
    return acausal.External("same", lambda: ca.Function("same", [u], [u]), inputs=((),), outputs=((),))


SAME = outside()
BOTH_MOVE: dict[str, Pair] = {
    "maximum": lambda a, b: maximum(a, b) - a,
    "minimum": lambda a, b: b - minimum(a, b),
    "logarithm": lambda a, b: log(maximum(a, b) / a) * a,
    "limits that move": lambda a, b: clamp(b, a, a + 1.0) - a,
    "nested": lambda a, b: maximum(minimum(a, b + 5.0), b) - a,
    "fabs": lambda a, b: 0.5 * fabs(b - a) + 0.5 * b - 0.5 * a,
    "no_event": lambda a, b: where(no_event(b > a), b, a) - a,
    "outside": lambda a, b: maximum(SAME(a), SAME(b)) - a,
    "product": lambda a, b: maximum(a, b) * maximum(a, b) / (2.0 * a) - 0.5 * a,
}


class Overtaken(Component):
    """b = a + x - c overtakes a while x = sin(t) > c: y' is (x - c)+, up to a hundred-thousandth of itself."""

    rate: Pair = structural(default=BOTH_MOVE["maximum"])
    iterated: bool = structural(default=False)
    c: Real = parameter(default=0.99999)
    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))
    p: Real = variable(default=fixed(0.3))
    a: Real = variable()
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        h = math.acos(0.99999)
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield der(self.p) == 0.3 * cos(0.6 * time)
        yield self.a == 10.0 + self.p if not self.iterated else self.a + 0.1 * self.a**3 == 10.0 + self.p
        yield der(self.y) == self.rate(self.a, self.a + self.x - self.c) / (2.0 * (math.sin(h) - h * 0.99999))


@pytest.mark.parametrize("rate", BOTH_MOVE.values(), ids=BOTH_MOVE)
@pytest.mark.parametrize("solver", ["idas", "erk"])
def test_kinks_whose_sides_both_move(solver: str, rate: Pair) -> None:
    r = acausal.simulate(Overtaken(rate=rate), stop_time=9.0, solver=solver, output_interval=9.0, tolerance=1e-8)
    assert r.final("y") == pytest.approx(2.0, abs=1e-2)
    assert not r.events


@pytest.mark.parametrize("solver", SOLVERS)
def test_kinks_whose_sides_both_move_and_are_iterated(solver: str) -> None:
    r = acausal.simulate(Overtaken(iterated=True), stop_time=9.0, solver=solver, tolerance=1e-8)
    assert r.final("y") == pytest.approx(2.0, abs=1e-2)
