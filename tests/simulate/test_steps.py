"""`floor` and `ceil` jump, so they make events (Modelica 3.6, section 3.7.2); against areas in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    ceil,
    der,
    discrete,
    fixed,
    floor,
    integer,
    no_event,
    parameter,
    reset,
    sample,
    time,
    variable,
    when,
)

SOLVERS = ("idas", "rosenbrock", "cvodes", "erk")


class Swing(Component):
    """x = a*sin(t), and the areas below and above it in whole numbers."""

    a: Real = parameter(default=2.5)
    x: Real = variable()
    below: Real = variable(default=fixed(0.0))
    above: Real = variable(default=fixed(0.0))
    n: Real = integer()
    s: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield der(self.v) == -self.s
        yield self.x == self.a * self.s
        yield der(self.below) == floor(self.x)
        yield der(self.above) == ceil(self.x)
        yield self.n == floor(self.x)


def area(rounded: Callable[[float], int], stop: float, a: float = 2.5) -> float:
    """Integral of floor or ceil of a*sin(t) up to a time: between the roots of a*sin(t) = k it is constant."""
    roots = {0.0, stop}
    for k in range(-2, 3):
        for turn in range(-1, 8):
            angle = math.asin(k / a)
            roots |= {angle + 2.0 * math.pi * turn, math.pi - angle + 2.0 * math.pi * turn}
    at = sorted(t for t in roots if 0.0 <= t <= stop)
    return sum(rounded(a * math.sin((p + q) / 2.0)) * (q - p) for p, q in pairwise(at))


@pytest.mark.parametrize("solver", SOLVERS)
def test_both_directions_are_exact(solver: str) -> None:
    result = acausal.simulate(Swing(), stop_time=30.0, tolerance=1e-10, solver=solver)
    assert result.final("below") == pytest.approx(area(math.floor, 30.0), abs=1e-8)
    assert result.final("above") == pytest.approx(area(math.ceil, 30.0), abs=1e-8)
    assert result.final("n") == math.floor(2.5 * math.sin(30.0))
    # five whole numbers, each passed twice per turn, the zero at the start not once more
    assert len(result.events) == 47


class Square(Component):
    """z' = floor(5*x^2), x' = 1."""

    start: Real = parameter(default=0.0)
    x: Real = variable()
    z: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.z) == floor(5.0 * self.x**2)

    def initial_equations(self) -> Equations:
        yield self.x == self.start


@pytest.mark.parametrize("start", [0.0, 1.21, -1.33])
@pytest.mark.parametrize("native", [False, True])
def test_it_starts_on_any_step(start: float, native: bool) -> None:
    """Roots of 5*x^2 = k; 1.21 starts on the seventh step, -1.33 on the eighth, going down and up again."""
    stop = 2.9
    roots = [sign * math.sqrt(k / 5.0) for k in range(90) for sign in (-1.0, 1.0)]
    at = sorted({start, start + stop, *(x for x in roots if start < x < start + stop)})
    expected = sum(math.floor(5.0 * ((p + q) / 2.0) ** 2) * (q - p) for p, q in pairwise(at))
    model = acausal.compile(Square(), parameters={"start": start})
    result = acausal.simulate(model, stop_time=stop, tolerance=1e-9, native=native)
    assert result.final("z") == pytest.approx(expected, abs=1e-8)


class Jumping(Component):
    """x jumps over seven steps at once."""

    x: Real = variable(default=fixed(0.2))
    y: Real = variable()
    z: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == floor(self.x)
        yield der(self.z) == self.y
        yield when(self.x > 0.6, reset(self.x, 8.1))


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_jump_over_many_steps(solver: str) -> None:
    """0 up to 0.4 s, 8 up to 1.3 s, 9 up to 2 s."""
    result = acausal.simulate(Jumping(), stop_time=2.0, tolerance=1e-9, solver=solver)
    assert result.final("z") == pytest.approx(0.9 * 8.0 + 0.7 * 9.0, abs=1e-8)
    assert len(result.events) == 2


class Quantised(Component):
    """A converter with a clock, and a kink that nobody wants to have located."""

    x: Real = variable(default=fixed(0.0))
    y: Real = discrete()
    rough: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 100.0
        yield self.rough == no_event(floor(2.0 * self.x))
        yield when(sample(0.1, 0.1), reset(self.y, floor(self.x + 0.5)))


def test_only_what_acts_between_events_is_located() -> None:
    result = acausal.simulate(Quantised(), stop_time=1.05)
    assert result.final("y") == 100.0
    assert len(result.events) == 10


class Saw(Component):
    """time mod 0.3, which no binary number is."""

    y: Real = variable(unit="s")
    z: Real = variable(default=fixed(0.0), unit="s2")

    def equations(self) -> Equations:
        yield self.y == time - 0.3 * floor(time / 0.3)
        yield der(self.z) == self.y


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_saw_tooth(solver: str) -> None:
    result = acausal.simulate(Saw(), stop_time=3.1, tolerance=1e-9, solver=solver)
    assert result.final("z") == pytest.approx(10 * 0.3**2 / 2.0 + 0.1**2 / 2.0, abs=1e-8)


def test_exported_functions_know_the_step_at_once() -> None:
    model = acausal.compile(Swing()).casadi(["below"])
    x = [0.0] * len(model.x)
    x[model.x.position("s")] = 0.9
    rates = dict(zip([port.name for port in model.x], model.ode(x, [], model.p.start)[0].full().ravel(), strict=True))
    assert (rates["below"], rates["above"]) == (2.0, 3.0)


def test_sensitivity_of_an_area() -> None:
    """Of the area up to t = 1.5 by a: the steps 1 and 2 begin at asin(k/a), d/da = k/(a*sqrt(a^2 - k^2))."""
    found = acausal.sensitivities(Swing(), ["a"], ["below"], stop_time=1.5, tolerance=1e-11)
    expected = sum(k / (2.5 * math.sqrt(2.5**2 - k**2)) for k in (1, 2))
    assert found.final[0][0] == pytest.approx(expected, abs=1e-8)
