"""The first three-dimensional model: a bar that swings about a hinge."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part
from acausal.library.multibody import Body, Revolute, World


class Pendulum(Component):
    """Physical pendulum, released from the horizontal.

    The body is described in three dimensions; the compiler reduces it to the angle and its rate.
    """

    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Mass")
    length: Real = parameter(default=0.5, unit="m", min=0.0, doc="From the hinge to the centre of mass")
    world: World = part()
    revolute: Revolute = part()
    body: Body = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("revolute.phi",), title="Angle from the horizontal", unit="deg"),
        Panel(("revolute.w",), title="Angular velocity"),
    )

    def build(self) -> None:
        self.world = World()
        self.revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0), w=fixed(0.0))
        self.body = Body(m=self.m, r_CM=(self.length, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.revolute.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a)
