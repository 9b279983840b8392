"""Scenes that move: tilted drills, a plate on another spring, a body that goes where nobody expected it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, structural, time
from acausal.errors import AcausalError
from acausal.library.contact import Box, ContactBody, ContactScene, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.library.drilling import DrillBody, EnergyBalance, WorkpieceBody
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Position, SpringDamper
from acausal.models.contact_scenes import StackedPlates
from tests.expected import fails_with

V, N, GAP = 2e-3, 9.28, 2e-3
H_C = 0.008 / math.tan(math.radians(59.0))


class TiltedDrill(Component):
    """A drill fed at a constant rate along a tilted axis through a plate; a spring lets it yield sideways."""

    tilt: float = structural(default=0.2, doc="Angle between the axis and the normal of the plate [rad]")
    t: float = structural(default=0.008, doc="Thickness of the plate [m]")
    c: Real = parameter(default=1e7, unit="N/m")

    world: World = part()
    slide: Prismatic = part()
    feed: Prismatic = part()
    spindle: Revolute = part()
    body: Body = part()
    scene: ContactScene = part()
    down: Position = part()
    spring: SpringDamper = part()
    speed: Speed = part()
    balance: EnergyBalance = part()

    def build(self) -> None:
        e = (math.sin(self.tilt), 0.0, math.cos(self.tilt))
        self.world = World(g=0.0)
        self.slide = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(0.0), v=fixed(0.0))
        self.feed = Prismatic(n=e)
        self.spindle = Revolute(n=e, phi=fixed(0.0))
        self.body = Body(m=2.0)
        plate = WorkpieceBody(
            name="plate", shape=Box((0.1, 0.1, self.t)), pose=((0.0, 0.0, self.t / 2), IDENTITY), at_rest=True
        )
        settings = (("k_wall", 1e9),)
        self.scene = ContactScene(bodies=(DrillBody(name="drill", axis_a=e, wanders=False, settings=settings), plate))
        self.down = Position(s_ref=V * time - GAP)
        self.spring = SpringDamper(c=self.c, d=2e3)
        self.speed = Speed(w_ref=2 * math.pi * N)
        # The velocities add along x, where the two slides are not perpendicular.
        v_x, v_z = self.slide.v + e[0] * self.feed.v, e[2] * self.feed.v
        self.balance = EnergyBalance(
            P_source=self.feed.f * self.feed.v + self.spindle.tau * self.spindle.w,
            P_cutting=self.scene.power_cutting,
            P_friction=self.scene.power_friction,
            P_damping=self.scene.power_damping + self.spring.d * self.slide.v**2,
            E=self.scene.energy + quantity(2.0, "kg") / 2 * (v_x**2 + v_z**2) + self.c / 2 * self.slide.s**2,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.feed.frame_a)
        yield connect(self.feed.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.body.frame_a, self.scene.frame("drill"))
        yield connect(self.down.flange, self.feed.axis)
        yield connect(self.slide.support, self.spring.flange_a)
        yield connect(self.slide.axis, self.spring.flange_b)
        yield connect(self.speed.flange, self.spindle.axis)


@pytest.mark.slow
def test_a_tilted_drill_goes_through() -> None:
    """At full diameter the cutting law at the given feed; the thrust pushes the spring aside by its part along x."""
    tilt = math.radians(20.0)
    end = (GAP + 0.006 + 0.008 / math.cos(tilt) + H_C) / V
    r = acausal.simulate(TiltedDrill(tilt=tilt), stop_time=end, tolerance=1e-8, solver="rosenbrock")
    force = "scene.contacts[0]"
    full = 0.5 * (H_C + 0.008 / math.cos(tilt)) + GAP
    assert r.at(full / V, f"{force}.s") == pytest.approx(full - GAP, abs=2e-5)
    assert r.at(full / V, f"{force}.d_O") == pytest.approx(0.016, rel=1e-9)
    f_z = V / N / 2
    k_c = 2240e6 * (f_z * math.sin(math.radians(59.0)) / 1e-3) ** -0.21
    thrust = 0.016 * f_z * k_c * math.sin(math.radians(118.0))
    assert r.at(full / V, f"{force}.F_f") == pytest.approx(thrust, rel=1e-3)
    assert float(r.final(f"{force}.thrust")) == pytest.approx(0.0, abs=1e-6)
    assert float(r["slide.s"].min()) < -1e-6
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()


@pytest.mark.slow
def test_another_moving_plate_keeps_the_balance() -> None:
    values = {"F": 2500.0, "c": 1.5e6, "plate.m": 7.0}
    r = acausal.simulate(StackedPlates(), stop_time=20.0, parameters=values)
    assert float(r["scene.contacts[1].s"].max()) > 0.012
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()


class Flyer(Component):
    """A ball that flies away from where it was said to be."""

    world: World = World(g=0.0)
    ball: Body = Body(m=1.0, r_0=fixed((0.0, 0.0, 0.1)), v_0=fixed((0.3, 0.0, 0.0)))
    scene: ContactScene = part()

    def build(self) -> None:
        box = (-0.1, -0.1, 0.0), (0.1, 0.1, 1.0)
        self.scene = ContactScene(
            bodies=(
                ContactBody(name="runaway", shape=Sphere(0.02), reach=box),
                ContactBody(name="ground", shape=HalfSpace(), at_rest=True),
            ),
            surfaces=Surfaces(law=HuntCrossley(k=1e5, e=0.5, v_0=0.1)),
        )

    def equations(self) -> Equations:
        yield connect(self.ball.frame_a, self.scene.frame("runaway"))


def test_a_body_that_leaves_its_reach_is_named() -> None:
    """0.1 m at 0.3 m/s: after a third of a second."""
    acausal.simulate(Flyer(), stop_time=0.3)
    with fails_with(AcausalError, "AC503", match="runaway has left its reach"):
        acausal.simulate(Flyer(), stop_time=1.0)
