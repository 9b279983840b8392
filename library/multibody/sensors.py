"""Ideal sensors: motion of a frame, relative motion of two frames, force and torque through a cut."""

from __future__ import annotations

from acausal import Equations, Real, der, signal_output
from acausal.library.multibody.interfaces import PartialAbsoluteSensor, PartialJoint, PartialRelativeSensor
from acausal.library.multibody.rotations import cardan_angles, relative_rotation, resolve_in_frame


class AbsoluteSensor(PartialAbsoluteSensor):
    """Position, velocity, orientation and angular velocity of frame_a relative to the world."""

    r: Real = signal_output(unit="m", shape=3, doc="Position, in world axes")
    v: Real = signal_output(unit="m/s", shape=3, doc="Velocity, in world axes")
    angles: Real = signal_output(unit="rad", shape=3, doc="Angles about x, the new y, the new z")
    w: Real = signal_output(unit="rad/s", shape=3, doc="Angular velocity, in frame_a")

    def equations(self) -> Equations:
        yield self.r == self.frame_a.r_0
        yield self.v == der(self.frame_a.r_0)
        yield self.angles == cardan_angles(self.frame_a.R)
        yield self.w == self.frame_a.w


class RelativeSensor(PartialRelativeSensor):
    """Position, velocity, orientation and angular velocity of frame_b relative to frame_a, resolved in frame_a."""

    r_rel: Real = signal_output(unit="m", shape=3, doc="From frame_a to frame_b, in frame_a")
    v_rel: Real = signal_output(unit="m/s", shape=3, doc="Rate of r_rel as frame_a sees it, in frame_a")
    angles: Real = signal_output(unit="rad", shape=3, doc="Angles about x, the new y, the new z")
    w_rel: Real = signal_output(unit="rad/s", shape=3, doc="Angular velocity relative to frame_a, in frame_a")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        R_rel = relative_rotation(a, b)
        yield self.r_rel == resolve_in_frame(a, b.r_0 - a.r_0)
        yield self.v_rel == der(self.r_rel)
        yield self.angles == cardan_angles(R_rel)
        yield self.w_rel == R_rel @ b.w - a.w


class PartialCutSensor(PartialJoint):
    """A cut in a connection: both frames coincide, force and torque pass unchanged."""

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        yield b.r_0 == a.r_0
        yield b.R == a.R
        yield b.w == a.w
        yield a.f + b.f == 0
        yield a.t + b.t == 0


class CutForce(PartialCutSensor):
    """Force through the cut, in frame_a: exerted by the part at frame_a on the part at frame_b."""

    force: Real = signal_output(unit="N", shape=3, doc="Force on the part at frame_b, in frame_a")

    def equations(self) -> Equations:
        yield self.force == self.frame_a.f


class CutTorque(PartialCutSensor):
    """Torque through the cut, in frame_a: exerted by the part at frame_a on the part at frame_b."""

    torque: Real = signal_output(unit="N.m", shape=3, doc="Torque on the part at frame_b, in frame_a")

    def equations(self) -> Equations:
        yield self.torque == self.frame_a.t
