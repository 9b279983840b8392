"""The joint with one translation."""

from __future__ import annotations

from acausal import Equations, Real, as_expr, cross, der, dot, structural, variable
from acausal.library.multibody.interfaces import PartialAligned
from acausal.library.multibody.orientation import Vector, unit_vector
from acausal.library.translational import Flange

_MASS = "the {} of the joint cannot be determined: does a body with mass move with frame_b?"


class Prismatic(PartialAligned):
    """Prismatic joint: frame_b moves relative to frame_a along the axis `n`, without rotation.

    A drive is connected to the flange `axis`; the flange `support` is fixed. With nothing connected, the joint moves
    freely. Start values: `s`, `v`.
    """

    axis: Flange = Flange()
    support: Flange = Flange()
    n: Vector = structural(default=(1.0, 0.0, 0.0), doc="Axis of translation, in frame_a (and frame_b)")
    s: Real = variable(
        unit="m", prefer_state=True, doc="From frame_a to frame_b along n", hint=_MASS.format("position")
    )
    v: Real = variable(unit="m/s", prefer_state=True, doc="Velocity along n", hint=_MASS.format("velocity"))
    a: Real = variable(unit="m/s2", doc="Acceleration along n", hint=_MASS.format("acceleration"))
    f: Real = variable(unit="N", doc="Force of the drive along n")

    def build(self) -> None:
        self._e = unit_vector(self.n)

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        e = as_expr(self._e)
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield b.r_0 == a.r_0 + a.R @ (e * self.s)
        yield a.t + b.t + cross(e * self.s, b.f) == 0
        yield self.f == -dot(e, b.f)
        yield self.axis.s == self.s
        yield self.axis.f == self.f
        yield self.support.s == 0
