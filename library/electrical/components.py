"""Linear circuit elements. Names and signs as in Modelica.Electrical.Analog.Basic."""

from __future__ import annotations

import math

from acausal import Component, Equations, Real, atan, der, fabs, guess, no_event, parameter, variable, where
from acausal.library.electrical.interfaces import PartialOnePort, PartialTwoPort, Pin
from acausal.library.thermal.interfaces import HeatPort


class Ground(Component):
    """Ground: potential 0 V at its pin. Every circuit needs one."""

    p: Pin = Pin()

    def equations(self) -> Equations:
        yield self.p.v == 0.0


class Resistor(PartialOnePort):
    """Linear resistor; a negative resistance is an active element."""

    R: Real = parameter(unit="Ohm", doc="Resistance")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.v == self.R * self.i
        yield self.loss_power == self.v * self.i


class Conductor(PartialOnePort):
    """Linear conductor; with G = 0 an open connection."""

    G: Real = parameter(unit="S", doc="Conductance")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.i == self.G * self.v
        yield self.loss_power == self.v * self.i


class Capacitor(PartialOnePort):
    """Linear capacitor; its start value is that of `v`."""

    C: Real = parameter(unit="F", min=0.0, doc="Capacitance")

    def equations(self) -> Equations:
        yield self.i == self.C * der(self.v)


class Inductor(PartialOnePort):
    """Linear inductor; its start value is that of `i`."""

    L: Real = parameter(unit="H", min=0.0, doc="Inductance")

    def equations(self) -> Equations:
        yield self.L * der(self.i) == self.v


class HeatingResistor(PartialOnePort):
    """Resistor with R = R_ref*(1 + alpha*(T - T_ref)), T the temperature of its heat port, which takes its losses."""

    _to_be_connected = ("heatPort",)

    heatPort: HeatPort = HeatPort()
    R_ref: Real = parameter(unit="Ohm", doc="Resistance at T_ref")
    T_ref: Real = parameter(default=300.15, unit="K", doc="Reference temperature")
    alpha: Real = parameter(default=0.0, unit="1/K", doc="Relative rise of the resistance with temperature")
    R_actual: Real = variable(unit="Ohm", doc="Resistance at the temperature of the heat port")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        yield self.R_actual == self.R_ref * (1.0 + self.alpha * (self.heatPort.T - self.T_ref))
        yield self.v == self.R_actual * self.i
        yield self.loss_power == self.v * self.i
        yield self.heatPort.Q_flow == -self.loss_power


class SaturatingInductor(PartialOnePort):
    """Inductor whose iron saturates; its start value is that of `Psi`.

    `Psi = Linf*i + (Lzer - Linf)*Ipar*atan(i/Ipar)`, where `Ipar` follows from the inductance Lnom at Inom:
    `(Lnom - Linf)/(Lzer - Linf) = Ipar/Inom*(pi/2 - atan(Ipar/Inom))`.
    """

    Inom: Real = parameter(default=1.0, unit="A", min=0.0, doc="Nominal current")
    Lnom: Real = parameter(default=1.0, unit="H", min=0.0, doc="Inductance at the nominal current; Linf < Lnom < Lzer")
    Lzer: Real = parameter(default=2.0, unit="H", min=0.0, doc="Inductance near zero current")
    Linf: Real = parameter(default=0.5, unit="H", min=0.0, doc="Inductance at large currents")
    Psi: Real = variable(unit="Wb", prefer_state=True, doc="Flux linkage")
    Lact: Real = variable(unit="H", doc="Inductance Psi/i; Lzer without current")
    share: Real = variable(unit="1", default=guess(0.25), doc="Ipar/Inom")

    def equations(self) -> Equations:
        slope = self.Lzer - self.Linf
        x = self.i / (self.share * self.Inom)
        yield (self.Lnom - self.Linf) / slope == self.share * (math.pi / 2 - atan(self.share))
        yield self.Lact == self.Linf + slope * where(no_event(fabs(x) > 1e-6), atan(x) / x, 1.0, smooth=True)
        yield self.Psi == self.Linf * self.i + slope * self.share * self.Inom * atan(x)
        yield self.v == der(self.Psi)


class IdealTransformer(PartialTwoPort):
    """Ideal transformer: v1 = n*v2, i2 = -n*i1. Without magnetisation, it transforms direct current too."""

    n: Real = parameter(unit="1", doc="Turns ratio primary : secondary")

    def equations(self) -> Equations:
        yield self.v1 == self.n * self.v2
        yield self.i2 == -self.n * self.i1
