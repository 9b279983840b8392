"""A contact found by MPR inside the equations, against the same contact in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part, structural
from acausal.library.contact import Coulomb, Cylinder, HalfSpace, HuntCrossley, Shape, Sphere, SurfaceContact
from acausal.library.contact.manifold.touch import method
from acausal.library.multibody import Body, World

TOP = 0.05


class BallOn(Component):
    """A ball that falls by 2 mm and rolls on something whose upper face is at z = 0."""

    ground: Shape = structural()
    height: float = structural(default=0.0)
    world: World = World(n=(0.0, 0.0, -1.0))
    body: Body = Body(
        m=1.0,
        r_0=fixed((0.01, 0.0, 0.052)),
        v_0=fixed((0.1, 0.0, 0.0)),
        Q=fixed((0.0, 0.0, 0.0, 1.0)),
        w_a=fixed((0.0, 0.0, 0.0)),
    )
    contact: SurfaceContact = part()

    def build(self) -> None:
        self.contact = SurfaceContact(
            shape_a=Sphere(0.05),
            shape_b=self.ground,
            pose_b=((0.0, 0.0, self.height), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
            law=HuntCrossley(k=1e5, n=1.0, e=0.5, v_0=0.2),
            friction=Coulomb(mu=0.3),
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.contact.frame_b)
        yield connect(self.body.frame_a, self.contact.frame_a)


@pytest.mark.slow
def test_a_ball_on_a_cylinder_moves_as_on_the_ground() -> None:
    assert method(Sphere(0.05), Cylinder(0.08, 0.1)) == "MPR"
    assert method(Sphere(0.05), HalfSpace()) == "closed form"
    drum, ground = (
        acausal.simulate(BallOn(ground=shape, height=z), stop_time=0.04, tolerance=1e-8, solver="rosenbrock")
        for shape, z in ((Cylinder(0.08, 2 * TOP), -TOP), (HalfSpace(), 0.0))
    )
    for name in ("body.r_0", "body.v_0", "body.w_a"):
        np.testing.assert_allclose(drum.final(name), ground.final(name), atol=1e-6)
    assert ground["contact.F_N"].max() > 20.0
    assert drum.final("contact.F_N") == pytest.approx(ground.final("contact.F_N"), abs=0.05)
