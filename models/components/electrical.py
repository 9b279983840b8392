"""Current sources, switches with arcs, heated parts, machines: components of `acausal.library.electrical`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed
from acausal.library.blocks import BooleanPulse, BooleanStep, Not, Sine
from acausal.library.electrical import (
    Capacitor,
    CloserWithArc,
    Conductor,
    ConstantCurrent,
    ConstantVoltage,
    CurrentSensor,
    Diode,
    Ground,
    HeatingDiode,
    HeatingResistor,
    IdealGTOThyristor,
    IdealOpeningSwitch,
    IdealTransformer,
    Inductor,
    OpenerWithArc,
    PotentialSensor,
    RampCurrent,
    Resistor,
    RotationalEMF,
    SaturatingInductor,
    SignalCurrent,
    SignalVoltage,
    SineCurrent,
    SineVoltage,
    StepCurrent,
    TranslationalEMF,
    VoltageSensor,
)
from acausal.library.rotational import Inertia, LinearSpeedDependentTorque
from acausal.library.thermal import FixedTemperature, HeatCapacitor, ThermalConductor
from acausal.library.translational import Fixed, Mass, SpringDamper


class CurrentSources(Component):
    """Five current sources charge one leaky capacitor."""

    constant: ConstantCurrent = ConstantCurrent(I=0.2)
    step: StepCurrent = StepCurrent(I=0.5, start_time=1.0)
    ramp: RampCurrent = RampCurrent(I=-0.5, start_time=3.0, duration=2.0)
    sine: SineCurrent = SineCurrent(I=0.2, f=1.0, start_time=5.0)
    signal: SignalCurrent = SignalCurrent()
    control: Sine = Sine(amplitude=0.1, f=4.0)
    capacitor: Capacitor = Capacitor(C=0.1, v=fixed(0.0))
    leak: Conductor = Conductor(G=0.5)
    current: CurrentSensor = CurrentSensor()
    potential: PotentialSensor = PotentialSensor()
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=8.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("constant.i", "step.i", "ramp.i", "sine.i", "signal.i"), title="Currents of the sources"),
        Panel(("potential.phi",), title="Potential of the capacitor"),
    )

    def equations(self) -> Equations:
        sources = (self.constant, self.step, self.ramp, self.sine, self.signal)
        yield connect(self.control.y, self.signal.u)
        # A source drives its current from p through itself to n.
        yield connect(self.ground.p, *(s.p for s in sources))
        yield connect(self.current.p, *(s.n for s in sources))
        yield connect(self.current.n, self.capacitor.p, self.leak.p, self.potential.p)
        yield connect(self.capacitor.n, self.leak.n, self.ground.p)


class TransformerOnLine(Component):
    """A signal voltage feeds a load through an ideal 10:1 transformer."""

    control: Sine = Sine(amplitude=325.0, f=50.0)
    source: SignalVoltage = SignalVoltage()
    line: Resistor = Resistor(R=10.0)
    transformer: IdealTransformer = IdealTransformer(n=10.0)
    load: Resistor = Resistor(R=1.0)
    voltage: VoltageSensor = VoltageSensor()
    ground1: Ground = Ground()
    ground2: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.04)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "transformer.v1", "voltage.v"), title="Voltages"),
        Panel(("transformer.i1", "load.i"), title="Currents"),
    )

    def equations(self) -> Equations:
        yield connect(self.control.y, self.source.u)
        yield connect(self.source.p, self.line.p)
        yield connect(self.line.n, self.transformer.p1)
        yield connect(self.source.n, self.transformer.n1, self.ground1.p)
        yield connect(self.transformer.p2, self.load.p, self.voltage.p)
        yield connect(self.transformer.n2, self.load.n, self.voltage.n, self.ground2.p)


class SaturatedCoil(Component):
    """A coil with saturating iron: its current has peaks where that of a linear one (`coil`) is a sine."""

    source: SineVoltage = SineVoltage(V=2.0, f=0.2)
    resistor1: Resistor = Resistor(R=0.1)
    saturating: SaturatingInductor = SaturatingInductor(Inom=1.0, Lnom=1.0, Lzer=2.0, Linf=0.5, Psi=fixed(0.0))
    resistor2: Resistor = Resistor(R=0.1)
    coil: Inductor = Inductor(L=1.0, i=fixed(0.0))
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("saturating.i", "coil.i"), title="Currents"),
        Panel(("saturating.Psi",), against="saturating.i", title="Flux linkage against current"),
    )

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor1.p, self.resistor2.p)
        yield connect(self.resistor1.n, self.saturating.p)
        yield connect(self.resistor2.n, self.coil.p)
        yield connect(self.source.n, self.saturating.n, self.coil.n, self.ground.p)


class HeatedCircuit(Component):
    """A resistor and a diode heat a common body; another diode keeps its temperature."""

    source: ConstantVoltage = ConstantVoltage(V=5.0)
    hot_resistor: HeatingResistor = HeatingResistor(R_ref=10.0, alpha=4e-3)
    hot_diode: HeatingDiode = HeatingDiode()
    resistor: Resistor = Resistor(R=10.0)
    diode: Diode = Diode()
    body: HeatCapacitor = HeatCapacitor(C=2.0, T=fixed(300.15))
    to_air: ThermalConductor = ThermalConductor(G=0.02)
    air: FixedTemperature = FixedTemperature(T=300.15)
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=600.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("hot_resistor.i", "resistor.i"), title="Currents"),
        Panel(("hot_diode.v", "diode.v"), title="Voltages of the diodes"),
        Panel(("body.T",), title="Temperature of the body"),
    )

    def equations(self) -> Equations:
        yield connect(self.source.p, self.hot_resistor.p, self.resistor.p)
        yield connect(self.hot_resistor.n, self.hot_diode.p)
        yield connect(self.resistor.n, self.diode.p)
        yield connect(self.source.n, self.hot_diode.n, self.diode.n, self.ground.p)
        yield connect(self.hot_resistor.heatPort, self.hot_diode.heatPort, self.body.port, self.to_air.port_a)
        yield connect(self.to_air.port_b, self.air.port)


class SwitchedCoils(Component):
    """Three switches interrupt the current of a coil: two with an arc, an ideal one with unlimited voltage."""

    opening: BooleanStep = BooleanStep(start_time=0.012)
    closing: Not = Not()
    source: SineVoltage = SineVoltage(V=325.0, f=50.0)
    opener: OpenerWithArc = OpenerWithArc(V0=30.0, dVdt=1e4, Vmax=60.0)
    closer: CloserWithArc = CloserWithArc(V0=30.0, dVdt=1e4, Vmax=60.0)
    ideal: IdealOpeningSwitch = IdealOpeningSwitch(Goff=1e-3)
    coil1: Inductor = Inductor(L=0.01, i=fixed(0.0))
    coil2: Inductor = Inductor(L=0.02, i=fixed(0.0))
    coil3: Inductor = Inductor(L=0.04, i=fixed(0.0))
    load1: Resistor = Resistor(R=5.0)
    load2: Resistor = Resistor(R=5.0)
    load3: Resistor = Resistor(R=5.0)
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.02)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("opener.i", "closer.i", "ideal.i"), title="Currents"),
        Panel(("opener.v", "closer.v"), title="Voltages of the arcs"),
    )

    def equations(self) -> Equations:
        yield connect(self.opening.y, self.opener.control, self.ideal.control, self.closing.u)
        yield connect(self.closing.y, self.closer.control)
        yield connect(self.source.p, self.opener.p, self.closer.p, self.ideal.p)
        yield connect(self.opener.n, self.coil1.p)
        yield connect(self.closer.n, self.coil2.p)
        yield connect(self.ideal.n, self.coil3.p)
        yield connect(self.coil1.n, self.load1.p)
        yield connect(self.coil2.n, self.load2.p)
        yield connect(self.coil3.n, self.load3.p)
        yield connect(self.load1.n, self.load2.n, self.load3.n, self.source.n, self.ground.p)


class ChoppedHalfWave(Component):
    """A gate turn-off thyristor that conducts in the first half of each positive half wave."""

    source: SineVoltage = SineVoltage(V=325.0, f=50.0)
    fire: BooleanPulse = BooleanPulse(period=0.02, width=0.25)
    thyristor: IdealGTOThyristor = IdealGTOThyristor()
    load: Resistor = Resistor(R=100.0)
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.06)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "load.v"), title="Voltages"),
        Panel(("fire.y",), title="Gate"),
    )

    def equations(self) -> Equations:
        yield connect(self.fire.y, self.thyristor.fire)
        yield connect(self.source.p, self.thyristor.p)
        yield connect(self.thyristor.n, self.load.p)
        yield connect(self.load.n, self.source.n, self.ground.p)


class MotorStart(Component):
    """A DC motor starts on a constant voltage and drives a fan."""

    source: ConstantVoltage = ConstantVoltage(V=24.0)
    resistor: Resistor = Resistor(R=0.5)
    inductor: Inductor = Inductor(L=1e-3, i=fixed(0.0))
    emf: RotationalEMF = RotationalEMF(k=0.1)
    rotor: Inertia = Inertia(J=1e-3, phi=fixed(0.0), w=fixed(0.0))
    fan: LinearSpeedDependentTorque = LinearSpeedDependentTorque(tau_nominal=-0.5, w_nominal=200.0)
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.4)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("inductor.i",), title="Current"),
        Panel(("rotor.w",), title="Speed", unit="rpm"),
    )

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p)
        yield connect(self.resistor.n, self.inductor.p)
        yield connect(self.inductor.n, self.emf.p)
        yield connect(self.emf.n, self.source.n, self.ground.p)
        yield connect(self.emf.flange, self.rotor.flange_a)
        yield connect(self.rotor.flange_b, self.fan.flange)


class VoiceCoil(Component):
    """A loudspeaker coil in its magnet, driven by a tone near the resonance of the membrane."""

    source: SineVoltage = SineVoltage(V=2.0, f=60.0)
    resistor: Resistor = Resistor(R=6.0)
    inductor: Inductor = Inductor(L=5e-4, i=fixed(0.0))
    coil: TranslationalEMF = TranslationalEMF(k=6.0)
    membrane: Mass = Mass(m=0.01, s=fixed(0.0), v=fixed(0.0))
    rim: SpringDamper = SpringDamper(c=1500.0, d=1.0)
    basket: Fixed = Fixed()
    ground: Ground = Ground()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.15)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("source.v", "coil.v"), title="Voltage, and what the motion induces"),
        Panel(("membrane.s",), title="Membrane"),
    )

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p)
        yield connect(self.resistor.n, self.inductor.p)
        yield connect(self.inductor.n, self.coil.p)
        yield connect(self.coil.n, self.source.n, self.ground.p)
        yield connect(self.coil.flange, self.membrane.flange_a)
        yield connect(self.membrane.flange_b, self.rim.flange_a)
        yield connect(self.rim.flange_b, self.basket.flange)
