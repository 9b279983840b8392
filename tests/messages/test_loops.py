"""Closed loops of frames that are constrained more than they can move."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import multibody
from tests.messages.cases import Case, Corpus

corpus = Corpus()

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@corpus.broken(
    "AC206",
    "joints[0]",
    "yield connect(self.bars[3].frame_b, self.world.frame_b)",
    text="""
error[AC206]: FourBar: the closed loop of joints[0], joints[1], joints[2] and joints[3] is overconstrained
  at      test_loops.py:N
              yield connect(self.bars[3].frame_b, self.world.frame_b)
          the loop: world - joints[0] - bars[0] - joints[1] - bars[1] - joints[2] - bars[2] - joints[3] - bars[3]
          closed between bars[3].frame_b and world.frame_b
          not determined: world.frame_b.t[0], world.frame_b.t[1], joints[0].frame_a.f[2], joints[0].frame_b.f[2] and 46 more
  cause   the cut forces and torques cannot all be determined: a planar loop, or joints that constrain the same motion
  help    in a planar loop make one joint a RevolutePlanarLoopConstraint
""",  # noqa: E501
)
class FourBar(Component):
    """Four hinges with parallel axes: three of the cut torques and forces are not determined."""

    world: multibody.World = multibody.World()
    joints: list[multibody.Revolute] = part()
    bars: list[multibody.FixedTranslation] = part()
    body: multibody.Body = multibody.Body(m=1.0)

    def build(self) -> None:
        self.joints = [multibody.Revolute(n=Z) for _ in range(4)]
        sides = (Y, X, (0.0, -1.0, 0.0), (-1.0, 0.0, 0.0))
        self.bars = [multibody.FixedTranslation(r=side) for side in sides]

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joints[0].frame_a)
        for k in range(4):
            yield connect(self.joints[k].frame_b, self.bars[k].frame_a)
        for k in range(3):
            yield connect(self.bars[k].frame_b, self.joints[k + 1].frame_a)
        yield connect(self.bars[1].frame_b, self.body.frame_a)
        yield connect(self.bars[3].frame_b, self.world.frame_b)


corpus.table(
    """
ParallelGuides AC206 upper
# A slide on two parallel guides.
world: multibody.World = multibody.World()
offset: multibody.FixedTranslation = multibody.FixedTranslation(r=Y)
upper: multibody.Prismatic = multibody.Prismatic(n=X)
lower: multibody.Prismatic = multibody.Prismatic(n=X)
bridge: multibody.FixedTranslation = multibody.FixedTranslation(r=Y)
slide: multibody.Body = multibody.Body(m=1.0)
yield connect(self.world.frame_b, self.lower.frame_a, self.offset.frame_a)
yield connect(self.offset.frame_b, self.upper.frame_a)
yield connect(self.lower.frame_b, self.bridge.frame_a, self.slide.frame_a)
> yield connect(self.bridge.frame_b, self.upper.frame_b)

ClampedBeam AC206 beam
# A rigid beam clamped at both ends.
world: multibody.World = multibody.World()
beam: multibody.FixedTranslation = multibody.FixedTranslation(r=X)
wall: multibody.Fixed = multibody.Fixed(r=X)
yield connect(self.world.frame_b, self.beam.frame_a)
> yield connect(self.beam.frame_b, self.wall.frame_b)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
