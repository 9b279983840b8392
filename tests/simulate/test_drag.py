"""Drag, `v' = ... - c * v * abs(v)`: its kink has one slope and is left to the error control; others are located."""

from __future__ import annotations

import math

import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, structural, time, variable
from acausal.lower.variants.watched import with_watched

G, V0 = 9.81, 20.0


class Thrown(Component):
    """A body thrown up through air."""

    c: Real = parameter(default=0.02)
    h: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(V0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -G - self.c * self.v * abs(self.v)


class Reader(Thrown):
    """The same, with an integral of the drag that may be large where the drag itself is small."""

    q: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.q) == self.v * abs(self.v)


class Dip(Component):
    """w dips below zero between t = 1 and 1.2, and w abs(w) or abs(w) is integrated."""

    square: bool = structural(default=True)
    w: Real = variable(default=fixed(0.6))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.w) == time - 1.1
        yield der(self.y) == (self.w * abs(self.w) if self.square else abs(self.w))


CASES = [(solver, c) for c in (0.02, 2.0, 2e4) for solver in ("idas", "cvodes", "rosenbrock", "erk")]
CASES.remove(("erk", 2e4))  # stiff


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
@pytest.mark.parametrize(("solver", "c"), CASES)
def test_a_throw_through_air(solver: str, tolerance: float, c: float) -> None:
    """Closed forms: up v = V tan((t1 - t)/T), down v = -V tanh((t - t1)/T) with V^2 = g/c and T = V/g."""
    terminal = math.sqrt(G / c)
    scale = terminal / G
    turn, top = scale * math.atan(V0 / terminal), math.log(1.0 + (V0 / terminal) ** 2) / (2.0 * c)
    end = turn + 2.0 * scale
    model = Thrown(c=c)
    r = acausal.simulate(model, stop_time=end, solver=solver, tolerance=tolerance, output_interval=end)
    assert r.final("v") == pytest.approx(-terminal * math.tanh(2.0), rel=10.0 * tolerance)
    h = top - terminal * scale * math.log(math.cosh(2.0))
    assert r.final("h") == pytest.approx(h, abs=10.0 * tolerance * max(top, 1.0))


def test_only_the_kink_of_drag_is_not_located() -> None:
    compiled = acausal.compile(Thrown())
    assert not with_watched(compiled, 1e-6)[0].state_events.watched
    assert with_watched(compiled, 1e-6, branches=True)[0].state_events.watched
    assert with_watched(acausal.compile(Reader()), 1e-6)[0].state_events.watched


@pytest.mark.parametrize("square", [True, False])
def test_a_dip_that_is_integrated_is_located(square: bool) -> None:
    """w = (t - 1)(t - 1.2)/2 dips by d = 0.005 for 0.2 s: twice 2/3 d 0.2 is added, or 8/15 d^2 0.2 is taken away."""
    compiled = acausal.compile(Dip(square=square))
    assert with_watched(compiled, 1e-6)[0].state_events.watched
    polynomial = [0.36, -1.32, 1.81, -1.1, 0.25] if square else [0.6, -1.1, 0.5]
    dip = -2.0 * 8.0 / 15.0 * 0.2 * 0.005**2 if square else 2.0 * 2.0 / 3.0 * 0.2 * 0.005
    y = dip + sum(a * 1.5 ** (k + 1) / (k + 1) for k, a in enumerate(polynomial))
    r = acausal.simulate(compiled, stop_time=1.5, solver="erk", tolerance=1e-10, output_interval=1.5)
    assert r.final("y") == pytest.approx(y, abs=1e-10)
