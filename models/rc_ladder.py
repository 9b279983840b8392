"""RC ladder of any length: a benchmark of the compiler's cost per equation."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part, structural
from acausal.library.electrical import Capacitor, ConstantVoltage, Ground, Resistor


class RCLadder(Component):
    """Chain of `n` resistors, each followed by a capacitor to ground, switched to a constant voltage.

    Reduced it is C*dv[k]/dt = (v[k-1] - 2*v[k] + v[k+1])/R: diffusion along a line, n states.
    """

    n: int = structural(default=10, doc="Number of sections")
    R: Real = parameter(default=1.0, unit="Ohm", doc="Resistance of one section")
    C: Real = parameter(default=1.0, unit="F", min=0.0, doc="Capacitance of one section")
    V: Real = parameter(default=1.0, unit="V", doc="Voltage at the near end")

    source: ConstantVoltage = part()
    resistors: list[Resistor] = part()
    capacitors: list[Capacitor] = part()
    ground: Ground = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("capacitors[0].v",), title="Voltage of the first capacitor"),)

    def build(self) -> None:
        self.source = ConstantVoltage(V=self.V)
        self.resistors = [Resistor(R=self.R) for _ in range(self.n)]
        self.capacitors = [Capacitor(C=self.C, v=0.0) for _ in range(self.n)]
        self.ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistors[0].p)
        for resistor, capacitor in zip(self.resistors, self.capacitors, strict=True):
            yield connect(resistor.n, capacitor.p)
            yield connect(capacitor.n, self.ground.p)
        for before, after in pairwise(self.resistors):
            yield connect(before.n, after.p)
        yield connect(self.source.n, self.ground.p)
