"""Models that only benchmarks use: a spatial chain of hinged links, and a bouncing ball."""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Real,
    connect,
    der,
    fixed,
    parameter,
    part,
    reset,
    structural,
    variable,
    when,
)
from acausal.library.multibody import BodyShape, Revolute, World
from acausal.library.rotational import Damper

LENGTH, MASS, INERTIA, DAMPING, ANGLE = 0.5, 1.0, (0.001, 0.02, 0.02), 0.2, 0.3
"""For each link: length [m], mass [kg], moments [kg.m2], damping of its hinge [N.m.s/rad], initial angle [rad]."""
AXES = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
"""Hinges turn about z and y in turn."""


class SpatialChain(Component):
    """`n` links on damped hinges about z and y in turn, hanging at an angle in gravity along -x; motion is 3D.

    It is damped because an undamped chain is chaotic: after 10 s, no digit of any result would be meaningful.
    """

    n: int = structural(default=4, doc="Number of links")
    d: float = structural(default=DAMPING, doc="Damping of each hinge [N.m.s/rad]")
    world: World = part()
    joints: list[Revolute] = part()
    dampers: list[Damper] = part()
    links: list[BodyShape] = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8)

    def build(self) -> None:
        # Links lie along x, so x points down.
        self.world = World(n=(1.0, 0.0, 0.0))
        self.joints = [Revolute(n=AXES[k % 2], phi=fixed(ANGLE), w=fixed(0.0)) for k in range(self.n)]
        self.dampers = [Damper(d=self.d) for _ in range(self.n)]
        self.links = [
            BodyShape(
                m=MASS,
                r=(LENGTH, 0.0, 0.0),
                r_CM=(LENGTH / 2, 0.0, 0.0),
                I_11=INERTIA[0],
                I_22=INERTIA[1],
                I_33=INERTIA[2],
            )
            for _ in range(self.n)
        ]

    def equations(self) -> Equations:
        before = self.world.frame_b
        for joint, damper, link in zip(self.joints, self.dampers, self.links, strict=True):
            yield connect(before, joint.frame_a)
            yield connect(joint.frame_b, link.frame_a)
            yield connect(joint.axis, damper.flange_b)
            yield connect(joint.support, damper.flange_a)
            before = link.frame_b


class BouncingBall(Component):
    """A ball that loses a tenth of its speed at each bounce; 8 bounces in 5 s."""

    e: Real = parameter(default=0.9, doc="Restitution")
    h: Real = variable(default=fixed(1.0), unit="m", doc="Height")
    v: Real = variable(default=fixed(0.0), unit="m/s", doc="Velocity, upwards")

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, tolerance=1e-8)

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield when(self.h < 0, reset(self.v, -self.e * self.v))
