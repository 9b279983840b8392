"""Ideal switches and semiconductors. Names as in Modelica.Electrical.Analog.Ideal.

The characteristic of each consists of two straight lines in the plane of voltage and current, with the path parameter
`s`: conducting, v = Vknee + Ron*s and i = Goff*Vknee + s; blocking, v = Vknee + s and i = Goff*(Vknee + s).
The modes of connected elements depend on each other: they are a mixed system of equations, solved at events.

Source: C. Clauss, J. Haase, G. Kurth, P. Schwarz, Extended Admittance Description of Nonlinear n-Poles, AEU 40 (1995);
Modelica.Electrical.Analog.Interfaces.IdealSemiconductor.
"""

from __future__ import annotations

from acausal import (
    Equations,
    Real,
    boolean,
    boolean_input,
    discrete,
    edge,
    fabs,
    infinitesimal,
    minimum,
    parameter,
    pre,
    quantity,
    reset,
    time,
    unitless,
    variable,
    when,
    where,
)
from acausal.library.electrical.interfaces import PartialOnePort


class PartialIdealSwitching(PartialOnePort):
    """Element that conducts along one straight line and blocks along another; subclasses define `off`."""

    Ron: Real = parameter(default=1e-5, unit="Ohm", min=0.0, doc="Resistance while conducting")
    Goff: Real = parameter(default=1e-5, unit="S", min=0.0, doc="Conductance while blocking")
    Vknee: Real = parameter(default=0.0, unit="V", min=0.0, doc="Voltage above which it can conduct")
    off: Real = boolean(default=True, doc="Blocking")
    s: Real = variable(
        unit="1", doc="Path: the current [A] while conducting, the voltage minus Vknee [V] while blocking"
    )
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        # `s` has no unit: it stands for a voltage or a current.
        volt, ampere = quantity(1.0, "V"), quantity(1.0, "A")
        # If Ron = Goff = 0 leaves voltages or currents undetermined, all open elements get equal leakage conductances,
        # and all closed ones equal resistances.
        leak = infinitesimal() * self.s
        on, off = self.Ron * ampere, self.Goff * volt
        yield self.v == self.s * where(self.off, volt, on) + where(self.off, 0.0, leak) * volt + self.Vknee
        leaking = where(self.off, leak, 0.0) * ampere
        yield self.i == self.s * where(self.off, off, ampere) + leaking + self.Goff * self.Vknee
        yield self.loss_power == self.v * self.i


class IdealDiode(PartialIdealSwitching):
    """Ideal diode: it conducts from p to n if the voltage reaches `Vknee`, else it blocks."""

    def equations(self) -> Equations:
        yield self.off == (self.s < 0.0)


class IdealThyristor(PartialIdealSwitching):
    """Ideal thyristor: it begins to conduct when `fire` is true, and conducts until its current falls to zero."""

    fire: Real = boolean_input(doc="Lets it begin to conduct")

    def equations(self) -> Equations:
        yield self.off == ((self.s < 0.0) | (pre(self.off) & ~self.fire))


class IdealGTOThyristor(PartialIdealSwitching):
    """Ideal gate turn-off thyristor: it conducts only while `fire` is true."""

    fire: Real = boolean_input(doc="Lets it conduct")

    def equations(self) -> Equations:
        yield self.off == ((self.s < 0.0) | ~self.fire)


class IdealOpeningSwitch(PartialIdealSwitching):
    """Switch that opens while `control` is true; it conducts in both directions."""

    control: Real = boolean_input(doc="Opens the switch")

    def equations(self) -> Equations:
        yield self.off == self.control


class IdealClosingSwitch(PartialIdealSwitching):
    """Switch that closes while `control` is true; it conducts in both directions."""

    control: Real = boolean_input(doc="Closes the switch")

    def equations(self) -> Equations:
        yield self.off == ~self.control


class PartialIdealSwitchWithArc(PartialOnePort):
    """Switch that continues to conduct through an arc after opening, until the arc is quenched.

    The voltage of the arc is `V0 + dVdt*(t - t_opened)`, at most `Vmax`, against the current. It is quenched when the
    current is so small that an open switch would carry it; subclasses define `off`.
    """

    Ron: Real = parameter(default=1e-5, unit="Ohm", min=0.0, doc="Resistance while closed")
    Goff: Real = parameter(default=1e-5, unit="S", min=0.0, doc="Conductance while open")
    V0: Real = parameter(unit="V", doc="Initial voltage of the arc")
    dVdt: Real = parameter(unit="V/s", doc="Rate of it")
    Vmax: Real = parameter(unit="V", doc="Largest voltage of the arc")
    off: Real = boolean(doc="Not closed: open, or with an arc")
    quenched: Real = boolean(default=True, doc="No arc")
    t_opened: Real = discrete(unit="s", default=-1e10, doc="Time at which it last opened")

    def equations(self) -> Equations:
        yield when(edge(self.off), reset(self.t_opened, time))
        # Tested only while an arc burns: for an open switch, both sides are equal up to rounding errors.
        burns = self.off & ~pre(self.quenched)
        small = where(burns, fabs(self.i) - fabs(self.v) * self.Goff, 1.0) <= 0.0
        yield self.quenched == (self.off & (small | pre(self.quenched)))
        arc = minimum(self.Vmax, self.V0 + self.dVdt * (time - self.t_opened))
        burning = self.v - where(self.i < 0.0, -arc, arc)
        is_open, closed = self.i - self.Goff * self.v, self.v - self.Ron * self.i
        yield where(self.off, where(self.quenched, unitless(is_open), unitless(burning)), unitless(closed)) == 0.0


class OpenerWithArc(PartialIdealSwitchWithArc):
    """Switch with an arc that opens while `control` is true."""

    control: Real = boolean_input(doc="Opens the switch")

    def equations(self) -> Equations:
        yield self.off == self.control


class CloserWithArc(PartialIdealSwitchWithArc):
    """Switch with an arc that closes while `control` is true."""

    control: Real = boolean_input(doc="Closes the switch")

    def equations(self) -> Equations:
        yield self.off == ~self.control
