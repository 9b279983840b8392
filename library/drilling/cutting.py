"""Cutting force and feed force by Kienzle's law as functions of the feed per edge, acting on drill and plate."""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    cross,
    maximum,
    parameter,
    signal_input,
    signal_output,
    sin,
    structural,
    tanh,
)
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.orientation import Vector, unit_vector


class PartialCuttingForce(Component):
    """Kienzle's law on the engaged part of the edges; a subclass defines the feed per edge `f_z`.

    The feed force acts at the tip along the drill axis, forward on the plate and backward on the drill; the cutting
    torque drags the plate along and brakes the drill. There is no force across the axis.

    Source: founding paper, equations (1) to (10). Beyond the paper: the torque, which is that of the cutting force at
    the mean radius of the engaged edges, and `h_min`: the paper limits k_c at feeds below "1 mm", which would keep it
    constant in all normal drilling; about 1 um must be meant.
    """

    frame_a: Frame = Frame()
    frame_w: Frame = Frame()

    axis_a: Vector = structural(default=(0.0, 0.0, 1.0), doc="Direction from shank to tip, resolved in frame_a")
    sigma: Real = parameter(unit="rad", min=0.0, max=math.pi, doc="Point angle of the drill")
    z_E: Real = parameter(default=2.0, unit="1", min=1.0, doc="Number of cutting edges")
    k_c11: Real = parameter(unit="Pa", min=0.0, doc="Specific cutting force at h = b = 1 mm")
    z: Real = parameter(unit="1", min=0.0, max=1.0, doc="Exponent of the chip thickness")
    h_min: Real = parameter(
        default=1e-6, unit="m", min=1e-15, max=1e-3, doc="Chip thickness below which k_c stays constant"
    )
    h_1: Real = parameter(default=1e-3, unit="m", min=0.0, doc="Chip thickness that k_c11 refers to")
    feed_force_factor: Real = parameter(default=lambda self: sin(self.sigma), unit="1", min=0.0, doc="F_f / F_c")
    omega_1: Real = parameter(
        default=0.1,
        unit="rad/s",
        min=1e-12,
        doc="Angular velocity at which the acting torque is tanh(1) of its full value",
    )

    tip: Real = signal_input(unit="m", shape=3, doc="Tip, seen from frame_w and resolved there")
    axis: Real = signal_input(unit="1", shape=3, doc="Drill axis towards the tip, resolved in frame_w")
    d_O: Real = signal_input(unit="m", doc="Outer diameter of the engaged part of the edges")
    d_I: Real = signal_input(unit="m", doc="Inner diameter of the engaged part of the edges")
    omega: Real = signal_input(
        unit="rad/s", doc="Angular velocity of the drill relative to the plate, about the drill axis"
    )
    n: Real = signal_input(unit="1/s", doc="Rotational speed, not negative")

    f_z: Real = signal_output(
        unit="m", nominal=1e-4, monotone_above=0.0, doc="Feed per edge and revolution, not negative"
    )
    h: Real = signal_output(unit="m", nominal=1e-4, doc="Chip thickness")
    k_c: Real = signal_output(unit="Pa", nominal=1e9, doc="Specific cutting force")
    F_cz: Real = signal_output(unit="N", nominal=1e3, doc="Cutting force of one edge")
    F_c: Real = signal_output(unit="N", nominal=1e3, doc="Cutting force of all edges")
    F_f: Real = signal_output(unit="N", nominal=1e3, doc="Feed force: along the axis, against the feed")
    torque: Real = signal_output(unit="N.m", nominal=10.0, doc="Cutting torque, without sign")

    def build(self) -> None:
        self._e = unit_vector(self.axis_a, "axis_a")

    def equations(self) -> Equations:
        yield self.h == self.f_z * sin(self.sigma / 2)  # (2)
        yield self.k_c == self.k_c11 * (maximum(self.h, self.h_min) / self.h_1) ** (-self.z)  # (5)
        yield self.F_cz == (self.d_O - self.d_I) / 2 * self.f_z * self.k_c  # (6), (7)
        yield self.F_c == self.z_E * self.F_cz  # (10)
        yield self.F_f == self.feed_force_factor * self.F_c  # (8)
        yield self.torque == self.F_c * (self.d_O + self.d_I) / 4

        braking = self.braking()
        a, w = self.frame_a, self.frame_w
        thrust = self.thrust_on_axis()
        yield a.f == thrust * self._e
        yield a.t == braking * self._e
        yield w.f == -thrust * self.axis
        yield w.t == -braking * self.axis - cross(self.tip, thrust * self.axis)

    def braking(self) -> Expr:
        """Signed torque on the drill [N.m].

        It is continuous at standstill: a jump would make a drill chatter that its drive can no longer turn.
        """
        return self.torque * tanh(self.omega / self.omega_1)

    def thrust_on_axis(self) -> Expr:
        """Force along the axis that pushes the drill back [N]: with a chisel edge, more than the feed force."""
        return self.F_f
