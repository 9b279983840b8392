"""The exported start of loops of joints: what a loop leaves open and what it says twice is decided as in a run."""

from __future__ import annotations

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, guess, part
from acausal.library.multibody import Body, Fixed, FreeMotion, Prismatic, Universal, World


class Held(Component):
    """A body with the six coordinates of a free one, and a slide from it to a universal joint at 1 m from the ground.

    Three coordinates of the first body are left; the length of its quaternion nothing says.
    """

    world: World = part()
    free: FreeMotion = part()
    first: Body = part()
    slide: Prismatic = part()
    second: Body = part()
    joint: Universal = part()
    ground: Fixed = part()

    def build(self) -> None:
        self.world = World()
        self.free = FreeMotion(
            r_rel_a=fixed((0.1, 0.2, -0.1)), v_rel_a=fixed((0.3, -0.1, 0.2)), Q=guess((0.1, -0.1, 0.2, 0.9))
        )
        self.first = Body(m=1.0, r_CM=(0.1, 0.0, 0.0))
        self.slide = Prismatic(s=guess(0.9))
        self.second = Body(m=2.0, r_CM=(-0.1, 0.1, 0.0))
        self.joint = Universal(n_a=(0.0, 1.0, 0.0), n_b=(0.0, 0.0, 1.0), phi_a=guess(0.2), phi_b=guess(0.1))
        self.ground = Fixed(r=(1.0, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.free.frame_a)
        yield connect(self.free.frame_b, self.first.frame_a, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.second.frame_a, self.joint.frame_b)
        yield connect(self.joint.frame_a, self.ground.frame_b)


def test_the_start_of_a_loop_is_that_of_a_run() -> None:
    """It was nan: a joint was held at its guess that the loop determines, and the length of the quaternion was open."""
    compiled = acausal.compile(Held())
    model = compiled.casadi()
    p = np.array(model.p.start)
    x, z = model.init(p)
    run = acausal.simulate(compiled, stop_time=1e-3)
    assert np.array(x).ravel() == pytest.approx([run[name][0] for name in model.x.names], abs=1e-9)
    # the ground moved, and the start with it: the loop is closed, and so are its velocities
    p[model.p.position("ground.r[1]")] = 0.05
    x, z = model.init(p)
    position, velocity = (np.array(g) for g in model.invariants(x=x, z=z, p=p).values())
    assert np.abs(position).max() < 1e-10
    assert np.abs(velocity).max() < 1e-10
