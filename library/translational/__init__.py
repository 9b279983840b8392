"""One-dimensional translation: masses, springs, dampers, forces, prescribed motions, sensors."""

from __future__ import annotations

from acausal.library.translational.bouncing import BouncingMass as BouncingMass
from acausal.library.translational.components import Backlash as Backlash
from acausal.library.translational.components import Damper as Damper
from acausal.library.translational.components import ElastoGap as ElastoGap
from acausal.library.translational.components import Fixed as Fixed
from acausal.library.translational.components import Mass as Mass
from acausal.library.translational.components import Rod as Rod
from acausal.library.translational.components import Spring as Spring
from acausal.library.translational.components import SpringDamper as SpringDamper
from acausal.library.translational.friction import Brake as Brake
from acausal.library.translational.friction import MassWithStopAndFriction as MassWithStopAndFriction
from acausal.library.translational.friction import PartialFriction as PartialFriction
from acausal.library.translational.friction import PartialGuided as PartialGuided
from acausal.library.translational.friction import SupportFriction as SupportFriction
from acausal.library.translational.interfaces import Flange as Flange
from acausal.library.translational.interfaces import PartialAbsoluteSensor as PartialAbsoluteSensor
from acausal.library.translational.interfaces import PartialCompliant as PartialCompliant
from acausal.library.translational.interfaces import (
    PartialCompliantWithRelativeStates as PartialCompliantWithRelativeStates,
)
from acausal.library.translational.interfaces import PartialCutSensor as PartialCutSensor
from acausal.library.translational.interfaces import PartialForce as PartialForce
from acausal.library.translational.interfaces import PartialRelativeSensor as PartialRelativeSensor
from acausal.library.translational.interfaces import PartialRigid as PartialRigid
from acausal.library.translational.interfaces import PartialTwoFlanges as PartialTwoFlanges
from acausal.library.translational.sensors import AccSensor as AccSensor
from acausal.library.translational.sensors import ForceSensor as ForceSensor
from acausal.library.translational.sensors import PositionSensor as PositionSensor
from acausal.library.translational.sensors import PowerSensor as PowerSensor
from acausal.library.translational.sensors import RelPositionSensor as RelPositionSensor
from acausal.library.translational.sensors import RelSpeedSensor as RelSpeedSensor
from acausal.library.translational.sensors import SpeedSensor as SpeedSensor
from acausal.library.translational.sources import Accelerate as Accelerate
from acausal.library.translational.sources import ConstantForce as ConstantForce
from acausal.library.translational.sources import Force as Force
from acausal.library.translational.sources import Force2 as Force2
from acausal.library.translational.sources import LinearSpeedDependentForce as LinearSpeedDependentForce
from acausal.library.translational.sources import PartialSpeedDependentForce as PartialSpeedDependentForce
from acausal.library.translational.sources import Position as Position
from acausal.library.translational.sources import QuadraticSpeedDependentForce as QuadraticSpeedDependentForce
from acausal.library.translational.sources import Speed as Speed
