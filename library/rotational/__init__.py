"""One-dimensional rotation: inertias, springs, dampers, gears, torques, prescribed motions, sensors."""

from __future__ import annotations

from acausal.library.rotational.components import Backlash as Backlash
from acausal.library.rotational.components import Damper as Damper
from acausal.library.rotational.components import ElastoBacklash as ElastoBacklash
from acausal.library.rotational.components import Fixed as Fixed
from acausal.library.rotational.components import IdealGear as IdealGear
from acausal.library.rotational.components import IdealGearR2T as IdealGearR2T
from acausal.library.rotational.components import IdealGearWithSupport as IdealGearWithSupport
from acausal.library.rotational.components import IdealRollingWheel as IdealRollingWheel
from acausal.library.rotational.components import Inertia as Inertia
from acausal.library.rotational.components import Spring as Spring
from acausal.library.rotational.components import SpringDamper as SpringDamper
from acausal.library.rotational.friction import BearingFriction as BearingFriction
from acausal.library.rotational.friction import Brake as Brake
from acausal.library.rotational.friction import Clutch as Clutch
from acausal.library.rotational.friction import OneWayClutch as OneWayClutch
from acausal.library.rotational.friction import PartialBetweenShaftAndGround as PartialBetweenShaftAndGround
from acausal.library.rotational.friction import PartialFriction as PartialFriction
from acausal.library.rotational.friction import PartialNormalForce as PartialNormalForce
from acausal.library.rotational.interfaces import Flange as Flange
from acausal.library.rotational.interfaces import PartialAbsoluteSensor as PartialAbsoluteSensor
from acausal.library.rotational.interfaces import PartialCompliant as PartialCompliant
from acausal.library.rotational.interfaces import (
    PartialCompliantWithRelativeStates as PartialCompliantWithRelativeStates,
)
from acausal.library.rotational.interfaces import PartialCutSensor as PartialCutSensor
from acausal.library.rotational.interfaces import PartialRelativeSensor as PartialRelativeSensor
from acausal.library.rotational.interfaces import PartialRotationToTranslation as PartialRotationToTranslation
from acausal.library.rotational.interfaces import PartialTorque as PartialTorque
from acausal.library.rotational.interfaces import PartialTwoFlanges as PartialTwoFlanges
from acausal.library.rotational.lossy import LossyGear as LossyGear
from acausal.library.rotational.sensors import AccSensor as AccSensor
from acausal.library.rotational.sensors import AngleSensor as AngleSensor
from acausal.library.rotational.sensors import PowerSensor as PowerSensor
from acausal.library.rotational.sensors import RelAngleSensor as RelAngleSensor
from acausal.library.rotational.sensors import RelSpeedSensor as RelSpeedSensor
from acausal.library.rotational.sensors import SpeedSensor as SpeedSensor
from acausal.library.rotational.sensors import TorqueSensor as TorqueSensor
from acausal.library.rotational.sources import Accelerate as Accelerate
from acausal.library.rotational.sources import ConstantTorque as ConstantTorque
from acausal.library.rotational.sources import EddyCurrentTorque as EddyCurrentTorque
from acausal.library.rotational.sources import LinearSpeedDependentTorque as LinearSpeedDependentTorque
from acausal.library.rotational.sources import PartialSpeedDependentTorque as PartialSpeedDependentTorque
from acausal.library.rotational.sources import Position as Position
from acausal.library.rotational.sources import QuadraticSpeedDependentTorque as QuadraticSpeedDependentTorque
from acausal.library.rotational.sources import Speed as Speed
from acausal.library.rotational.sources import Torque as Torque
from acausal.library.rotational.sources import Torque2 as Torque2
