"""Heat transfer of lumped bodies: capacities, conduction, convection, radiation, sources, sensors."""

from __future__ import annotations

from acausal.library.thermal.components import BodyRadiation as BodyRadiation
from acausal.library.thermal.components import Convection as Convection
from acausal.library.thermal.components import HeatCapacitor as HeatCapacitor
from acausal.library.thermal.components import ThermalConductor as ThermalConductor
from acausal.library.thermal.components import ThermalResistor as ThermalResistor
from acausal.library.thermal.interfaces import HeatPort as HeatPort
from acausal.library.thermal.interfaces import PartialElement1D as PartialElement1D
from acausal.library.thermal.sensors import HeatFlowSensor as HeatFlowSensor
from acausal.library.thermal.sensors import RelTemperatureSensor as RelTemperatureSensor
from acausal.library.thermal.sensors import TemperatureSensor as TemperatureSensor
from acausal.library.thermal.sources import FixedHeatFlow as FixedHeatFlow
from acausal.library.thermal.sources import FixedTemperature as FixedTemperature
from acausal.library.thermal.sources import PartialHeatFlow as PartialHeatFlow
from acausal.library.thermal.sources import PrescribedHeatFlow as PrescribedHeatFlow
from acausal.library.thermal.sources import PrescribedTemperature as PrescribedTemperature
