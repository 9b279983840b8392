"""Drives of spindle and feed: an inertia under a speed controller whose torque or force is limited."""

from __future__ import annotations

import math

from acausal import Component, Equations, Real, clamp, der, maximum, parameter, signal_input, signal_output, variable
from acausal.library.rotational import Flange as RotationalFlange
from acausal.library.translational import Flange as TranslationalFlange


class Spindle(Component):
    """Spindle: its inertia and a motor that holds a speed within its limits of torque and power.

    It drives a rotational flange (`Revolute.axis`) and reacts on the ground. The PI controller has anti-windup: the
    integral follows the limited output. If the cutting torque exceeds the limit, the spindle slows down and stalls; the
    feed per revolution is that of the actual speed, since the drilling force measures it at its frames.

    Source: K. J. Åström, T. Hägglund, PID Controllers, 1995, section 3.5 (back-calculation); torque constant up to a
    corner speed and power constant above it, as specified by spindle manufacturers.
    """

    flange: RotationalFlange = RotationalFlange()

    J: Real = parameter(default=1e-3, unit="kg.m2", min=0.0, doc="Inertia of spindle and motor")
    tau_max: Real = parameter(unit="N.m", min=0.0, doc="Largest torque of the motor")
    P_max: Real = parameter(default=1e6, unit="W", min=0.0, doc="Largest power of the motor")
    bandwidth: Real = parameter(default=2 * math.pi * 50.0, unit="rad/s", min=0.0, doc="Bandwidth of the speed loop")
    T_i: Real = parameter(
        default=lambda self: 4 / self.bandwidth, unit="s", min=0.0, doc="Time constant of the integral part"
    )

    w_ref: Real = signal_input(unit="rad/s", doc="Set point of the angular velocity")
    phi: Real = variable(unit="rad", prefer_state=True, doc="Angle")
    w: Real = variable(unit="rad/s", prefer_state=True, doc="Angular velocity")
    integral: Real = variable(unit="rad/s", doc="Integral part of the controller, as a speed")
    wanted: Real = variable(unit="N.m", doc="Torque demanded by the controller, before the limits")
    tau: Real = signal_output(unit="N.m", nominal=10.0, doc="Torque of the motor")
    power: Real = signal_output(unit="W", nominal=100.0, doc="Power of the motor into the spindle")
    energy: Real = signal_output(unit="J", doc="Kinetic energy of the inertia J")

    def equations(self) -> Equations:
        gain = self.J * self.bandwidth
        yield self.phi == self.flange.phi
        yield self.w == der(self.phi)
        yield self.J * der(self.w) == self.tau + self.flange.tau
        yield self.wanted == gain * (self.w_ref - self.w + self.integral)
        limit = self.P_max / maximum(abs(self.w), self.P_max / self.tau_max)
        yield self.tau == clamp(self.wanted, -limit, limit)
        yield der(self.integral) == (self.w_ref - self.w + (self.tau - self.wanted) / gain) / self.T_i
        yield self.power == self.tau * self.w
        yield self.energy == self.J / 2 * self.w**2

    def initial_equations(self) -> Equations:
        yield self.integral == 0.0


class FeedDrive(Component):
    """Feed axis: its mass and a drive that holds a feed rate within its limit of force.

    It drives a translational flange (`Prismatic.axis`) and reacts on the ground. The controller is that of `Spindle`.
    `m` is the inertia of motor and screw as an equivalent mass: 1e-3 kg.m2 on a screw with 10 mm lead are 400 kg.
    """

    flange: TranslationalFlange = TranslationalFlange()

    m: Real = parameter(default=400.0, unit="kg", min=0.0, doc="Inertia of the feed drive, as a mass along the feed")
    f_max: Real = parameter(unit="N", min=0.0, doc="Largest force of the drive")
    bandwidth: Real = parameter(default=2 * math.pi * 50.0, unit="rad/s", min=0.0, doc="Bandwidth of the speed loop")
    T_i: Real = parameter(
        default=lambda self: 4 / self.bandwidth, unit="s", min=0.0, doc="Time constant of the integral part"
    )

    v_ref: Real = signal_input(unit="m/s", doc="Set point of the feed rate")
    s: Real = variable(unit="m", prefer_state=True, doc="Position")
    v: Real = variable(unit="m/s", prefer_state=True, doc="Feed rate")
    integral: Real = variable(unit="m/s", doc="Integral part of the controller, as a feed rate")
    wanted: Real = variable(unit="N", doc="Force demanded by the controller, before the limit")
    f: Real = signal_output(unit="N", nominal=1e3, doc="Force of the drive")
    power: Real = signal_output(unit="W", nominal=1.0, doc="Power of the drive into the feed axis")
    energy: Real = signal_output(unit="J", doc="Kinetic energy of the mass m")

    def equations(self) -> Equations:
        gain = self.m * self.bandwidth
        yield self.s == self.flange.s
        yield self.v == der(self.s)
        yield self.m * der(self.v) == self.f + self.flange.f
        yield self.wanted == gain * (self.v_ref - self.v + self.integral)
        yield self.f == clamp(self.wanted, -self.f_max, self.f_max)
        yield der(self.integral) == (self.v_ref - self.v + (self.f - self.wanted) / gain) / self.T_i
        yield self.power == self.f * self.v
        yield self.energy == self.m / 2 * self.v**2

    def initial_equations(self) -> Equations:
        yield self.integral == 0.0


class FeedCap(Component):
    """Feed governor: a brake that acts only above a feed rate, like the hydraulic check unit of a drill press.

    The force grows with slope `d` beyond `v_max`, in the direction of the feed only; withdrawal is free.
    """

    flange: TranslationalFlange = TranslationalFlange()

    v_max: Real = parameter(unit="m/s", min=0.0, doc="Feed rate above which it brakes")
    d: Real = parameter(default=1e7, unit="N.s/m", min=0.0, doc="Slope of the braking force")

    v: Real = variable(unit="m/s", doc="Feed rate")
    f: Real = signal_output(unit="N", nominal=1e3, doc="Braking force")
    power: Real = signal_output(unit="W", doc="Power lost in the brake")

    def equations(self) -> Equations:
        yield self.v == der(self.flange.s)
        yield self.f == self.d * maximum(self.v - self.v_max, 0.0)
        yield self.flange.f == self.f
        yield self.power == self.f * self.v
