"""Charging of a capacitor through a resistor."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part
from acausal.library.electrical import Capacitor, Ground, Resistor, StepVoltage


class RCCircuit(Component):
    """Voltage step on a resistor and a capacitor in series.

    From the step on the capacitor's voltage is V*(1 - exp(-(t - start_time)/(R*C))).
    """

    R: Real = parameter(default=1e3, unit="Ohm", doc="Resistance")
    C: Real = parameter(default=1e-6, unit="F", min=0.0, doc="Capacitance")
    V: Real = parameter(default=10.0, unit="V", doc="Height of the voltage step")

    source: StepVoltage = part()
    resistor: Resistor = part()
    capacitor: Capacitor = part()
    ground: Ground = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10e-3)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "capacitor.v"), title="Voltages"),
        Panel(("capacitor.i",), title="Current"),
    )

    def build(self) -> None:
        self.source = StepVoltage(V=self.V, start_time=1e-3)
        self.resistor = Resistor(R=self.R)
        self.capacitor = Capacitor(C=self.C, v=0.0)
        self.ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p)
        yield connect(self.resistor.n, self.capacitor.p)
        yield connect(self.capacitor.n, self.source.n, self.ground.p)
