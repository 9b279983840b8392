"""Peck drilling: a given feed goes in, out and in again, and the ground of the hole is all that moves by itself."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, sin, time
from acausal.library.contact import Box
from acausal.library.drilling import ConvexLevel, DrillingForce, Workpiece
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Position
from tests.accuracy.drilling_reference import PlainDrilling
from tests.marks import slow_but

PLAIN = PlainDrilling(((0.0, 0.0), (1.0, 0.0)), ((0.0, 9.28), (1.0, 9.28)))
START, FEED, DEPTH, RATE = -3e-3, 0.8e-3, 4e-3, 1.0


class PeckDrilling(Component):
    """The tip at -3 mm + 0.8 mm/s t + 4 mm sin(t): it comes back to the ground four times in 20 s."""

    rate: Real = parameter(default=RATE, unit="1/s")
    world: World = World(g=0.0)
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: DrillingForce = part()
    workpiece: Workpiece = part()
    feed: Position = part()
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.slide = Prismatic(n=axis)
        self.spindle = Revolute(n=axis, phi=fixed(0.0))
        self.workpiece = Workpiece(t=PLAIN.t)
        self.drill = DrillingForce(t=self.workpiece.t, k=PLAIN.k, d_c=PLAIN.d_c, feed_force_factor=PLAIN.factor)
        start, feed, depth = quantity(START, "m"), quantity(FEED, "m/s"), quantity(DEPTH, "m")
        self.feed = Position(s_ref=start + feed * time + depth * sin(self.rate * time))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


@cache
def by_hand(rate: float, stop: float) -> tuple[float, float]:
    """Depth of the ground at the end [m] and the largest thrust [N]: the plain law, in steps that see every contact."""

    def tip(t: float) -> tuple[float, float]:
        return START + FEED * t + DEPTH * math.sin(rate * t), FEED + DEPTH * rate * math.cos(rate * t)

    def contact(t: float, s_tar: float) -> tuple[float, float]:
        s, v = tip(t)
        return PLAIN.contact(s, v, s_tar, 9.28, s > 0)

    found = solve_ivp(
        lambda t, x: [contact(t, x[0])[1]], (0.0, stop), [0.0], method="Radau", rtol=1e-9, atol=1e-13, max_step=5e-3
    )
    thrust = max(contact(t, x)[0] for t, x in zip(found.t, found.y[0], strict=True))
    return float(found.y[0, -1]), thrust


@pytest.fixture(scope="module")
def reference() -> tuple[float, float]:
    return by_hand(RATE, 20.0)


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock"])  # "auto" is one of them
@pytest.mark.parametrize("run", slow_but([{}, {"tolerance": 1e-9}, {"output_interval": 2.5}], {}))
def test_no_contact_is_stepped_over(solver: str, run: dict[str, Any], reference: tuple[float, float]) -> None:
    r = acausal.simulate(PeckDrilling(), stop_time=20.0, solver=solver, **run)
    assert r.final("drill.s_tar") == pytest.approx(reference[0], abs=2e-8)
    if "output_interval" not in run:
        assert float(np.max(r["drill.thrust"])) == pytest.approx(reference[1], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["idas", "rosenbrock"])
@pytest.mark.parametrize(("rate", "stop"), [(0.3, 9.0), (7.0, 3.0)])
def test_slow_and_fast_pecks(solver: str, rate: float, stop: float) -> None:
    r = acausal.simulate(PeckDrilling(rate=rate), stop_time=stop, solver=solver)
    assert r.final("drill.s_tar") == pytest.approx(by_hand(rate, stop)[0], abs=1e-7)


class BothMove(Component):
    """The same contact with a box as workpiece that moves too, by -2 mm sin(0.7 t), and the drill with it."""

    world: World = World(g=0.0)
    slide: Prismatic = part()
    lift: Prismatic = part()
    spindle: Revolute = part()
    drill: DrillingForce = part()
    workpiece: Workpiece = Workpiece(t=PLAIN.t)
    feed: Position = part()
    lifting: Position = part()
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)

    def build(self) -> None:
        axis = (0.0, 0.0, 1.0)
        self.slide, self.lift = Prismatic(n=axis), Prismatic(n=axis)
        self.spindle = Revolute(n=axis, phi=fixed(0.0))
        box = ConvexLevel(Box((0.1, 0.1, PLAIN.t)), ((0.0, 0.0, PLAIN.t / 2), IDENTITY), "block")
        self.drill = DrillingForce(level=box, t=PLAIN.t, k=PLAIN.k, d_c=PLAIN.d_c, feed_force_factor=PLAIN.factor)
        start, feed, depth = quantity(START, "m"), quantity(FEED, "m/s"), quantity(DEPTH, "m")
        moved = -quantity(2e-3, "m") * sin(quantity(0.7, "1/s") * time)
        self.lifting = Position(s_ref=moved)
        self.feed = Position(s_ref=start + feed * time + depth * sin(quantity(RATE, "1/s") * time) + moved)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.lift.frame_a)
        yield connect(self.lift.frame_b, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.lifting.flange, self.lift.axis)
        yield connect(self.speed.flange, self.spindle.axis)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["auto", "idas"])
def test_no_contact_with_a_moving_box_is_stepped_over(solver: str, reference: tuple[float, float]) -> None:
    r = acausal.simulate(BothMove(), stop_time=20.0, solver=solver)
    assert r.final("drill.s_tar") == pytest.approx(reference[0], abs=2e-8)
    assert float(np.max(r["drill.thrust"])) == pytest.approx(reference[1], rel=1e-3)
