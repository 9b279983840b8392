"""Torques and prescribed rotations. Names and signs as in Modelica.Mechanics.Rotational.Sources.

A source with one flange reacts on the ground.
"""

from __future__ import annotations

from acausal import Component, Equations, Real, der, parameter, quantity, signal_input, structural, variable, where
from acausal.library.rotational.interfaces import Flange, PartialTorque, PartialTwoFlanges
from acausal.library.thermal.interfaces import HeatPort


class Torque(PartialTorque):
    """Torque on the flange, given by an input signal; a positive one accelerates towards positive `phi`."""

    u: Real = signal_input(unit="N.m", doc="Driving torque")

    def equations(self) -> Equations:
        yield self.flange.tau == -self.u


class Torque2(PartialTwoFlanges):
    """Torque on `flange_b`, given by an input signal; the opposite torque acts on `flange_a`."""

    u: Real = signal_input(unit="N.m", doc="Driving torque")

    def equations(self) -> Equations:
        yield self.flange_a.tau == self.u
        yield self.flange_b.tau == -self.u


class ConstantTorque(PartialTorque):
    """Constant torque on the flange."""

    tau_constant: Real = parameter(unit="N.m", doc="Torque; negative acts as a load")

    def equations(self) -> Equations:
        yield self.flange.tau == -self.tau_constant


class PartialSpeedDependentTorque(PartialTorque):
    """Torque that depends on the angular velocity of its flange."""

    tau_nominal: Real = parameter(unit="N.m", doc="Torque at w_nominal; negative acts as a load")
    w_nominal: Real = parameter(unit="rad/s", min=1e-60, doc="Speed at which the torque is tau_nominal")
    w: Real = variable(unit="rad/s", doc="Angular velocity of the flange")

    def equations(self) -> Equations:
        yield self.w == der(self.flange.phi)


class LinearSpeedDependentTorque(PartialSpeedDependentTorque):
    """Torque proportional to the angular velocity: tau_nominal*w/w_nominal."""

    def equations(self) -> Equations:
        yield self.flange.tau == -self.tau_nominal * (self.w / self.w_nominal)


class QuadraticSpeedDependentTorque(PartialSpeedDependentTorque):
    """Torque proportional to the square of the angular velocity."""

    tau_direction: bool = structural(default=True, doc="True: same direction of torque for both signs of velocity")

    def equations(self) -> Equations:
        x = self.w / self.w_nominal
        shape = x * x if self.tau_direction else where(x < 0.0, -(x * x), x * x, smooth=True)
        yield self.flange.tau == -self.tau_nominal * shape


class EddyCurrentTorque(PartialTorque):
    """Eddy current brake, excited by an input signal; its losses flow out of the heat port.

    `tau = 2*tau_nominal*exc^2*x/(1 + x^2)` with `x = w/w_nominal` at the reference temperature, where the torque is
    largest at w_nominal; a warmer disc has a higher resistance and turns faster for the same torque.
    """

    _to_be_connected = ("heatPort",)

    heatPort: HeatPort = HeatPort()
    exc: Real = signal_input(unit="1", doc="Excitation, 0 ... 1")
    tau_nominal: Real = parameter(unit="N.m", doc="Largest torque, fully excited")
    w_nominal: Real = parameter(unit="rad/s", min=1e-60, doc="Speed of the largest torque")
    TRef: Real = parameter(default=293.15, unit="K", doc="Reference temperature")
    alpha20: Real = parameter(
        default=0.0, unit="1/K", doc="Relative rise of the resistance with temperature at 20 degC"
    )
    w: Real = variable(unit="rad/s", doc="Angular velocity of the flange")
    tau: Real = variable(unit="N.m", doc="Braking torque")
    loss_power: Real = variable(unit="W", doc="Power turned into heat")

    def equations(self) -> Equations:
        # The coefficient at 20 degC, converted to that at TRef.
        alpha = self.alpha20 / (1.0 + self.alpha20 * (self.TRef - quantity(20.0, "degC")))
        warmer = 1.0 + alpha * (self.heatPort.T - self.TRef)
        x = self.w / (self.w_nominal * warmer)
        yield self.w == der(self.flange.phi)
        yield self.tau == 2.0 * self.tau_nominal * self.exc**2 * x / (1.0 + x * x)
        yield self.flange.tau == self.tau
        yield self.loss_power == self.tau * self.w
        yield self.heatPort.Q_flow == -self.loss_power


class Position(Component):
    """Flange whose angle is an input signal, exactly; the signal is differentiated where inertias are attached."""

    flange: Flange = Flange()
    phi_ref: Real = signal_input(unit="rad", doc="Angle")

    def equations(self) -> Equations:
        yield self.flange.phi == self.phi_ref


class Speed(Component):
    """Flange whose angular velocity is an input signal, exactly; the start angle is the start value of `phi`."""

    flange: Flange = Flange()
    w_ref: Real = signal_input(unit="rad/s", doc="Angular velocity")
    phi: Real = variable(unit="rad", prefer_state=True, doc="Angle of the flange")
    w: Real = variable(unit="rad/s", doc="Angular velocity of the flange")

    def equations(self) -> Equations:
        yield self.phi == self.flange.phi
        yield self.w == der(self.phi)
        yield self.w == self.w_ref


class Accelerate(Component):
    """Flange whose angular acceleration is an input signal, exactly; it starts from the given `phi` and `w`."""

    flange: Flange = Flange()
    a_ref: Real = signal_input(unit="rad/s2", doc="Angular acceleration")
    phi: Real = variable(unit="rad", prefer_state=True, doc="Angle of the flange")
    w: Real = variable(unit="rad/s", prefer_state=True, doc="Angular velocity of the flange")
    a: Real = variable(unit="rad/s2", doc="Angular acceleration of the flange")

    def equations(self) -> Equations:
        yield self.phi == self.flange.phi
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield self.a == self.a_ref
