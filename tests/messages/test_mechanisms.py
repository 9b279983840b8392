"""Mechanisms that cannot be: loops of rods, frames that hang in the air, two drives on one axis, deep hierarchies."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, Equations, Real, connect, parameter, part, structural, variable
from acausal.library import electrical, multibody
from acausal.library.multibody import FixedTranslation, World
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC206",
    "world, a, b and c",
    "yield connect(self.c.frame_b, self.world.frame_b)",
    text="""
error[AC206]: RodTriangle: the closed loop of world, a, b and c is overconstrained
  at      test_mechanisms.py:N
              yield connect(self.c.frame_b, self.world.frame_b)
          the loop: world - a - b - c
          closed between c.frame_b and world.frame_b
          not determined: world.frame_b.t[0], world.frame_b.t[1], world.frame_b.t[2], a.frame_a.f[0] and 35 more
  cause   nothing in this loop can move: its parts hold each other twice, so that their loads are undetermined
  help    remove one of the connections, or put a joint or something compliant between two of the parts
""",
)
class RodTriangle(Component):
    """Three rigid rods between three points of the world."""

    world: World = World()
    a: FixedTranslation = FixedTranslation(r=(1.0, 0.0, 0.0))
    b: FixedTranslation = FixedTranslation(r=(-1.0, 1.0, 0.0))
    c: FixedTranslation = FixedTranslation(r=(0.0, -1.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.a.frame_a)
        yield connect(self.a.frame_b, self.b.frame_a)
        yield connect(self.b.frame_b, self.c.frame_a)
        yield connect(self.c.frame_b, self.world.frame_b)


class Twig(Component):
    """One equation too few: nobody says what its resistance is."""

    p: electrical.Pin = electrical.Pin()
    n: electrical.Pin = electrical.Pin()
    v: Real = variable(unit="V")

    def equations(self) -> Equations:
        yield self.v == self.p.v - self.n.v
        yield self.p.i + self.n.i == 0


class Knot(electrical.PartialOnePort):
    """One equation too many: Ohm's law twice."""

    R: Real = parameter(default=1.0, unit="Ohm")

    def equations(self) -> Equations:
        yield self.v == self.R * self.i
        yield self.p.v == self.n.v + self.R * self.p.i


class Branch(Component):
    """Something between two pins, at any depth."""

    p: electrical.Pin = electrical.Pin()
    n: electrical.Pin = electrical.Pin()
    depth: int = structural(default=0)
    leaf: Any = structural(default=Twig)
    on: Component = part()

    def build(self) -> None:
        self.on = Branch(depth=self.depth - 1, leaf=self.leaf) if self.depth else self.leaf()

    def equations(self) -> Equations:
        on: Any = self.on
        yield connect(self.p, on.p)
        yield connect(on.n, self.n)


class Tree(Component):
    """A source on three levels of components."""

    source: electrical.ConstantVoltage = part()
    stem: Branch = part()
    ground: electrical.Ground = part()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.stem.p)
        yield connect(self.source.n, self.stem.n, self.ground.p)


@corpus.broken("AC201", "stem.on.on.on", "self.leaf()", "def equations(self) -> Equations:")
class TooFewThreeDeep(Tree):
    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.stem = Branch(depth=2)
        self.ground = electrical.Ground()


@corpus.broken("AC202", "stem.on.on.on", "self.leaf()", "def equations(self) -> Equations:")
class TooManyThreeDeep(Tree):
    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.stem = Branch(depth=2, leaf=Knot)
        self.ground = electrical.Ground()


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@corpus.broken(
    "AC206",
    "joints[0]",
    "yield connect(self.bars[3].frame_b, self.world.frame_b)",
    text="""
error[AC206]: FourBar: the closed loop of joints[0], joints[1], joints[2] and joints[3] is overconstrained
  at      test_mechanisms.py:N
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
AC130 Revolute -- multibody.Revolute(n=(0.0, 0.0, 0.0))

TooFewFreedoms AC206 joint, link and ball
# A hinge and a ball joint between two fixed points: one rotation too few to close the loop.
world: multibody.World = multibody.World()
base: multibody.FixedTranslation = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))
joint: multibody.Revolute = <<multibody.Revolute()>>
link: multibody.BodyShape = <<multibody.BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0))>>
ball: multibody.Spherical = <<multibody.Spherical()>>
yield connect(self.world.frame_b, self.joint.frame_a, self.base.frame_a)
yield connect(self.joint.frame_b, self.link.frame_a)
yield connect(self.link.frame_b, self.ball.frame_a)
yield connect(self.ball.frame_b, self.base.frame_b)

JointInTheAir AC201 joint.frame_a is not connected
# Nobody has hung the joint on anything: no World.
joint: multibody.Revolute = <<multibody.Revolute(phi=fixed(0.0))>>
body: multibody.Body = multibody.Body(m=1.0, r_CM=(1.0, 0.0, 0.0))
yield connect(self.joint.frame_b, self.body.frame_a)

TwoDrives AC205 speed and brake
# The axis of a joint that is driven and held.
world: multibody.World = multibody.World()
joint: multibody.Revolute = multibody.Revolute()
body: multibody.Body = multibody.Body(m=1.0, r_CM=(1.0, 0.0, 0.0))
speed: rotational.Speed = <<rotational.Speed()>>
brake: rotational.Fixed = <<rotational.Fixed()>>
constant: blocks.Constant = blocks.Constant(k=1.0)
yield connect(self.world.frame_b, self.joint.frame_a)
yield connect(self.joint.frame_b, self.body.frame_a)
yield connect(self.constant.y, self.speed.w_ref)
yield connect(self.joint.axis, self.speed.flange, self.brake.flange)

BothEnds AC205 mass
# A long mass whose ends are one point.
mass: translational.Mass = <<translational.Mass(m=1.0, L=1.0)>>
yield connect(self.mass.flange_a, self.mass.flange_b)

TwoSpeedsAtTheStart AC302 rear.w
# Two inertias on one shaft that start at different speeds.
front: rotational.Inertia = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
rear: rotational.Inertia = <<rotational.Inertia(J=1.0, w=fixed(1.0))>>
yield connect(self.front.flange_b, self.rear.flange_a)

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
