"""Fields along one dimension: heat in a bar, a front of growth, a step on a cable."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part, structural
from acausal.library.electrical import Ground, RampVoltage, Resistor
from acausal.library.fields import FixedConcentration, HeatBar, LogisticChannel, TransmissionLine
from acausal.library.thermal import FixedTemperature, ThermalConductor


class HeatedBar(Component):
    """A steel bar with one end in boiling water; the other end loses heat to the air."""

    n: int = structural(default=50, doc="Number of cells")
    water: FixedTemperature = FixedTemperature(T=373.15)
    bar: HeatBar = part()
    convection: ThermalConductor = ThermalConductor(G=2e-3)
    air: FixedTemperature = FixedTemperature(T=293.15)

    experiment: ClassVar[Experiment] = Experiment(stop_time=7200.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("bar.T[0]", "bar.T[10]", "bar.T[25]", "bar.port_b.T"), title="Along the bar"),
        Panel(("bar.port_a.Q_flow",), title="Heat from the water"),
    )

    def build(self) -> None:
        self.bar = HeatBar(n=self.n, length=0.3)

    def equations(self) -> Equations:
        yield connect(self.water.port, self.bar.port_a)
        yield connect(self.bar.port_b, self.convection.port_a)
        yield connect(self.convection.port_b, self.air.port)


class FisherFront(Component):
    """A front of logistic growth that enters an empty channel at 2*sqrt(k*D), 20 mm/s."""

    n: int = structural(default=200, doc="Number of cells")
    full: FixedConcentration = FixedConcentration(c=1.0)
    channel: LogisticChannel = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=40.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("channel.c[50]", "channel.c[100]", "channel.c[150]"), title="The front passes"),
    )

    def build(self) -> None:
        self.channel = LogisticChannel(n=self.n, D=1e-4, k=1.0)

    def equations(self) -> Equations:
        yield connect(self.full.port, self.channel.port_a)


class CableReflection(Component):
    """A voltage step on 10 m of cable: it reaches the load after 50 ns and is reflected to the source."""

    R_load: Real = parameter(default=150.0, unit="Ohm", min=0.0, doc="Load; the line has 50 Ohm")
    source: RampVoltage = RampVoltage(V=1.0, duration=5e-9, start_time=1e-8)
    inner: Resistor = Resistor(R=50.0)
    line: TransmissionLine = TransmissionLine(N=200, length=10.0, r=0.05)
    load: Resistor = part()
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=3e-7, tolerance=1e-5)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("line.p1.v", "line.p2.v"), title="Both ends of the line"),)

    def build(self) -> None:
        self.load = Resistor(R=self.R_load)

    def equations(self) -> Equations:
        yield connect(self.source.p, self.inner.p)
        yield connect(self.inner.n, self.line.p1)
        yield connect(self.line.p2, self.load.p)
        yield connect(self.source.n, self.line.p3, self.load.n, self.ground.p)
