"""Partial components: the common parts of joints, force elements and sensors."""

from __future__ import annotations

from acausal import Component, Equations, branch
from acausal.library.multibody.frames import Frame


class PartialTwoFrames(Component):
    """A component with two frames."""

    frame_a: Frame = Frame()
    frame_b: Frame = Frame()


class PartialJoint(PartialTwoFrames):
    """A joint that determines the relative orientation of its frames, with or without joint coordinates."""

    def ties(self) -> Equations:
        yield branch(self.frame_a, self.frame_b)


class PartialAligned(PartialJoint):
    """A component whose two frames are parallel and which transmits the force."""

    def equations(self) -> Equations:
        yield self.frame_b.R == self.frame_a.R
        yield self.frame_b.w == self.frame_a.w
        yield self.frame_a.f + self.frame_b.f == 0


class PartialAbsoluteSensor(Component):
    """A massless sensor at one frame: it takes neither force nor torque."""

    frame_a: Frame = Frame()

    def equations(self) -> Equations:
        yield self.frame_a.f == 0
        yield self.frame_a.t == 0


class PartialRelativeSensor(PartialTwoFrames):
    """A massless sensor between two frames."""

    def equations(self) -> Equations:
        yield self.frame_a.f == 0
        yield self.frame_a.t == 0
        yield self.frame_b.f == 0
        yield self.frame_b.t == 0
