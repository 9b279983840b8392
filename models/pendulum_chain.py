"""A chain of hinged links of any length: a multibody benchmark of the compiler."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed, part, structural
from acausal.library.multibody import BodyShape, Revolute, World


class PendulumChain(Component):
    """`n` equal links on revolute joints about z, hanging from the world, released from the horizontal.

    Each link is described in three dimensions; 2n states remain.
    """

    n: int = structural(default=4, doc="Number of links")
    world: World = part()
    joints: list[Revolute] = part()
    links: list[BodyShape] = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("joints[0].phi",), title="Angle of the first joint", unit="deg"),)

    def build(self) -> None:
        self.world = World()
        self.joints = [Revolute(phi=fixed(0.0), w=fixed(0.0)) for _ in range(self.n)]
        self.links = [
            BodyShape(
                m=1.0,
                r=(0.5, 0.0, 0.0),
                r_CM=(0.25, 0.0, 0.0),
                I_11=0.001,
                I_22=0.02,
                I_33=0.02,
            )
            for _ in range(self.n)
        ]

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joints[0].frame_a)
        for joint, link in zip(self.joints, self.links, strict=True):
            yield connect(joint.frame_b, link.frame_a)
        for link, next_joint in zip(self.links, self.joints[1:], strict=False):
            yield connect(link.frame_b, next_joint.frame_a)
