"""Contact has no scale of its own: a body a million times lighter on springs as much softer moves the same way."""

from __future__ import annotations

import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, structural
from acausal.library.contact import FrictionLaw, Hybrid, KelvinVoigt, LuGre, Sphere, SurfaceContact
from acausal.library.contact.collide.shapes import HalfSpace
from acausal.library.multibody import Body, Fixed, Prismatic, World

G = 9.81


class GuidedBall(Component):
    """A ball that cannot turn lies on the ground, at rest on its spring, and slides along x."""

    friction: FrictionLaw = structural()
    m: Real = parameter(unit="kg", doc="Mass")

    world: World = World(n=(0.0, 0.0, -1.0), g=G)
    ahead: Prismatic = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(0.0), v=fixed(0.5))
    up: Prismatic = part()
    ball: Body = part()
    ground: Fixed = Fixed()
    contact: SurfaceContact = part()

    def build(self) -> None:
        sunk = 1e-5
        k = self.m * quantity(G / sunk, "1/s2")
        self.up = Prismatic(n=(0.0, 0.0, 1.0), s=fixed(0.05 - sunk), v=fixed(0.0))
        self.ball = Body(m=self.m)
        self.contact = SurfaceContact(
            shape_a=Sphere(0.05), shape_b=HalfSpace(), law=KelvinVoigt(k=k), friction=self.friction
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.ahead.frame_a)
        yield connect(self.ahead.frame_b, self.up.frame_a)
        yield connect(self.up.frame_b, self.ball.frame_a, self.contact.frame_a)
        yield connect(self.ground.frame_b, self.contact.frame_b)


@pytest.mark.parametrize("friction", [LuGre(mu=0.3, mu_s=0.3), Hybrid(mu=0.3)], ids=["LuGre", "Hybrid"])
def test_a_light_ball_slides_as_far_as_a_heavy_one(friction: FrictionLaw) -> None:
    """v**2 / (2 mu g), to the bending of the bristles, whatever the mass (it was none below a gram)."""
    model = acausal.compile(GuidedBall(friction=friction, m=1.0))
    ends = []
    for m in (1.0, 1e-6):
        run = acausal.simulate(model, parameters={"m": m}, stop_time=0.25, tolerance=1e-8, output_interval=0.05)
        assert run.final("ahead.v") == pytest.approx(0.0, abs=1e-6)
        ends.append(float(run.final("ahead.s")))
    assert ends[0] == pytest.approx(0.25 / (2 * 0.3 * G), rel=1e-3)
    assert ends[1] == pytest.approx(ends[0], rel=1e-7)
