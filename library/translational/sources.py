"""Forces and prescribed motions. Names and signs as in Modelica.Mechanics.Translational.Sources.

A source with one flange reacts on the ground.
"""

from __future__ import annotations

from acausal import Component, Equations, Real, der, parameter, signal_input, structural, variable, where
from acausal.library.translational.interfaces import Flange, PartialForce, PartialTwoFlanges


class Force(PartialForce):
    """Force on the flange, given by an input signal; a positive one accelerates towards positive `s`."""

    u: Real = signal_input(unit="N", doc="Driving force")

    def equations(self) -> Equations:
        yield self.flange.f == -self.u


class Force2(PartialTwoFlanges):
    """Force on `flange_b`, given by an input signal; the opposite force acts on `flange_a`. Positive pushes apart."""

    u: Real = signal_input(unit="N", doc="Driving force")

    def equations(self) -> Equations:
        yield self.flange_b.f == -self.u
        yield self.flange_a.f == self.u


class ConstantForce(PartialForce):
    """Constant force on the flange."""

    f_constant: Real = parameter(unit="N", doc="Force; negative acts as a load")

    def equations(self) -> Equations:
        yield self.flange.f == -self.f_constant


class PartialSpeedDependentForce(PartialForce):
    """Force that depends on the velocity of its flange."""

    f_nominal: Real = parameter(unit="N", doc="Force at v_nominal; negative acts as a load")
    v_nominal: Real = parameter(unit="m/s", min=1e-60, doc="Velocity at which the force is f_nominal")
    v: Real = variable(unit="m/s", doc="Velocity of the flange")

    def equations(self) -> Equations:
        yield self.v == der(self.flange.s)


class LinearSpeedDependentForce(PartialSpeedDependentForce):
    """Force proportional to the velocity: f_nominal*v/v_nominal."""

    def equations(self) -> Equations:
        yield self.flange.f == -self.f_nominal * (self.v / self.v_nominal)


class QuadraticSpeedDependentForce(PartialSpeedDependentForce):
    """Force proportional to the square of the velocity."""

    force_direction: bool = structural(default=True, doc="True: same direction of force for both signs of velocity")

    def equations(self) -> Equations:
        x = self.v / self.v_nominal
        shape = x * x if self.force_direction else where(x < 0.0, -(x * x), x * x, smooth=True)
        yield self.flange.f == -self.f_nominal * shape


class Position(Component):
    """Flange whose position is an input signal, exactly; the signal is differentiated where masses are attached."""

    flange: Flange = Flange()
    s_ref: Real = signal_input(unit="m", doc="Position")

    def equations(self) -> Equations:
        yield self.flange.s == self.s_ref


class Speed(Component):
    """Flange whose velocity is an input signal, exactly; the start position is the start value of `s`."""

    flange: Flange = Flange()
    v_ref: Real = signal_input(unit="m/s", doc="Velocity")
    s: Real = variable(unit="m", prefer_state=True, doc="Position of the flange")
    v: Real = variable(unit="m/s", doc="Velocity of the flange")

    def equations(self) -> Equations:
        yield self.s == self.flange.s
        yield self.v == der(self.s)
        yield self.v == self.v_ref


class Accelerate(Component):
    """Flange whose acceleration is an input signal, exactly; it starts from the start values of `s` and `v`."""

    flange: Flange = Flange()
    a_ref: Real = signal_input(unit="m/s2", doc="Acceleration")
    s: Real = variable(unit="m", prefer_state=True, doc="Position of the flange")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Velocity of the flange")
    a: Real = variable(unit="m/s2", doc="Acceleration of the flange")

    def equations(self) -> Equations:
        yield self.s == self.flange.s
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.a == self.a_ref
