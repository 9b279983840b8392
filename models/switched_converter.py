"""A converter that switches ten thousand times per second."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part
from acausal.library.blocks import BooleanPulse
from acausal.library.electrical import (
    Capacitor,
    ConstantVoltage,
    Ground,
    IdealClosingSwitch,
    IdealDiode,
    Inductor,
    Resistor,
)


class BuckConverter(Component):
    """Step-down converter: a switch and a freewheeling diode chop the supply, a filter smooths it.

    In continuous conduction the output is `duty` times the supply, and the ripple of the current is
    V*duty*(1 - duty)/(L*f).
    """

    V: Real = parameter(default=24.0, unit="V", doc="Supply")
    f: Real = parameter(default=10e3, unit="Hz", doc="Switching frequency")
    duty: Real = parameter(
        default=0.5, unit="1", min=0.0, max=1.0, doc="Fraction of the period in which the switch is on"
    )
    L: Real = parameter(default=1e-3, unit="H", min=0.0, doc="Inductance of the filter")
    C: Real = parameter(default=100e-6, unit="F", min=0.0, doc="Capacitance of the filter")
    R: Real = parameter(default=6.0, unit="Ohm", min=0.0, doc="Load")
    supply: ConstantVoltage = part()
    switch: IdealClosingSwitch = part()
    diode: IdealDiode = part()
    inductor: Inductor = part()
    capacitor: Capacitor = part()
    load: Resistor = part()
    ground: Ground = part()
    modulation: BooleanPulse = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=5e-3, tolerance=1e-8, output_interval=5e-6)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("load.v",), title="Output voltage"),
        Panel(("inductor.i", "load.i"), title="Currents"),
    )

    def build(self) -> None:
        self.supply = ConstantVoltage(V=self.V)
        self.switch = IdealClosingSwitch(Ron=1e-3, Goff=1e-6)
        self.diode = IdealDiode(Ron=1e-3, Goff=1e-6)
        self.inductor = Inductor(L=self.L, i=0.0)
        self.capacitor = Capacitor(C=self.C, v=0.0)
        self.load = Resistor(R=self.R)
        self.ground = Ground()
        self.modulation = BooleanPulse(period=1.0 / self.f, width=self.duty)

    def equations(self) -> Equations:
        yield connect(self.modulation.y, self.switch.control)
        yield connect(self.supply.p, self.switch.p)
        yield connect(self.switch.n, self.diode.n, self.inductor.p)
        yield connect(self.inductor.n, self.capacitor.p, self.load.p)
        yield connect(self.supply.n, self.diode.p, self.capacitor.n, self.load.n, self.ground.p)
