"""Semiconductors. Names as in Modelica.Electrical.Analog.Semiconductors."""

from __future__ import annotations

from acausal import Equations, Real, exp, guess, parameter, quantity, variable, where
from acausal.library.electrical.interfaces import PartialOnePort
from acausal.library.thermal.interfaces import HeatPort


class Diode(PartialOnePort):
    """Exponential diode with a resistor in parallel.

    `i = Ids*(exp(v/Vt) - 1) + v/R`. Above `v/Vt = Maxexp` the exponential is continued by its tangent, so that
    trial values of Newton's method cannot overflow; value and slope are continuous there.
    """

    Ids: Real = parameter(default=1e-6, unit="A", min=0.0, doc="Saturation current")
    Vt: Real = parameter(default=0.04, unit="V", min=1e-60, doc="Voltage equivalent of temperature")
    Maxexp: Real = parameter(default=15.0, unit="1", doc="Largest argument of the exponential")
    R: Real = parameter(default=1e8, unit="Ohm", min=1e-60, doc="Resistance in parallel")

    def equations(self) -> Equations:
        x = self.v / self.Vt
        tangent = exp(self.Maxexp) * (1.0 + x - self.Maxexp)
        yield self.i == self.Ids * (where(x > self.Maxexp, tangent, exp(x), smooth=True) - 1.0) + self.v / self.R


BOLTZMANN = 1.380649e-23
"""[J/K], exact."""

ELEMENTARY_CHARGE = 1.602176634e-19
"""[C], exact."""


class HeatingDiode(PartialOnePort):
    """Exponential diode with a heat port: its current depends on the temperature, and its losses heat the port.

    `i = Ids*(exp(v/(N*vt)) - 1)*(T/TNOM)^(XTI/N)*exp((T/TNOM - 1)*EG/(N*vt)) + v/R` with `vt = k*T/q`, continued by its
    tangent as in `Diode`.
    """

    _to_be_connected = ("heatPort",)

    heatPort: HeatPort = HeatPort()
    Ids: Real = parameter(default=1e-6, unit="A", min=0.0, doc="Saturation current")
    Maxexp: Real = parameter(default=15.0, unit="1", doc="Largest argument of the exponential")
    R: Real = parameter(default=1e8, unit="Ohm", min=1e-60, doc="Resistance in parallel")
    EG: Real = parameter(default=1.11, unit="V", doc="Activation energy divided by the elementary charge")
    N: Real = parameter(default=1.0, unit="1", doc="Emission coefficient")
    TNOM: Real = parameter(default=300.15, unit="K", min=0.0, doc="Temperature at which the parameters were measured")
    XTI: Real = parameter(default=3.0, unit="1", doc="Exponent of the saturation current's temperature")
    vt_t: Real = variable(unit="V", nominal=0.03, default=guess(0.025), doc="Voltage equivalent of temperature")
    id: Real = variable(unit="A", doc="Current at the nominal temperature")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        share = self.heatPort.T / self.TNOM
        scale = self.N * self.vt_t
        x = self.v / scale
        tangent = exp(self.Maxexp) * (1.0 + x - self.Maxexp)
        yield self.vt_t == quantity(_VOLT_PER_KELVIN, "V/K") * self.heatPort.T
        yield self.id == self.Ids * (where(x > self.Maxexp, tangent, exp(x), smooth=True) - 1.0)
        warmer = share ** (self.XTI / self.N) * exp((share - 1.0) * self.EG / scale)
        yield self.i == self.id * warmer + self.v / self.R
        yield self.loss_power == self.v * self.i
        yield self.heatPort.Q_flow == -self.loss_power


_VOLT_PER_KELVIN = BOLTZMANN / ELEMENTARY_CHARGE
