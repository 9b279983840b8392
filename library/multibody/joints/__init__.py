"""Joints, which constrain the relative motion of two frames."""

from __future__ import annotations

from acausal.library.multibody.joints.free_motion import FreeMotion as FreeMotion
from acausal.library.multibody.joints.gear_constraint import GearConstraint as GearConstraint
from acausal.library.multibody.joints.planar_loop import RevolutePlanarLoopConstraint as RevolutePlanarLoopConstraint
from acausal.library.multibody.joints.prismatic import Prismatic as Prismatic
from acausal.library.multibody.joints.revolute import Revolute as Revolute
from acausal.library.multibody.joints.rolling_wheel import RollingWheel as RollingWheel
from acausal.library.multibody.joints.spherical import Spherical as Spherical
from acausal.library.multibody.joints.universal import Universal as Universal
