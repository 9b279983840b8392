"""Runs that start exactly on a guard, as the spools of MSL's PreLoad between their contacts do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part
from acausal.library.translational import ElastoGap, Fixed, Mass, Spring

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
    for stop, rows in ((0.1, 200), (0.1, 7), (0.0777, 50), (0.031, 3)):
        r = acausal.simulate(compiled, stop_time=stop, output_interval=stop / rows, solver=solver, tolerance=1e-8)
        s, ends = exact(v0, r.time)
        np.testing.assert_allclose(r["spool.s"], s, atol=1e-7)
        found = [e.time for e in r.events if e.time > 1e-9]
        np.testing.assert_allclose(found, ends, atol=1e-6)
