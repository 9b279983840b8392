"""Massless rigid parts: a fixed frame, and constant displacements between frames."""

from __future__ import annotations

from acausal import Component, Equations, Real, as_expr, cross, identity, parameter, root, rooted, structural
from acausal.library.multibody.frames import Frame
from acausal.library.multibody.interfaces import PartialAligned, PartialJoint
from acausal.library.multibody.orientation import IDENTITY, Rotation, checked_rotation


class Fixed(Component):
    """Frame fixed to a point of the world, parallel to the world."""

    frame_b: Frame = Frame()
    r: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="Position in world axes")

    def ties(self) -> Equations:
        yield root(self.frame_b)

    def equations(self) -> Equations:
        yield self.frame_b.r_0 == self.r
        yield self.frame_b.R == identity(3)
        yield self.frame_b.w == 0


class FixedTranslation(PartialAligned):
    """Constant displacement `r` from frame_a to frame_b, given in frame_a."""

    r: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="From frame_a to frame_b, in frame_a")

    def equations(self) -> Equations:
        yield self.frame_b.r_0 == self.frame_a.r_0 + self.frame_a.R @ self.r
        yield self.frame_a.t + self.frame_b.t + cross(self.r, self.frame_b.f) == 0


class FixedRotation(PartialJoint):
    """Constant displacement `r`, then a constant rotation.

    Parameters
    ----------
    r
        From frame_a to frame_b, in frame_a [m].
    R_rel
        Components in frame_b to components in frame_a; made by `axis_rotation(n, angle)`, `axes_rotation(n_x, n_y)`
        or `rotation_sequence(angles)`. Structural: its zeros and ones simplify the equations.
    """

    r: Real = parameter(default=(0.0, 0.0, 0.0), unit="m", shape=3, doc="From frame_a to frame_b, in frame_a")
    R_rel: Rotation = structural(default=IDENTITY, doc="Components in frame_b to components in frame_a")

    def build(self) -> None:
        checked_rotation(self.R_rel)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        R_rel = as_expr(self.R_rel)
        yield b.r_0 == a.r_0 + a.R @ self.r
        if rooted(a):
            yield b.R == a.R @ R_rel
            yield b.w == R_rel.T @ a.w
        else:
            yield a.R == b.R @ R_rel.T
            yield a.w == R_rel @ b.w
        yield a.f + R_rel @ b.f == 0
        yield a.t + R_rel @ b.t + cross(self.r, R_rel @ b.f) == 0
