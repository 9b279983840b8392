"""The joint that closes a planar loop."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, structural, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.orientation import Vector, across, unit_vector
from acausal.library.multibody.rotations import relative_rotation


class RevolutePlanarLoopConstraint(PartialTwoFrames):
    """Revolute joint about `n` that closes a planar loop: it imposes two conditions on positions in the plane.

    In a planar loop of revolute and prismatic joints, three of the five conditions of the closing joint already follow
    from the other joints; imposed twice, their forces would be undetermined. Use this joint once per planar loop.
    """

    n: Vector = structural(default=(0.0, 0.0, 1.0), doc="Axis of rotation, normal to the plane, in frame_a")
    f_c: Real = variable(unit="N", shape=2, doc="Constraint force along two axes of frame_a in the plane")

    def build(self) -> None:
        self._plane = across(unit_vector(self.n))

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        plane = as_expr(self._plane)
        yield plane @ (a.R.T @ (b.r_0 - a.r_0)) == 0
        yield a.f == plane.T @ self.f_c
        yield a.t == 0
        yield relative_rotation(a, b) @ b.f + a.f == 0
        yield b.t == 0
