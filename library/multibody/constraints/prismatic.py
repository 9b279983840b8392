"""Constraint of parallel frames whose offset may change only along selected axes."""

from __future__ import annotations

from acausal import Equations, Real, cross, structural, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.rotations import relative_rotation


class PrismaticConstraint(PartialTwoFrames):
    """The frames stay parallel; frame_b stays on frame_a along the locked axes of frame_a.

    (Modelica.Mechanics.MultiBody.Joints.Constraints.Prismatic.)
    """

    locked: tuple[bool, bool, bool] = structural(
        default=(False, True, True), doc="Whether x, y, z of frame_a are locked"
    )
    f_c: Real = variable(unit="N", shape=3, doc="Constraint force on the part at frame_b, in frame_a")
    t_c: Real = variable(unit="N.m", shape=3, doc="Constraint torque at frame_b, in frame_a")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        R_rel = relative_rotation(a, b)
        r_rel_a = a.R.T @ (b.r_0 - a.r_0)
        for k in range(3):
            yield (r_rel_a[k] if self.locked[k] else self.f_c[k]) == 0
        yield from a.residuals(b)
        yield a.f == self.f_c
        yield a.t == self.t_c + cross(r_rel_a, self.f_c)
        yield b.f == -(R_rel.T @ self.f_c)
        yield b.t == -(R_rel.T @ self.t_c)
