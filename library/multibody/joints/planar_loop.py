"""The joint that closes a planar loop."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, assert_, cross, dot, no_event, structural, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.orientation import Vector, across, unit_vector
from acausal.library.multibody.rotations import relative_rotation

_TILT = 1e-3
"""Largest angle [rad] between the axes in both frames: the motion is wrong by its square."""
_NOT_PLANAR = (
    "the axis n has different directions in frame_a and frame_b: the loop is not planar, and this joint does not hold "
    "them parallel; close the loop with a Revolute"
)


class RevolutePlanarLoopConstraint(PartialTwoFrames):
    """Revolute joint about `n` that closes a planar loop: it imposes two conditions on positions in the plane.

    In a planar loop of revolute and prismatic joints, three of the five conditions of the closing joint already follow
    from the other joints; imposed twice, their forces would be undetermined. Use this joint once per planar loop.
    frame_a and frame_b may lie in parallel planes: the force acts at frame_b, and frame_a takes its moment too. A run
    ends (AC503) where the axes of both frames are not parallel, because this joint does not hold them so.
    """

    n: Vector = structural(default=(0.0, 0.0, 1.0), doc="Axis of rotation, normal to the plane, in frame_a")
    f_c: Real = variable(unit="N", shape=2, doc="Constraint force along two axes of frame_a in the plane")

    def build(self) -> None:
        self._e = unit_vector(self.n)
        self._plane = across(self._e)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        plane, e = as_expr(self._plane), as_expr(self._e)
        r_rel_a, R_rel = a.R.T @ (b.r_0 - a.r_0), relative_rotation(a, b)
        tilt = plane @ (R_rel @ e)
        yield assert_(no_event(dot(tilt, tilt) <= _TILT**2), _NOT_PLANAR)
        yield plane @ r_rel_a == 0
        yield a.f == plane.T @ self.f_c
        yield a.t == cross(e, a.f) * dot(e, r_rel_a)
        yield R_rel @ b.f + a.f == 0
        yield b.t == 0
