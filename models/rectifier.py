"""Bridges of ideal diodes and thyristors, whose switches are determined simultaneously."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part
from acausal.library.blocks import BooleanPulse
from acausal.library.electrical import (
    Capacitor,
    Ground,
    IdealDiode,
    IdealThyristor,
    Inductor,
    Resistor,
    SineVoltage,
)


class BridgeRectifier(Component):
    """Full-wave rectifier: four ideal diodes, a smoothing capacitor and a resistor.

    Twice in every period, the capacitor charges along the rectified wave until the current of the bridge ends; then it
    alone feeds the resistor.
    """

    V: Real = parameter(default=math.sqrt(2.0) * 110.0, unit="V", doc="Amplitude of the source")
    f: Real = parameter(default=50.0, unit="Hz", doc="Frequency of the source")
    R: Real = parameter(default=20.0, unit="Ohm", min=0.0, doc="Load")
    C: Real = parameter(default=2e-3, unit="F", min=0.0, doc="Smoothing capacitor")
    Rs: Real = parameter(default=0.1, unit="Ohm", min=0.0, doc="Resistance of the source")
    source: SineVoltage = part()
    resistance: Resistor = part()
    diode_p1: IdealDiode = part(doc="From the line to dc+")
    diode_p2: IdealDiode = part(doc="From the return to dc+")
    diode_n1: IdealDiode = part(doc="From dc- to the line")
    diode_n2: IdealDiode = part(doc="From dc- to the return")
    capacitor: Capacitor = part()
    load: Resistor = part()
    ground: Ground = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.1, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "load.v"), title="Voltages"),
        Panel(("diode_p1.i", "diode_p2.i"), title="Currents of the diodes"),
    )

    def build(self) -> None:
        self.source = SineVoltage(V=self.V, f=self.f)
        self.resistance = Resistor(R=self.Rs)
        self.diode_p1, self.diode_p2, self.diode_n1, self.diode_n2 = (IdealDiode() for _ in range(4))
        self.capacitor = Capacitor(C=self.C, v=0.0)
        self.load = Resistor(R=self.R)
        self.ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistance.p)
        yield connect(self.resistance.n, self.diode_p1.p, self.diode_n1.n)
        yield connect(self.source.n, self.diode_p2.p, self.diode_n2.n, self.ground.p)
        yield connect(self.diode_p1.n, self.diode_p2.n, self.capacitor.p, self.load.p)
        yield connect(self.diode_n1.p, self.diode_n2.p, self.capacitor.n, self.load.n)


class SCRBridge(Component):
    """Bridge of four thyristors, fired `delay` after the zero crossings, on a resistor and an inductor.

    The inductor keeps the current flowing beyond the zero crossing of the source, so that a thyristor blocks when the
    opposite pair is fired: four switches change at that instant.
    """

    V: Real = parameter(default=100.0, unit="V", doc="Amplitude of the source")
    f: Real = parameter(default=50.0, unit="Hz", doc="Frequency of the source")
    R: Real = parameter(default=1.0, unit="Ohm", min=0.0, doc="Load")
    L: Real = parameter(default=10e-3, unit="H", min=0.0, doc="Inductance of the load")
    delay: Real = parameter(default=1.5e-3, unit="s", min=0.0, doc="Time from a zero crossing to the firing")
    source: SineVoltage = part()
    thyristor_p1: IdealThyristor = part(doc="From the line to dc+")
    thyristor_p2: IdealThyristor = part(doc="From the return to dc+")
    thyristor_n1: IdealThyristor = part(doc="From dc- to the line")
    thyristor_n2: IdealThyristor = part(doc="From dc- to the return")
    fire1: BooleanPulse = part(doc="Fires the pair of the positive half wave")
    fire2: BooleanPulse = part(doc="Fires the pair of the negative half wave")
    load: Resistor = part()
    inductor: Inductor = part()
    ground: Ground = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.1, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "load.v"), title="Voltages"),
        Panel(("inductor.i", "thyristor_p1.i", "thyristor_p2.i"), title="Currents"),
    )

    def build(self) -> None:
        period = 1.0 / self.f
        self.source = SineVoltage(V=self.V, f=self.f)
        self.thyristor_p1, self.thyristor_p2, self.thyristor_n1, self.thyristor_n2 = (
            IdealThyristor(Ron=1e-3, Goff=1e-6) for _ in range(4)
        )
        self.fire1 = BooleanPulse(period=period, width=0.1, start_time=self.delay)
        self.fire2 = BooleanPulse(period=period, width=0.1, start_time=self.delay + period / 2.0)
        self.load = Resistor(R=self.R)
        self.inductor = Inductor(L=self.L, i=0.0)
        self.ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.thyristor_p1.p, self.thyristor_n1.n)
        yield connect(self.source.n, self.thyristor_p2.p, self.thyristor_n2.n, self.ground.p)
        yield connect(self.thyristor_p1.n, self.thyristor_p2.n, self.load.p)
        yield connect(self.load.n, self.inductor.p)
        yield connect(self.inductor.n, self.thyristor_n1.p, self.thyristor_n2.p)
        yield connect(self.fire1.y, self.thyristor_p1.fire, self.thyristor_n2.fire)
        yield connect(self.fire2.y, self.thyristor_p2.fire, self.thyristor_n1.fire)
