"""Blocks with a limit. Names as in Modelica.Blocks.Nonlinear."""

from __future__ import annotations

from acausal import Equations, Real, assert_, clamp, parameter, where
from acausal.library.blocks.interfaces import PartialSISO


class Limiter(PartialSISO):
    """The input, limited to the range from `u_min` to `u_max`."""

    u_max: Real = parameter(default=1.0, doc="Upper limit")
    u_min: Real = parameter(default=lambda self: -self.u_max, doc="Lower limit")

    def equations(self) -> Equations:
        yield self.y == clamp(self.u, self.u_min, self.u_max)
        yield assert_(self.u_min <= self.u_max, "the lower limit u_min is above the upper limit u_max")


class DeadZone(PartialSISO):
    """Zero for inputs from `u_min` to `u_max`; outside, the input minus the limit that it has passed."""

    u_max: Real = parameter(default=1.0, doc="Upper end of the dead zone")
    u_min: Real = parameter(default=lambda self: -self.u_max, doc="Lower end of the dead zone")

    def equations(self) -> Equations:
        yield assert_(self.u_min <= self.u_max, "the lower end u_min is above the upper end u_max")
        below = where(self.u < self.u_min, self.u - self.u_min, 0.0)
        yield self.y == where(self.u > self.u_max, self.u - self.u_max, below)
