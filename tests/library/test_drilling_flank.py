"""The flank of the drill in its hole: what holds it sideways, and what does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, time, where
from acausal.library.contact import Box, ContactScene
from acausal.library.drilling import DrillBody, EnergyBalance, WorkpieceBody
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Force, Position

K_WALL, CLEARANCE, DEPTH = 1e9, 2e-5, 0.02
H_C = 0.008 / math.tan(math.radians(59.0))


class PulledDrill(Component):
    """A drill that is fed into a block and then pulled sideways, on a slide that lets it."""

    F: Real = parameter(default=100.0, unit="N")
    m: Real = parameter(default=2.0, unit="kg")

    world: World = World(g=0.0)
    slide: Prismatic = part()
    feed: Prismatic = part()
    spindle: Revolute = part()
    body: Body = part()
    scene: ContactScene = part()
    down: Position = Position(s_ref=where(time < 10.5, 2e-3 * time - 1e-3, DEPTH))
    pull: Force = part()
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)
    balance: EnergyBalance = part()

    def build(self) -> None:
        self.slide = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(0.0), v=fixed(0.0))
        self.feed = Prismatic(n=(0.0, 0.0, 1.0))
        self.spindle = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0))
        self.body = Body(m=self.m)
        settings = (("k_wall", K_WALL), ("clearance", CLEARANCE))
        block = WorkpieceBody(
            name="block", shape=Box((0.1, 0.1, 0.05)), pose=((0.0, 0.0, 0.025), IDENTITY), at_rest=True
        )
        drill = DrillBody(name="drill", wanders=False, settings=settings)
        self.scene = ContactScene(bodies=(drill, block))
        self.pull = Force(
            u=where(time < 11.0, 0.0, where(time < 11.5, self.F * (time - 11.0) / quantity(0.5, "s"), self.F))
        )
        self.balance = EnergyBalance(
            P_source=self.feed.f * self.feed.v + self.slide.f * self.slide.v + self.spindle.tau * self.spindle.w,
            P_cutting=self.scene.power_cutting,
            P_friction=self.scene.power_friction,
            P_damping=self.scene.power_damping,
            E=self.scene.energy + self.m / 2 * (self.slide.v**2 + self.feed.v**2),
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.feed.frame_a)
        yield connect(self.feed.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.body.frame_a, self.scene.frame("drill"))
        yield connect(self.down.flange, self.feed.axis)
        yield connect(self.pull.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


@pytest.mark.slow
def test_the_wall_holds_a_drill_that_is_pulled_sideways() -> None:
    """Two springs of k L/2 behind the clearance: e = clearance + F / (k L), L the length behind the cone."""
    r = acausal.simulate(PulledDrill(), stop_time=13.0, tolerance=1e-8, solver="rosenbrock")
    engaged = DEPTH - H_C
    assert r.final("scene.contacts[0].flank.engaged") == pytest.approx(engaged, rel=1e-9)
    assert r.final("slide.s") == pytest.approx(CLEARANCE + 100.0 / (K_WALL * engaged), rel=1e-4)
    np.testing.assert_allclose(r.final("scene.contacts[0].flank.force"), [-100.0, 0.0, 0.0], atol=1e-2)
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()


def test_a_drill_above_the_surface_is_free() -> None:
    r = acausal.simulate(PulledDrill(), stop_time=0.1, tolerance=1e-8, solver="rosenbrock")
    assert np.abs(r["scene.contacts[0].flank.force"]).max() == 0.0
