"""Analog circuits: linear elements, diode, sources, sensors."""

from __future__ import annotations

from acausal.library.electrical.components import Capacitor as Capacitor
from acausal.library.electrical.components import Conductor as Conductor
from acausal.library.electrical.components import Ground as Ground
from acausal.library.electrical.components import HeatingResistor as HeatingResistor
from acausal.library.electrical.components import IdealTransformer as IdealTransformer
from acausal.library.electrical.components import Inductor as Inductor
from acausal.library.electrical.components import Resistor as Resistor
from acausal.library.electrical.components import SaturatingInductor as SaturatingInductor
from acausal.library.electrical.emf import RotationalEMF as RotationalEMF
from acausal.library.electrical.emf import TranslationalEMF as TranslationalEMF
from acausal.library.electrical.ideal import CloserWithArc as CloserWithArc
from acausal.library.electrical.ideal import IdealClosingSwitch as IdealClosingSwitch
from acausal.library.electrical.ideal import IdealDiode as IdealDiode
from acausal.library.electrical.ideal import IdealGTOThyristor as IdealGTOThyristor
from acausal.library.electrical.ideal import IdealOpeningSwitch as IdealOpeningSwitch
from acausal.library.electrical.ideal import IdealThyristor as IdealThyristor
from acausal.library.electrical.ideal import OpenerWithArc as OpenerWithArc
from acausal.library.electrical.ideal import PartialIdealSwitching as PartialIdealSwitching
from acausal.library.electrical.ideal import PartialIdealSwitchWithArc as PartialIdealSwitchWithArc
from acausal.library.electrical.interfaces import PartialOnePort as PartialOnePort
from acausal.library.electrical.interfaces import PartialTwoPort as PartialTwoPort
from acausal.library.electrical.interfaces import Pin as Pin
from acausal.library.electrical.semiconductors import Diode as Diode
from acausal.library.electrical.semiconductors import HeatingDiode as HeatingDiode
from acausal.library.electrical.sensors import CurrentSensor as CurrentSensor
from acausal.library.electrical.sensors import PotentialSensor as PotentialSensor
from acausal.library.electrical.sensors import VoltageSensor as VoltageSensor
from acausal.library.electrical.sources import ConstantCurrent as ConstantCurrent
from acausal.library.electrical.sources import ConstantVoltage as ConstantVoltage
from acausal.library.electrical.sources import PartialCurrentSource as PartialCurrentSource
from acausal.library.electrical.sources import PartialVoltageSource as PartialVoltageSource
from acausal.library.electrical.sources import RampCurrent as RampCurrent
from acausal.library.electrical.sources import RampVoltage as RampVoltage
from acausal.library.electrical.sources import SignalCurrent as SignalCurrent
from acausal.library.electrical.sources import SignalVoltage as SignalVoltage
from acausal.library.electrical.sources import SineCurrent as SineCurrent
from acausal.library.electrical.sources import SineVoltage as SineVoltage
from acausal.library.electrical.sources import StepCurrent as StepCurrent
from acausal.library.electrical.sources import StepVoltage as StepVoltage
