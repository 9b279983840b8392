"""Mechanisms of any size for tests: chains and trees of links on hinges, slides and ball joints, with springs."""

from __future__ import annotations

from acausal import Component, Equations, connect, fixed, part, structural
from acausal.library.multibody import BodyShape, Prismatic, Revolute, Spherical, Spring, World

AXES = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))


class Tree(Component):
    """`n` links; link k hangs on link (k - 1) // `arms`, each fifth on a slide; `springs` between tips.

    With `arms` = 1 it is a chain.
    """

    n: int = structural(default=15)
    arms: int = structural(default=2)
    springs: int = structural(default=0)
    world: World = World()
    joints: list[Revolute | Prismatic] = part()
    links: list[BodyShape] = part()
    ropes: list[Spring] = part()

    def build(self) -> None:
        self.joints = [
            Prismatic(n=AXES[k % 3], s=fixed(0.1), v=fixed(0.0))
            if k % 5 == 4
            else Revolute(n=AXES[k % 3], phi=fixed(0.2), w=fixed(0.0))
            for k in range(self.n)
        ]
        self.links = [
            BodyShape(
                m=1.0 + 0.1 * (k % 3),
                r=(0.5, 0.1, 0.0),
                r_CM=(0.25, 0.05, 0.02),
                I_11=0.01,
                I_22=0.02,
                I_33=0.03,
            )
            for k in range(self.n)
        ]
        self.ropes = [Spring(c=10.0, s_unstretched=0.3) for _ in range(self.springs)]

    def equations(self) -> Equations:
        for k, (joint, link) in enumerate(zip(self.joints, self.links, strict=True)):
            before = self.links[(k - 1) // self.arms].frame_b if k else self.world.frame_b
            yield connect(before, joint.frame_a)
            yield connect(joint.frame_b, link.frame_a)
        for k, rope in enumerate(self.ropes):
            yield connect(rope.frame_a, self.links[self.n - 1 - 2 * k].frame_b)
            yield connect(rope.frame_b, self.links[self.n - 2 - 2 * k].frame_b)


class Balls(Component):
    """`n` links on ball joints, in a straight line at the start."""

    n: int = structural(default=4)
    world: World = World()
    joints: list[Spherical] = part()
    links: list[BodyShape] = part()

    def build(self) -> None:
        self.joints = [Spherical() for _ in range(self.n)]
        self.links = [
            BodyShape(
                m=1.0,
                r=(0.5, 0.0, 0.0),
                r_CM=(0.25, 0.0, 0.0),
                I_11=0.01,
                I_22=0.02,
                I_33=0.02,
                r_0=fixed((0.5 * k, 0.0, 0.0)),
                v_0=fixed((0.0, 0.0, 0.0)),
                Q=fixed((0.0, 0.0, 0.0, 1.0)),
                w_a=fixed((0.0, 0.0, 0.0)),
            )
            for k in range(self.n)
        ]

    def equations(self) -> Equations:
        before = self.world.frame_b
        for joint, link in zip(self.joints, self.links, strict=True):
            yield connect(before, joint.frame_a)
            yield connect(joint.frame_b, link.frame_a)
            before = link.frame_b
