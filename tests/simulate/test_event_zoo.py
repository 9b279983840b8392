"""Hybrid models with closed forms, with every solver and on output grids of 1, 100 and 10 000 intervals.

What is asked for: end values within ten tolerances, and the same events at the same instants on every grid.
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    change,
    cos,
    der,
    discrete,
    equals,
    fixed,
    integer,
    pre,
    reset,
    sample,
    time,
    variable,
    when,
    where,
)

_TOLERANCE = 1e-8


class Corner(Component):
    """A ball that hits two walls of a square at the same instants: t = 1, 3, 5."""

    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(1.0))
    u: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(1.0))
    hits: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield der(self.y) == self.v
        yield der(self.u) == 0.0
        yield der(self.v) == 0.0
        yield when((self.x > 2.0, self.x < 0.0), reset(self.u, -pre(self.u)), reset(self.hits, pre(self.hits) + 1))
        yield when((self.y > 2.0, self.y < 0.0), reset(self.v, -pre(self.v)))


class TwoRates(Component):
    """Two clocks of 0.1 s and 0.03 s, which coincide at 0, 0.3, 0.6, 0.9 s."""

    a: Real = discrete()
    b: Real = discrete()
    both: Real = integer()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.a - self.b
        yield when(sample(0.0, 0.1), reset(self.a, self.x + 1.0))
        yield when(sample(0.0, 0.03), reset(self.b, 0.5 * pre(self.a)))
        yield when(sample(0.0, 0.1) & sample(0.0, 0.03), reset(self.both, pre(self.both) + 1))


def two_rates() -> dict[str, float]:
    """The recursion of the two clocks, in rational instants."""
    instants = sorted({Fraction(k, 10) for k in range(11)} | {Fraction(3 * k, 100) for k in range(34)})
    a = b = x = both = 0.0
    for here, there in pairwise([*instants, Fraction(1)]):
        slow, quick = (here * 10).denominator == 1, (here * 100 / 3).denominator == 1
        a, b = x + 1.0 if slow else a, 0.5 * a if quick else b
        both += slow and quick
        x += (a - b) * float(there - here)
    return {"a": a, "b": b, "x": x, "both": both}


class Swap(Component):
    """Three states are reset at one event, each from the values before it: t = 2, 3, 4."""

    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(3.0))
    z: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield der(self.y) == -1.0
        yield der(self.z) == self.z
        yield when(self.x > 2.0, reset(self.x, pre(self.y)), reset(self.y, pre(self.x)), reset(self.z, 1.0))


class Machine(Component):
    """Up to 1, down twice as fast to -1, up half as fast to 0, and again: changes at 1, 2, 4, 5, 6, 8, 9 s."""

    mode: Real = integer()
    visits: Real = integer()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == where(equals(self.mode, 0), 1.0, where(equals(self.mode, 1), -2.0, 0.5))
        yield when(equals(self.mode, 0) & (self.x > 1.0), reset(self.mode, 1))
        yield when(equals(self.mode, 1) & (self.x < -1.0), reset(self.mode, 2))
        yield when(equals(self.mode, 2) & (self.x > 0.0), reset(self.mode, 0))
        yield when(change(self.mode), reset(self.visits, pre(self.visits) + 1))


class Latch(Component):
    """Two discrete equations, one of which remembers: q is on from sin t = 0.9 until sin t = -0.9."""

    t: Real = variable()
    x: Real = variable(default=fixed(0.0))
    area: Real = variable(default=fixed(0.0))
    q: Real = boolean()
    p: Real = boolean()

    def equations(self) -> Equations:
        yield self.t == time
        yield der(self.x) == cos(self.t)
        yield self.q == ((self.x > 0.9) | (pre(self.q) & ~(self.x < -0.9)))
        yield self.p == (~self.q & (self.x > 0.0))
        yield der(self.area) == where(self.p, 1.0, where(self.q, 10.0, 0.0))


_ON = math.asin(0.9)
CASES: dict[str, tuple[type[Component], float, dict[str, float], list[float] | None]] = {
    "corner": (Corner, 6.5, {"x": 0.5, "y": 0.5, "hits": 3.0}, [1.0, 3.0, 5.0]),
    "two rates": (TwoRates, 1.0, two_rates(), None),
    "swap": (Swap, 4.5, {"x": 1.5, "y": 1.5, "z": math.exp(0.5)}, [2.0, 3.0, 4.0]),
    "machine": (Machine, 9.3, {"x": 0.4, "mode": 1.0, "visits": 7.0}, None),
    "latch": (Latch, 10.0, {"area": 2 * _ON + 10 * (math.pi + 10.0 - 2 * math.pi - _ON)}, None),
}


@pytest.mark.parametrize("solver", ["rosenbrock", "erk", "idas", "cvodes"])
@pytest.mark.parametrize("case", CASES)
def test_end_values_and_events_do_not_depend_on_the_grid(case: str, solver: str) -> None:
    model, stop, ends, instants = CASES[case]
    compiled = acausal.compile(model())
    seen = []
    for points in (1, 100, 700):
        result = acausal.simulate(
            compiled,
            stop_time=stop,
            output_interval=stop / points,
            tolerance=_TOLERANCE,
            solver=solver,
            native=False,
        )
        for name, value in ends.items():
            assert result.final(name) == pytest.approx(value, abs=10 * _TOLERANCE * (1 + abs(value))), name
        seen.append([event.time for event in result.events])
    if instants is not None:
        assert seen[0] == pytest.approx(instants, abs=10 * _TOLERANCE)
    assert seen[1] == pytest.approx(seen[0], abs=10 * _TOLERANCE)
    assert seen[2] == pytest.approx(seen[0], abs=10 * _TOLERANCE)
