"""Blocks with a limit. Names as in Modelica.Blocks.Nonlinear."""

from __future__ import annotations

from acausal import Equations, Real, clamp, parameter
from acausal.library.blocks.interfaces import PartialSISO


class Limiter(PartialSISO):
    """Input, limited to the range from `u_min` to `u_max`."""

    u_max: Real = parameter(default=1.0, doc="Upper limit")
    u_min: Real = parameter(default=lambda self: -self.u_max, doc="Lower limit")

    def equations(self) -> Equations:
        yield self.y == clamp(self.u, self.u_min, self.u_max)
