"""Events known in advance: where they are, that both sides of them are in the result, and that nothing is missed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    clamp,
    der,
    fixed,
    maximum,
    minimum,
    parameter,
    sign,
    structural,
    time,
    variable,
    where,
)

Waveform = Callable[["Source"], Expr]


class Source(Component):
    """x follows y, w only sums it up: one goes through the solver, the other is integrated apart."""

    waveform: Waveform = structural()
    t0: Real = parameter(default=0.3)
    t1: Real = parameter(default=0.301)
    y: Real = variable()
    x: Real = variable(default=fixed(0.0))
    w: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield self.y == self.waveform(self)
        yield der(self.x) == self.y - self.x
        yield der(self.w) == self.y


def followed(pieces: list[tuple[float, float, float]], end: float) -> tuple[float, float]:
    """x(end), w(end) for y = a + b (t - start) on pieces (start, a, b), the last to the end."""
    x = w = 0.0
    stops = [p[0] for p in pieces[1:]] + [end]
    for (start, a, b), stop in zip(pieces, stops, strict=True):
        h = stop - start
        # x' = a + b s - x has the particular solution a - b + b s.
        x = (x - a + b) * math.exp(-h) + a - b + b * h
        w += a * h + b * h * h / 2
    return x, w


CASES: list[tuple[str, Waveform, list[tuple[float, float, float]]]] = [
    ("step", lambda s: where(time < s.t0, 0.0, 1.0), [(0, 0, 0), (0.3, 1, 0)]),
    ("step, other side", lambda s: where(s.t0 < time, 1.0, 0.0), [(0, 0, 0), (0.3, 1, 0)]),
    ("factor", lambda s: where(2 * time - 0.6 >= 0.0, 1.0, 0.0), [(0, 0, 0), (0.3, 1, 0)]),
    (
        "pulse of a millisecond",
        lambda s: where(time < s.t0, 0.0, where(time < s.t1, 1000.0, 0.0)),
        [(0, 0, 0), (0.3, 1000, 0), (0.301, 0, 0)],
    ),
    (
        "pulse by and",
        lambda s: where((time >= s.t0) & (time < s.t1), 1000.0, 0.0),
        [(0, 0, 0), (0.3, 1000, 0), (0.301, 0, 0)],
    ),
    (
        "gap by or and not",
        lambda s: where(~((time < s.t0) | (time > 0.6)), 0.0, 2.0),
        [(0, 2, 0), (0.3, 0, 0), (0.6, 2, 0)],
    ),
    (
        "ramp",
        lambda s: where(time < s.t0, 0.0, where(time < 0.8, (time - s.t0) / 0.5, 1.0)),
        [(0, 0, 0), (0.3, 0, 2), (0.8, 1, 0)],
    ),
    ("maximum", lambda s: maximum(time, s.t0), [(0, 0.3, 0), (0.3, 0.3, 1)]),
    ("minimum", lambda s: minimum(s.t0, time), [(0, 0, 1), (0.3, 0.3, 0)]),
    ("fabs", lambda s: abs(time - s.t0), [(0, 0.3, -1), (0.3, 0, 1)]),
    ("sign", lambda s: sign(time - s.t0), [(0, -1, 0), (0.3, 1, 0)]),
    ("at the start and at the end", lambda s: where(time < 0.0, 9.0, where(time >= 1.0, 9.0, 1.0)), [(0, 1, 0)]),
    ("long ago", lambda s: where(time < -5.0, 9.0, 1.0), [(0, 1, 0)]),
]


@pytest.mark.parametrize(("waveform", "pieces"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_nothing_is_missed(waveform: Waveform, pieces: list[tuple[float, float, float]], solver: str) -> None:
    result = acausal.simulate(Source(waveform=waveform), stop_time=1.0, tolerance=1e-9, solver=solver)
    x, w = followed(pieces, 1.0)
    assert result.final("x") == pytest.approx(x, abs=2e-8)
    assert result.final("w") == pytest.approx(w, abs=1e-9)
    assert [e.time for e in result.events] == pytest.approx([p[0] for p in pieces[1:]], abs=1e-15)


@pytest.mark.parametrize(("waveform", "pieces"), [c[1:] for c in CASES[:11]], ids=[c[0] for c in CASES[:11]])
def test_both_sides_are_in_the_result(waveform: Waveform, pieces: list[tuple[float, float, float]]) -> None:
    """Each event has two rows of one time: y before and y after it, x the same in both."""
    result = acausal.simulate(Source(waveform=waveform), stop_time=1.0)
    twice = np.flatnonzero(np.diff(result.time) == 0)
    assert len(twice) == len(pieces) - 1
    for k, before, after in zip(twice, pieces[:-1], pieces[1:], strict=True):
        assert result["y"][k] == pytest.approx(before[1] + before[2] * (after[0] - before[0]), abs=1e-12)
        assert result["y"][k + 1] == pytest.approx(after[1], abs=1e-12)
        assert result["x"][k] == result["x"][k + 1]
        assert result.at(after[0], "y") == pytest.approx(after[1], abs=1e-12)


def test_events_move_with_parameters() -> None:
    compiled = acausal.compile(Source(waveform=CASES[3][1]))
    for t0 in (0.1, 0.7, 2.0):
        result = acausal.simulate(compiled, stop_time=1.0, parameters={"t0": t0, "t1": t0 + 0.002})
        assert result.final("w") == pytest.approx(2.0 if t0 < 1 else 0.0, abs=1e-8)
        assert len(result.events) == (2 if t0 < 1 else 0)


def test_events_at_one_instant_are_one() -> None:
    """A pulse of no width, and two relations that switch together."""
    compiled = acausal.compile(Source(waveform=CASES[3][1]))
    result = acausal.simulate(compiled, stop_time=1.0, parameters={"t1": 0.3})
    assert [e.time for e in result.events] == [0.3]
    assert result.final("w") == pytest.approx(0.0, abs=1e-12)


def test_a_run_may_start_anywhere() -> None:
    """From 0.5 on the step has happened: x = 1 - exp(-(t - 0.5))."""
    result = acausal.simulate(Source(waveform=CASES[0][1]), start_time=0.5, stop_time=1.0, tolerance=1e-9)
    assert result.final("x") == pytest.approx(1 - math.exp(-0.5), abs=1e-8)
    assert not result.events


class Position(Component):
    """A prescribed position: its speed jumps, its acceleration is that of the two sides."""

    s: Real = variable()
    v: Real = variable()

    def equations(self) -> Equations:
        yield self.s == where(time < 0.5, time, 0.5 + 2 * (time - 0.5))
        yield self.v == der(self.s)


def test_derivatives_of_branches() -> None:
    result = acausal.simulate(Position(), stop_time=1.0)
    assert result.at(0.2, "v") == 1.0
    assert result.at(0.5, "v") == 2.0
    assert result.at(0.9, "s") == pytest.approx(1.3)
    k = int(np.flatnonzero(np.diff(result.time) == 0)[0])
    assert (result["v"][k], result["v"][k + 1]) == (1.0, 2.0)


def test_a_limited_ramp_is_cut_where_it_begins() -> None:
    """clamp is a minimum of a maximum: its inner kink is an event, the outer one is left to the solver's steps."""
    result = acausal.simulate(
        Source(waveform=lambda s: clamp((time - s.t0) / 0.5, 0.0, 1.0)), stop_time=1.0, tolerance=1e-9
    )
    x, w = followed([(0, 0, 0), (0.3, 0, 2), (0.8, 1, 0)], 1.0)
    assert result.final("x") == pytest.approx(x, abs=2e-8)
    assert result.final("w") == pytest.approx(w, abs=1e-8)


def test_a_table_of_many_events() -> None:
    """A staircase of 200 steps of width 5 ms: w is the sum, whatever the steps of the solver."""

    def stairs(_: Source) -> Expr:
        level: Expr = acausal.as_expr(199.0)
        for k in reversed(range(199)):
            level = where(time < 0.005 * (k + 1), float(k), level)
        return level

    result = acausal.simulate(Source(waveform=stairs), stop_time=1.0)
    assert len(result.events) == 199
    assert result.final("w") == pytest.approx(0.005 * sum(range(200)), rel=1e-9)
