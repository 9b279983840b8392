"""The joint with one rotation."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, der, dot, rooted, structural, variable
from acausal.library.multibody.interfaces import PartialJoint
from acausal.library.multibody.orientation import Vector, unit_vector
from acausal.library.multibody.rotations import planar_rotation
from acausal.library.rotational import Flange

_MASS = "the {} of the joint cannot be determined: does a body with inertia about the axis turn with frame_b?"


class Revolute(PartialJoint):
    """Revolute joint: frame_b turns relative to frame_a about the axis `n`.

    A drive is connected to the flange `axis`; the flange `support` is fixed. With nothing connected, the joint turns
    freely. Start values: `phi`, `w`.
    """

    axis: Flange = Flange()
    support: Flange = Flange()
    n: Vector = structural(default=(0.0, 0.0, 1.0), doc="Axis of rotation, in frame_a (and frame_b)")
    phi: Real = variable(
        unit="rad", prefer_state=True, doc="From frame_a to frame_b about n", hint=_MASS.format("angle")
    )
    w: Real = variable(unit="rad/s", prefer_state=True, doc="Angular velocity about n", hint=_MASS.format("velocity"))
    a: Real = variable(unit="rad/s2", doc="Angular acceleration about n", hint=_MASS.format("acceleration"))
    tau: Real = variable(unit="N.m", doc="Torque of the drive about n")

    def build(self) -> None:
        self._e = unit_vector(self.n)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        e = as_expr(self._e)
        R_rel = planar_rotation(self._e, self.phi)
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield b.r_0 == a.r_0
        if rooted(a):
            yield b.R == a.R @ R_rel
            yield b.w == R_rel.T @ a.w + e * self.w
            yield a.f == -(R_rel @ b.f)
            yield a.t == -(R_rel @ b.t)
        else:
            yield a.R == b.R @ R_rel.T
            yield a.w == R_rel @ b.w - e * self.w
            yield b.f == -(R_rel.T @ a.f)
            yield b.t == -(R_rel.T @ a.t)
        yield self.tau == -dot(e, b.t)
        yield self.axis.phi == self.phi
        yield self.axis.tau == self.tau
        yield self.support.phi == 0
