"""Bennett's linkage: four hinges in space that move although the count of their conditions says that they cannot."""

from __future__ import annotations

import math
from typing import Any

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, guess, part
from acausal.errors import AcausalError
from acausal.library.multibody import Body, FixedRotation, Revolute, RevoluteConstraint, Spherical, World, axis_rotation
from tests.expected import fails_with

TWISTS = (0.6, 1.0)
"""Angles [rad] between the axes of neighbouring hinges; opposite links are equal."""
LENGTHS = (1.0, math.sin(TWISTS[1]) / math.sin(TWISTS[0]))
"""Distances [m] of these axes, in proportion to the sines of the angles: Bennett's condition."""
FIRST = 1.0
SECOND = 2 * math.atan(math.sin((TWISTS[1] + TWISTS[0]) / 2) / math.sin((TWISTS[1] - TWISTS[0]) / 2) / math.tan(0.5))
"""The angles [rad] of two hinges: the product of the tangents of their halves is constant."""


class Bennett(Component):
    """The linkage with three hinges and another joint in place of the fourth."""

    world: World = World(g=0.0)
    hinges: list[Revolute] = part()
    links: list[FixedRotation] = part()
    bodies: list[Body] = part()
    closing: Any = part()

    def build(self) -> None:
        self.hinges = [
            Revolute(phi=fixed(FIRST), w=fixed(1.0)),
            Revolute(phi=guess(SECOND)),
            Revolute(phi=guess(-FIRST)),
        ]
        self.links = [
            FixedRotation(r=(LENGTHS[k % 2], 0.0, 0.0), R_rel=axis_rotation((1, 0, 0), TWISTS[k % 2])) for k in range(4)
        ]
        self.bodies = [Body(m=1.0, r_CM=(LENGTHS[k % 2] / 2, 0.0, 0.0), I_11=0.1, I_22=0.2, I_33=0.2) for k in range(3)]

    def equations(self) -> Equations:
        end = self.world.frame_b
        for hinge, link, body in zip(self.hinges, self.links, self.bodies, strict=False):
            yield connect(end, hinge.frame_a)
            yield connect(hinge.frame_b, body.frame_a, link.frame_a)
            end = link.frame_b
        yield connect(end, self.closing.frame_a)
        yield connect(self.closing.frame_b, self.links[3].frame_a)
        yield connect(self.links[3].frame_b, self.world.frame_b)


@pytest.mark.parametrize("closing", [Revolute(), RevoluteConstraint()])
def test_hinges_that_hold_twice_are_refused(closing: Component) -> None:
    with fails_with(AcausalError, "AC206", "overconstrained"):
        acausal.simulate(Bennett(closing=closing))


def test_a_ball_joint_that_still_holds_once_too_often_is_refused() -> None:
    """Three conditions for three hinges leave no motion by the count, and one along the linkage's curve.

    The forces are undetermined: where rounding shows that, the start or the first step fails.
    """
    with pytest.raises(AcausalError) as caught:
        acausal.simulate(Bennett(closing=Spherical()), stop_time=0.5)
    assert caught.value.code in ("AC302", "AC402")
