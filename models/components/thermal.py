"""A room with heater and thermostat: components of `acausal.library.thermal`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed
from acausal.library.blocks import BooleanToReal, Constant, OnOffController, Sine
from acausal.library.thermal import (
    BodyRadiation,
    Convection,
    FixedHeatFlow,
    HeatCapacitor,
    HeatFlowSensor,
    PrescribedHeatFlow,
    PrescribedTemperature,
    RelTemperatureSensor,
    TemperatureSensor,
    ThermalResistor,
)


class HeatedRoom(Component):
    """A thermostat switches a radiator for a night; it heats the room by convection and radiation."""

    set_point: Constant = Constant(k=293.15)
    thermostat: OnOffController = OnOffController(bandwidth=1.0)
    power: BooleanToReal = BooleanToReal(real_true=1500.0)
    heater: PrescribedHeatFlow = PrescribedHeatFlow()
    radiator: HeatCapacitor = HeatCapacitor(C=2e4, T=fixed(293.15))
    convection: Convection = Convection()
    flow_of_air: Constant = Constant(k=15.0)
    radiation: BodyRadiation = BodyRadiation(Gr=1.5)
    room: HeatCapacitor = HeatCapacitor(C=4e5, T=fixed(293.15))
    person: FixedHeatFlow = FixedHeatFlow(Q_flow=80.0)
    wall: ThermalResistor = ThermalResistor(R=0.03)
    loss: HeatFlowSensor = HeatFlowSensor()
    weather: Sine = Sine(offset=275.15, amplitude=-5.0, f=1.0 / 86400.0)
    outside: PrescribedTemperature = PrescribedTemperature()
    measured: TemperatureSensor = TemperatureSensor()
    above_room: RelTemperatureSensor = RelTemperatureSensor()

    experiment: ClassVar[Experiment] = Experiment(stop_time=43200.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("measured.T",), title="Temperature of the room", unit="degC"),
        Panel(("radiator.T", "outside.T"), title="Radiator and weather", unit="degC"),
        Panel(("heater.Q_flow", "loss.Q_flow"), title="Heat of the heater and through the wall"),
    )

    def equations(self) -> Equations:
        yield connect(self.set_point.y, self.thermostat.reference)
        yield connect(self.measured.T, self.thermostat.u)
        yield connect(self.thermostat.y, self.power.u)
        yield connect(self.power.y, self.heater.Q_flow)
        yield connect(self.flow_of_air.y, self.convection.Gc)
        yield connect(self.heater.port, self.radiator.port, self.convection.solid, self.radiation.port_a)
        yield connect(self.radiator.port, self.above_room.port_a)
        yield connect(self.convection.fluid, self.radiation.port_b, self.room.port, self.person.port)
        yield connect(self.room.port, self.measured.port, self.above_room.port_b, self.wall.port_a)
        yield connect(self.wall.port_b, self.loss.port_a)
        yield connect(self.loss.port_b, self.outside.port)
        yield connect(self.weather.y, self.outside.T)
