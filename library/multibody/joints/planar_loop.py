"""The joint that closes a planar loop."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, cross, dot, structural, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.orientation import Vector, across, unit_vector
from acausal.library.multibody.rotations import relative_rotation


class RevolutePlanarLoopConstraint(PartialTwoFrames):
    """Revolute joint about `n` that closes a planar loop: it imposes two conditions on positions in the plane.

    In a planar loop of revolute and prismatic joints, three of the five conditions of the closing joint already follow
    from the other joints; imposed twice, their forces would be undetermined. Use this joint once per planar loop.
    frame_a and frame_b may lie in parallel planes: the force acts at frame_b, and frame_a takes its moment too.
    """

    n: Vector = structural(default=(0.0, 0.0, 1.0), doc="Axis of rotation, normal to the plane, in frame_a")
    f_c: Real = variable(unit="N", shape=2, doc="Constraint force along two axes of frame_a in the plane")

    def build(self) -> None:
        self._e = unit_vector(self.n)
        self._plane = across(self._e)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        plane, e = as_expr(self._plane), as_expr(self._e)
        r_rel_a = a.R.T @ (b.r_0 - a.r_0)
        yield plane @ r_rel_a == 0
        yield a.f == plane.T @ self.f_c
        yield a.t == cross(e, a.f) * dot(e, r_rel_a)
        yield relative_rotation(a, b) @ b.f + a.f == 0
        yield b.t == 0
