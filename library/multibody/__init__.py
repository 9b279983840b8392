"""Three-dimensional mechanics, in the vocabulary of Modelica.Mechanics.MultiBody.

`frames.py` states the conventions. Joints and parts connect frames; mechanisms are attached to `World` or `Fixed`; an
unattached body moves freely.
"""

from __future__ import annotations

from acausal.library.multibody.bodies import Body as Body
from acausal.library.multibody.bodies import BodyShape as BodyShape
from acausal.library.multibody.constraints import PrismaticConstraint as PrismaticConstraint
from acausal.library.multibody.constraints import RevoluteConstraint as RevoluteConstraint
from acausal.library.multibody.forces import Force as Force
from acausal.library.multibody.forces import FrameForce as FrameForce
from acausal.library.multibody.forces import FrameTorque as FrameTorque
from acausal.library.multibody.forces import ResolveIn as ResolveIn
from acausal.library.multibody.forces import Torque as Torque
from acausal.library.multibody.forces import WorldForce as WorldForce
from acausal.library.multibody.forces import WorldTorque as WorldTorque
from acausal.library.multibody.frames import Frame as Frame
from acausal.library.multibody.gravity import point_field as point_field
from acausal.library.multibody.gravity import uniform_field as uniform_field
from acausal.library.multibody.joints import FreeMotion as FreeMotion
from acausal.library.multibody.joints import GearConstraint as GearConstraint
from acausal.library.multibody.joints import Prismatic as Prismatic
from acausal.library.multibody.joints import Revolute as Revolute
from acausal.library.multibody.joints import RevolutePlanarLoopConstraint as RevolutePlanarLoopConstraint
from acausal.library.multibody.joints import RollingWheel as RollingWheel
from acausal.library.multibody.joints import Spherical as Spherical
from acausal.library.multibody.joints import Universal as Universal
from acausal.library.multibody.line_forces import Damper as Damper
from acausal.library.multibody.line_forces import Spring as Spring
from acausal.library.multibody.line_forces import SpringDamperParallel as SpringDamperParallel
from acausal.library.multibody.line_forces import SpringWithMass as SpringWithMass
from acausal.library.multibody.orientation import axes_rotation as axes_rotation
from acausal.library.multibody.orientation import axis_rotation as axis_rotation
from acausal.library.multibody.orientation import quaternion as quaternion
from acausal.library.multibody.orientation import rotation_sequence as rotation_sequence
from acausal.library.multibody.parts import Fixed as Fixed
from acausal.library.multibody.parts import FixedRotation as FixedRotation
from acausal.library.multibody.parts import FixedTranslation as FixedTranslation
from acausal.library.multibody.sensors import AbsoluteSensor as AbsoluteSensor
from acausal.library.multibody.sensors import CutForce as CutForce
from acausal.library.multibody.sensors import CutTorque as CutTorque
from acausal.library.multibody.sensors import RelativeSensor as RelativeSensor
from acausal.library.multibody.shapes import BodyBox as BodyBox
from acausal.library.multibody.shapes import BodyCylinder as BodyCylinder
from acausal.library.multibody.shapes import PointMass as PointMass
from acausal.library.multibody.world import World as World

# How its components are drawn: loaded by animations only.
__looks__ = "acausal.library.multibody.looks"
