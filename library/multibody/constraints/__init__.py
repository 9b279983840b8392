"""Joints as constraints, for bodies with independent coordinates and for closing loops."""

from __future__ import annotations

from acausal.library.multibody.constraints.prismatic import PrismaticConstraint as PrismaticConstraint
from acausal.library.multibody.constraints.revolute import RevoluteConstraint as RevoluteConstraint
