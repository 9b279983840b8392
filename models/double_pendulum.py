"""Two hinged bars: a minimal mechanism with chaotic motion."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, parameter, part
from acausal.library.multibody import BodyBox, Revolute, World


class DoublePendulum(Component):
    """Two hinged steel bars of square section, released from the horizontal."""

    length: Real = parameter(default=0.5, unit="m", min=0.0, doc="Length of each bar")
    width: Real = parameter(default=0.06, unit="m", min=0.0, doc="Side of the section")
    world: World = part()
    revolute1: Revolute = part()
    bar1: BodyBox = part()
    revolute2: Revolute = part()
    bar2: BodyBox = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("revolute1.phi", "revolute2.phi"), title="Angles of the hinges", unit="deg"),
        Panel(("bar2.frame_b.r_0[1]",), against="bar2.frame_b.r_0[0]", title="Path of the tip"),
    )

    def build(self) -> None:
        self.world = World()
        self.revolute1 = Revolute(phi=fixed(0.0), w=fixed(0.0))
        self.bar1 = self._bar()
        self.revolute2 = Revolute(phi=fixed(0.0), w=fixed(0.0))
        self.bar2 = self._bar()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.revolute1.frame_a)
        yield connect(self.revolute1.frame_b, self.bar1.frame_a)
        yield connect(self.bar1.frame_b, self.revolute2.frame_a)
        yield connect(self.revolute2.frame_b, self.bar2.frame_a)

    def _bar(self) -> BodyBox:
        return BodyBox(r=(self.length, 0.0, 0.0), width=self.width, width_direction=(0.0, 1.0, 0.0))
