"""Semiconductors. Names as in Modelica.Electrical.Analog.Semiconductors."""

from __future__ import annotations

from acausal import Equations, Real, exp, parameter, where
from acausal.library.electrical.interfaces import PartialOnePort


class Diode(PartialOnePort):
    """Exponential diode with a resistor in parallel.

    `i = Ids*(exp(v/Vt) - 1) + v/R`. Above `v/Vt = Maxexp` the exponential goes on as its tangent, so that
    trial values of Newton's method cannot overflow; value and slope are continuous there.
    """

    Ids: Real = parameter(default=1e-6, unit="A", min=0.0, doc="Saturation current")
    Vt: Real = parameter(default=0.04, unit="V", min=0.0, doc="Voltage equivalent of temperature; greater than 0")
    Maxexp: Real = parameter(default=15.0, unit="1", doc="Largest argument of the exponential")
    R: Real = parameter(default=1e8, unit="Ohm", min=0.0, doc="Resistance in parallel; greater than 0")

    def equations(self) -> Equations:
        x = self.v / self.Vt
        tangent = exp(self.Maxexp) * (1.0 + x - self.Maxexp)
        yield self.i == self.Ids * (where(x > self.Maxexp, tangent, exp(x), smooth=True) - 1.0) + self.v / self.R
