"""Flange and the partial components of one-dimensional translation.

Signs as in Modelica.Mechanics.Translational: the cut force `f` of a flange is positive into the component;
the force of a line element is positive when it pulls its flanges together.
"""

from __future__ import annotations

from acausal import Component, Connector, Equations, Real, der, flow, parameter, variable


class Flange(Connector):
    """One-dimensional translational flange."""

    s: Real = variable(
        unit="m",
        doc="Absolute position of the flange",
        hint="is this flange connected to something with mass, to Fixed or to a Position source?",
    )
    f: Real = flow(
        unit="N",
        doc="Cut force directed into the component",
        hint="is the position of this flange fixed twice, by two components such as Fixed or Position?",
    )


class PartialTwoFlanges(Component):
    """Component with two flanges."""

    flange_a: Flange = Flange()
    flange_b: Flange = Flange()


class PartialRigid(PartialTwoFlanges):
    """Rigid body of length L between two flanges; `s` is its middle."""

    L: Real = parameter(default=0.0, unit="m", doc="Length, from flange_a to flange_b")
    s: Real = variable(unit="m", prefer_state=True, doc="Position of the middle")

    def equations(self) -> Equations:
        yield self.flange_a.s == self.s - self.L / 2.0
        yield self.flange_b.s == self.s + self.L / 2.0


class PartialCompliant(PartialTwoFlanges):
    """Massless line element whose force depends on its length."""

    s_rel: Real = variable(unit="m", doc="Distance of the flanges: flange_b.s - flange_a.s")
    f: Real = variable(unit="N", doc="Force between the flanges; positive pulls them together")

    def equations(self) -> Equations:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.flange_b.f == self.f
        yield self.flange_a.f == -self.f


class PartialCompliantWithRelativeStates(PartialTwoFlanges):
    """Massless line element whose force depends on its length and its rate."""

    s_rel: Real = variable(unit="m", prefer_state=True, doc="Distance of the flanges: flange_b.s - flange_a.s")
    v_rel: Real = variable(unit="m/s", prefer_state=True, doc="Rate of s_rel")
    f: Real = variable(unit="N", doc="Force between the flanges; positive pulls them together")

    def equations(self) -> Equations:
        yield self.s_rel == self.flange_b.s - self.flange_a.s
        yield self.v_rel == der(self.s_rel)
        yield self.flange_b.f == self.f
        yield self.flange_a.f == -self.f


class PartialForce(Component):
    """Force that acts on one flange and reacts on the ground."""

    flange: Flange = Flange()


class PartialAbsoluteSensor(Component):
    """Massless device that measures the motion of a flange."""

    flange: Flange = Flange()

    def equations(self) -> Equations:
        yield self.flange.f == 0.0


class PartialRelativeSensor(PartialTwoFlanges):
    """Massless device that measures between two flanges and transmits no force."""

    def equations(self) -> Equations:
        yield self.flange_a.f == 0.0
        yield self.flange_b.f == 0.0


class PartialCutSensor(PartialTwoFlanges):
    """Massless device inserted into a connection."""

    def equations(self) -> Equations:
        yield self.flange_a.s == self.flange_b.s
        yield self.flange_a.f + self.flange_b.f == 0.0
