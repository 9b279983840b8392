"""Forces and torques given by signals.

A signal is the load that the component applies to the body at frame_b. The cut force of a frame is positive into the
component, hence the minus signs.
"""

from __future__ import annotations

from enum import Enum

from acausal import Component, Equations, Expr, Real, cross, signal_input, structural
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.rotations import resolve_in_frame, resolve_in_world


class ResolveIn(Enum):
    """Frame in which the components of a vector are resolved."""

    WORLD = "world"
    FRAME_A = "frame_a"
    FRAME_B = "frame_b"


class WorldForce(Component):
    """External force at frame_b, in world axes."""

    frame_b: Frame = Frame()
    force: Real = signal_input(unit="N", shape=3, doc="Force on the body, in world axes")

    def equations(self) -> Equations:
        yield self.frame_b.f == -resolve_in_frame(self.frame_b, self.force)
        yield self.frame_b.t == 0


class WorldTorque(Component):
    """External torque at frame_b, in world axes."""

    frame_b: Frame = Frame()
    torque: Real = signal_input(unit="N.m", shape=3, doc="Torque on the body, in world axes")

    def equations(self) -> Equations:
        yield self.frame_b.f == 0
        yield self.frame_b.t == -resolve_in_frame(self.frame_b, self.torque)


class FrameForce(Component):
    """External force at frame_b, in frame_b: it turns with the body."""

    frame_b: Frame = Frame()
    force: Real = signal_input(unit="N", shape=3, doc="Force on the body, in frame_b")

    def equations(self) -> Equations:
        yield self.frame_b.f == -self.force
        yield self.frame_b.t == 0


class FrameTorque(Component):
    """External torque at frame_b, in frame_b: it turns with the body."""

    frame_b: Frame = Frame()
    torque: Real = signal_input(unit="N.m", shape=3, doc="Torque on the body, in frame_b")

    def equations(self) -> Equations:
        yield self.frame_b.f == 0
        yield self.frame_b.t == -self.torque


class PartialTwoFrameLoad(PartialTwoFrames):
    """A load between two frames."""

    resolve_in: ResolveIn = structural(default=ResolveIn.FRAME_B, doc="Axes of the signal's components")

    def in_world(self, signal: Expr) -> Expr:
        """World components of the signal."""
        if self.resolve_in is ResolveIn.WORLD:
            return signal
        return resolve_in_world(self.frame_a if self.resolve_in is ResolveIn.FRAME_A else self.frame_b, signal)


class Force(PartialTwoFrameLoad):
    """Force that acts on frame_b; the opposite force, at the same point of space, acts on frame_a.

    Since frame_a need not be where the force acts, the moment of the force acts on it too: all loads sum to zero.
    """

    force: Real = signal_input(unit="N", shape=3, doc="Force on the body at frame_b")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        force_0 = self.in_world(self.force)
        yield b.f == -resolve_in_frame(b, force_0)
        yield b.t == 0
        yield a.f == resolve_in_frame(a, force_0)
        yield a.t == resolve_in_frame(a, cross(b.r_0 - a.r_0, force_0))


class Torque(PartialTwoFrameLoad):
    """Torque that acts on frame_b; the opposite torque acts on frame_a."""

    torque: Real = signal_input(unit="N.m", shape=3, doc="Torque on the body at frame_b")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        torque_0 = self.in_world(self.torque)
        yield b.t == -resolve_in_frame(b, torque_0)
        yield b.f == 0
        yield a.t == resolve_in_frame(a, torque_0)
        yield a.f == 0
