"""Runs that start exactly on a guard, as the spools of MSL's PreLoad between their contacts do."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part
from acausal.library.blocks import Sine
from acausal.library.translational import Damper, ElastoGap, Fixed, Force, Mass, Rod, Spring

M, SPRING, CONTACT = 0.15, 2e3, 1e6
Times = NDArray[np.float64]


class Touching(Component):
    """A spool on a relaxed spring that just touches an elastic contact, at `v0` towards it (< 0) or away."""

    v0: Real = parameter(default=0.1)
    spool: Mass = part()
    spring: Spring = Spring(c=SPRING)
    gap: ElastoGap = ElastoGap(c=CONTACT, d=0.0)
    wall: Fixed = Fixed()

    def build(self) -> None:
        self.spool = Mass(m=M, s=fixed(0.0), v=fixed(self.v0))

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.gap.flange_a, self.spring.flange_a)
        yield connect(self.gap.flange_b, self.spring.flange_b, self.spool.flange_a)


def exact(v0: float, t: Times) -> tuple[Times, list[float]]:
    """Half swings at sqrt(k/m) in turn, with the contact and without it; and where they end."""
    free, pressed = math.sqrt(SPRING / M), math.sqrt((SPRING + CONTACT) / M)
    s, began, inside, ends = np.zeros_like(t), 0.0, v0 < 0.0, [0.0]
    while began < t[-1]:
        w = pressed if inside else free
        here = (t >= began) & (t <= began + math.pi / w)
        s[here] = (-1.0 if inside else 1.0) * abs(v0) / w * np.sin(w * (t[here] - began))
        began, inside = began + math.pi / w, not inside
        ends.append(began)
    return s, [e for e in ends[1:] if e < t[-1]]


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("v0", [0.1, -0.1])
def test_a_spool_that_just_touches(solver: str, v0: float) -> None:
    """Events and positions depend neither on the stop time nor on the rows."""
    compiled = acausal.compile(Touching(v0=v0))
    for stop, rows in ((0.1, 100), (0.0777, 7), (0.031, 3)):
        r = acausal.simulate(compiled, stop_time=stop, output_interval=stop / rows, solver=solver, tolerance=1e-8)
        s, ends = exact(v0, r.time)
        np.testing.assert_allclose(r["spool.s"], s, atol=1e-7)
        found = [e.time for e in r.events if e.time > 1e-9]
        np.testing.assert_allclose(found, ends, atol=1e-6)


class PreLoad(Component):
    """Modelica.Mechanics.Translational.Examples.PreLoad: a spool between two plates on one preloaded spring.

    At the start the plate on the right of `outer_a` and the spool stand exactly where their contacts begin.
    """

    spool: Mass = Mass(L=0.19, m=M, s=fixed(0.01475), v=fixed(0.0))
    plate_a: Mass = part()
    plate_b: Mass = part()
    inner_a: ElastoGap = part()
    inner_b: ElastoGap = part()
    outer_a: ElastoGap = part()
    outer_b: ElastoGap = part()
    spring: Spring = Spring(c=20e3, s_rel0=0.025)
    friction: Damper = Damper(d=2500.0)
    # both sides of the spool, both pushers of the plates, and the housing
    rods: tuple[Rod, ...] = part()
    wall: Fixed = Fixed(s0=-0.0955)
    force: Force = Force()
    sine: Sine = Sine(amplitude=150.0, f=0.01)

    def build(self) -> None:
        self.plate_a, self.plate_b = (Mass(L=0.002, m=0.01, s=fixed(s), v=fixed(0.0)) for s in (-0.093, -0.06925))
        self.inner_a, self.inner_b, self.outer_a, self.outer_b = (
            ElastoGap(c=CONTACT, d=250.0, s_rel0=gap) for gap in (0.001, 0.001, 0.0015, 0.0015)
        )
        self.rods = tuple(Rod(L=length) for length in (0.00575, 0.00575, 0.007, 0.007, 0.0305))

    def equations(self) -> Equations:
        left, right, push_a, push_b, housing = self.rods
        yield connect(self.wall.flange, self.outer_a.flange_a, housing.flange_a, self.friction.flange_a)
        yield connect(self.outer_a.flange_b, self.plate_a.flange_a)
        yield connect(self.plate_a.flange_b, self.spring.flange_a, push_a.flange_a)
        yield connect(self.spring.flange_b, self.plate_b.flange_a, push_b.flange_b)
        yield connect(self.plate_b.flange_b, self.outer_b.flange_a)
        yield connect(self.outer_b.flange_b, housing.flange_b)
        yield connect(self.inner_a.flange_a, left.flange_a, self.friction.flange_b)
        yield connect(self.inner_a.flange_b, push_a.flange_b)
        yield connect(push_b.flange_a, self.inner_b.flange_a)
        yield connect(right.flange_b, self.inner_b.flange_b)
        yield connect(left.flange_b, right.flange_a, self.spool.flange_a, self.force.flange)
        yield connect(self.sine.y, self.force.u)


@cache
def preload(times: tuple[float, ...]) -> Times:
    """Positions of the spool's middle from its equations of motion written by hand: SciPy's Radau at 1e-7 and 1e-10."""

    def contact(gap: float, rate: float, free: float) -> float:
        pressed = max(free - gap, 0.0)
        return CONTACT * pressed - min(max(250.0 * rate, -CONTACT * pressed), CONTACT * pressed)

    def rates(t: float, y: Times) -> list[float]:
        # left flanges of the spool, and middles of both plates, from the wall
        s, v, a, va, b, vb = y
        inner_a = contact(a + 0.001 + 0.007 - (s - 0.00575), va - v, 0.001)
        inner_b = contact(s + 0.00575 - (b - 0.001 - 0.007), v - vb, 0.001)
        outer_a = contact(a - 0.001, va, 0.0015)
        outer_b = contact(0.0305 - (b + 0.001), -vb, 0.0015)
        spring = 20e3 * ((b - 0.001) - (a + 0.001) - 0.025)
        f = 150.0 * math.sin(2.0 * math.pi * 0.01 * t) - 2500.0 * v
        spool = (f - inner_a + inner_b) / M
        return [v, spool, va, (outer_a + inner_a + spring) / 0.01, vb, (-outer_b - inner_b - spring) / 0.01]

    start = [0.01475 - 0.095 + 0.0955, 0.0, -0.093 + 0.0955, 0.0, -0.06925 + 0.0955, 0.0]
    found = solve_ivp(rates, (0.0, times[-1]), start, "Radau", times, rtol=1e-7, atol=1e-10, max_step=0.5)
    return np.asarray(found.y[0] - 0.0955 + 0.095)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
def test_preload_of_msl(solver: str) -> None:
    """Its published numbers, and its own stop time and output interval among others: neither changes what is found."""
    compiled = acausal.compile(PreLoad())
    times = (0.0, 1e-3, 1.0, 3.2, 10.0, 25.0, 36.9, 55.0, 80.0, 99.9)
    expected = preload(times)
    events = []
    for stop, interval in ((100.0, 0.1), (100.0, 7.3), (37.0, 0.1)):
        r = acausal.simulate(compiled, stop_time=stop, output_interval=interval, solver=solver, tolerance=1e-6)
        reached = [t for t in times if t < stop]
        assert [r.at(t, "spool.s") for t in reached] == pytest.approx(expected[: len(reached)].tolist(), abs=2e-7)
        events.append([e.time for e in r.events if e.time < 36.9])
    assert len(events[0]) == 4
    for other in events[1:]:
        assert other == pytest.approx(events[0], abs=1e-6)
