"""Regenerative chatter in turning: the tool cuts the wave that it left one turn of the workpiece ago."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, delay, fixed, parameter, part, variable
from acausal.library.translational import Fixed, Flange, Mass, SpringDamper


class RegenerativeCut(Component):
    """Cutting force of a tool; its chip thickness is the feed plus the tool's displacement within one turn.

    The law is linear: it assumes that the tool stays in the cut. Positive positions are deeper in the workpiece.

    Source: J. Tlusty, M. Polacek, The stability of the machine tool against self-excited vibration in machining,
    Proc. ASME Production Engineering Research Conference (1963).
    """

    flange: Flange = Flange()
    K: Real = parameter(default=2e9, unit="N/m2", min=0.0, doc="Specific cutting force")
    b: Real = parameter(unit="m", min=0.0, doc="Width of cut")
    feed: Real = parameter(default=0.1e-3, unit="m", min=0.0, doc="Feed per turn")
    turn: Real = parameter(unit="s", doc="Time of one turn of the workpiece; greater than 0")
    h: Real = variable(unit="m", doc="Thickness of the chip")

    def equations(self) -> Equations:
        s = self.flange.s
        yield self.h == self.feed + s - delay(s, self.turn)
        yield self.flange.f == self.K * self.b * self.h


class RegenerativeTurning(Component):
    """Regenerative chatter of a tool with a natural frequency of 250 Hz at a spindle speed of 3000 1/min.

    With the damping ratio `zeta` of the tool and its stiffness c, no speed is unstable below the width of cut
    2 c zeta (1 + zeta) / K, 0.076 mm here; above it, the stable speeds form pockets between the lobes of the stability
    chart. At 3000 1/min the limit is 0.164 mm: with 0.18 mm the tool chatters.
    """

    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Modal mass of the tool")
    w: Real = parameter(default=1570.8, unit="rad/s", min=0.0, doc="Natural angular frequency")
    zeta: Real = parameter(default=0.03, unit="1", min=0.0, doc="Damping ratio")
    K: Real = parameter(default=2e9, unit="N/m2", min=0.0, doc="Specific cutting force")
    b: Real = parameter(default=0.18e-3, unit="m", min=0.0, doc="Width of cut")
    turn: Real = parameter(default=0.02, unit="s", doc="Time of one turn of the workpiece; greater than 0")
    bed: Fixed = part()
    holder: SpringDamper = part()
    tool: Mass = part()
    cut: RegenerativeCut = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.4, tolerance=1e-8, output_interval=2e-4)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("tool.s",), title="Position of the tool"),
        Panel(("cut.h",), title="Thickness of the chip"),
    )

    def build(self) -> None:
        self.bed = Fixed()
        self.holder = SpringDamper(c=self.m * self.w**2, d=2.0 * self.zeta * self.m * self.w)
        self.tool = Mass(m=self.m, s=fixed(0.0), v=fixed(0.0))
        self.cut = RegenerativeCut(K=self.K, b=self.b, turn=self.turn)

    def equations(self) -> Equations:
        yield connect(self.bed.flange, self.holder.flange_a)
        yield connect(self.holder.flange_b, self.tool.flange_a)
        yield connect(self.tool.flange_b, self.cut.flange)
