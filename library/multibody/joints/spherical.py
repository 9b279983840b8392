"""The ball joint."""

from __future__ import annotations

from acausal import Equations
from acausal.library.multibody.interfaces import PartialTwoFrames


class Spherical(PartialTwoFrames):
    """Spherical joint: the origins of both frames coincide, the rotation is free, and the joint has no states.

    The orientations of the two frames are independent, so that the body attached to the joint becomes a root with a
    quaternion, and a loop closed by this joint needs no cut. (Modelica's Spherical with enforceStates=false.)
    """

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        yield b.r_0 == a.r_0
        yield a.t == 0
        yield b.t == 0
        yield a.f + a.R.T @ (b.R @ b.f) == 0
