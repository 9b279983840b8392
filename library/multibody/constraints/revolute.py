"""The revolute joint as five conditions between two bodies with independent coordinates."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, structural, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.orientation import Vector, across, unit_vector
from acausal.library.multibody.rotations import relative_rotation


class RevoluteConstraint(PartialTwoFrames):
    """The origins coincide, and the axis `n` has the same direction in both frames.

    It does not relate the orientations in the tree of frames, so it closes a loop without a cut, or guides a free body.
    (Modelica.Mechanics.MultiBody.Joints.Constraints.Revolute.)
    """

    n: Vector = structural(default=(0.0, 0.0, 1.0), doc="Axis of rotation, in frame_a and frame_b")
    f_c: Real = variable(unit="N", shape=3, doc="Constraint force on the part at frame_b, in frame_a")
    t_c: Real = variable(unit="N.m", shape=2, doc="Constraint torque along two axes across n, in frame_a")

    def build(self) -> None:
        self._e = unit_vector(self.n)
        self._across = across(self._e)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        R_rel = relative_rotation(a, b)
        plane = as_expr(self._across)
        yield b.r_0 - a.r_0 == 0
        yield plane @ (R_rel @ as_expr(self._e)) == 0
        yield a.f == self.f_c
        yield a.t == plane.T @ self.t_c
        yield b.f == -(R_rel.T @ a.f)
        yield b.t == -(R_rel.T @ a.t)
