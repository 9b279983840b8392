"""The universal (cardan) joint."""

from __future__ import annotations

import math

from acausal import Equations, Real, connect, part, structural, variable
from acausal.errors import DeclarationError
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.joints.revolute import Revolute
from acausal.library.multibody.orientation import Vector, unit_vector


class Universal(PartialTwoFrames):
    """Universal joint: rotation about `n_a`, fixed in frame_a, then about `n_b`, fixed in frame_b; both perpendicular.

    Start values: `phi_a`, `phi_b`, `w_a`, `w_b`. Drives are connected to `revolute_a.axis` and `revolute_b.axis`.
    """

    n_a: Vector = structural(default=(1.0, 0.0, 0.0), doc="First axis, in frame_a")
    n_b: Vector = structural(default=(0.0, 1.0, 0.0), doc="Second axis, in frame_b")
    phi_a: Real = variable(unit="rad", doc="Angle about the first axis")
    phi_b: Real = variable(unit="rad", doc="Angle about the second axis")
    w_a: Real = variable(unit="rad/s", doc="Angular velocity about the first axis")
    w_b: Real = variable(unit="rad/s", doc="Angular velocity about the second axis")
    revolute_a: Revolute = part()
    revolute_b: Revolute = part()

    def build(self) -> None:
        cosine = sum(a * b for a, b in zip(unit_vector(self.n_a, "n_a"), unit_vector(self.n_b, "n_b"), strict=True))
        if abs(cosine) > 1e-8:
            raise DeclarationError(
                "AC130",
                f"Universal: n_a = {self.n_a} and n_b = {self.n_b} are not perpendicular",
                cause=f"the angle between them is {math.degrees(math.acos(max(-1.0, min(1.0, cosine)))):.6g} degrees",
                help="turn one of them; for axes at another angle connect two Revolute",
            )
        self.revolute_a = Revolute(n=self.n_a)
        self.revolute_b = Revolute(n=self.n_b)

    def equations(self) -> Equations:
        yield self.phi_a == self.revolute_a.phi
        yield self.phi_b == self.revolute_b.phi
        yield self.w_a == self.revolute_a.w
        yield self.w_b == self.revolute_b.w
        yield connect(self.frame_a, self.revolute_a.frame_a)
        yield connect(self.revolute_a.frame_b, self.revolute_b.frame_a)
        yield connect(self.revolute_b.frame_b, self.frame_b)
