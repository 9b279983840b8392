"""Every row stands at its own time, also where a run goes on an ulp beside an output time."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed
from acausal.library.multibody import PointMass, Spring, World
from acausal.simulate.driver.missed.missed_events import _distinct_stops

G = np.array([0.0, -9.80665, 0.0])
REST = fixed((0.0, 0.0, 0.0))


class Thrown(Component):
    """Two masses on a spring, whose length is a root: a steep function, between whose rows runs look again."""

    world: World = World()
    a: PointMass = PointMass(m=1.0, r_0=fixed((1.0, 0.0, 0.0)), v_0=REST)
    b: PointMass = PointMass(m=2.0, r_0=REST, v_0=REST)
    spring: Spring = Spring(c=30.0, s_unstretched=1.0)

    def equations(self) -> Equations:
        yield connect(self.a.frame_a, self.spring.frame_a)
        yield connect(self.b.frame_a, self.spring.frame_b)


def test_the_centre_of_mass_of_thrown_bodies_flies_a_parabola() -> None:
    """Newton's laws. Of 60 random throws these lost a row: all before it stood at the time of the next one."""
    model = acausal.compile(Thrown())
    for seed, interval in ((10, 0.05), (11, 0.02), (29, 0.05)):
        rng = np.random.default_rng(seed)
        rng.choice(4)
        places, speeds = rng.normal(size=(2, 3)), 2.0 * rng.normal(size=(2, 3))
        start = {
            f"{body}.{name}[{k}]": float(values[i, k])
            for name, values in (("r_0", places), ("v_0", speeds))
            for i, body in enumerate("ab")
            for k in range(3)
        }
        r = acausal.simulate(
            model, stop_time=3.0, output_interval=interval, solver="cvodes", tolerance=1e-8, start=start
        )
        assert len(r.time) == round(3.0 / interval) + 1
        t, shares = r.time[:, None], np.array([1.0, 2.0]) / 3.0
        expected = shares @ places + shares @ speeds * t + G / 2.0 * t**2
        assert (r["a.r_0"] + 2.0 * r["b.r_0"]) / 3.0 == pytest.approx(expected, abs=1e-6)


def test_the_last_row_of_a_stretch_is_reached() -> None:
    """Stops less than a millionth of the stretch before its end are left out, not the end."""
    rows = np.array([0.0, 0.5, 1.0 - 1e-9, 1.0])
    assert _distinct_stops(np.array([0.3, 1.0 - 1e-9]), rows) == [0.3, 1.0]
