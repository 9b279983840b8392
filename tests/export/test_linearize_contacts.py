"""Linearizations of bodies that rest on each other, in scenes whose equations change during a run."""

from __future__ import annotations

import numpy as np

import acausal
from acausal import Component, Equations, connect, fixed, part
from acausal.library.contact import ContactBody, ContactScene, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.library.multibody import Body, World

K = 1e4


class Tower(Component):
    """A ball of 2 kg upon one of 1 kg; one pair at a time stays in the equations for the whole run."""

    world: World = World(n=(0.0, 0.0, -1.0))
    balls: list[Body] = part()
    scene: ContactScene = part()

    def build(self) -> None:
        self.balls = [
            Body(
                m=1.0 + k,
                r_0=fixed((0.0, 0.0, 0.05 + 0.1 * k)),
                v_0=fixed((0.0, 0.0, 0.0)),
                Q=fixed((0.0, 0.0, 0.0, 1.0)),
                w_a=fixed((0.0, 0.0, 0.0)),
            )
            for k in range(2)
        ]
        bodies = [ContactBody(name=f"ball{k}", shape=Sphere(0.05)) for k in range(2)]
        ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
        surfaces = Surfaces(law=HuntCrossley(k=K, n=1.0, e=0.1, v_0=0.01))
        self.scene = ContactScene(bodies=(ground, *bodies), surfaces=surfaces, keep=1)

    def equations(self) -> Equations:
        for k, ball in enumerate(self.balls):
            yield connect(ball.frame_a, self.scene.frame(f"ball{k}"))


def test_a_tower_has_the_stiffness_matrix_of_its_springs() -> None:
    """M^-1 K with springs k to the ground and between the balls: [[-2k, k], [k, -k]] over 1 kg and 2 kg.

    Nearly at rest (the tower topples by rounding errors within four seconds). The run calls contacts by the names of
    the bodies, the model by number. Only rounding errors turn the balls, which are no kinks.
    """
    compiled = acausal.compile(Tower())
    run = acausal.simulate(compiled, stop_time=1.5, tolerance=1e-9)
    for model in (compiled, Tower()):
        linear = acausal.linearize(model, result=run)
        places = ([linear.states.index(f"balls[{k}].{name}[2]") for k in (0, 1)] for name in ("v_0", "r_0"))
        np.testing.assert_allclose(linear.A[np.ix_(*places)], K * np.array([[-2.0, 1.0], [0.5, -0.5]]), rtol=1e-2)
        assert np.isfinite(linear.A).all()
