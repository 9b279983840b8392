"""Forces along the line between two frames."""

from __future__ import annotations

from acausal import Equations, Real, der, dot, parameter, quantity, sqrt, variable
from acausal.library.multibody.interfaces import PartialTwoFrames
from acausal.library.multibody.rotations import resolve_in_frame
from acausal.library.multibody.world import PartialHeavy

_TINY = 1e-10
"""Length [m] whose square is added to that of the line: negligible, but it gives coinciding frames a direction of
length zero instead of a division by zero."""


class PartialLine(PartialTwoFrames):
    """A line between two frames."""

    s: Real = variable(unit="m", doc="Length of the line")
    e_rel_0: Real = variable(unit="1", shape=3, doc="Direction from frame_a to frame_b, in world axes")

    def equations(self) -> Equations:
        r_rel_0 = self.frame_b.r_0 - self.frame_a.r_0
        yield self.s == sqrt(dot(r_rel_0, r_rel_0) + quantity(_TINY, "m") ** 2)
        yield self.e_rel_0 == r_rel_0 / self.s
        yield self.frame_a.t == 0
        yield self.frame_b.t == 0


class PartialLineForce(PartialLine):
    """A massless line with a force `f` along it, positive when it pulls the frames together.

    Frames that coincide have no direction: whatever `f` is, the line moves neither of them.
    """

    f: Real = variable(unit="N", doc="Force of the line, positive in tension")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        yield a.f == -resolve_in_frame(a, self.e_rel_0 * self.f)
        yield b.f == resolve_in_frame(b, self.e_rel_0 * self.f)


class PartialDampedLineForce(PartialLineForce):
    """A line force that depends on the rate of its length."""

    v: Real = variable(unit="m/s", doc="Rate of the length")

    def equations(self) -> Equations:
        yield self.v == dot(self.e_rel_0, der(self.frame_b.r_0) - der(self.frame_a.r_0))


class Spring(PartialLineForce):
    """Linear spring; where its ends coincide it has no direction and moves neither of them."""

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness")
    s_unstretched: Real = parameter(default=0.0, unit="m", doc="Length without force")

    def equations(self) -> Equations:
        yield self.f == self.c * (self.s - self.s_unstretched)


class Damper(PartialDampedLineForce):
    """Linear damper."""

    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping")

    def equations(self) -> Equations:
        yield self.f == self.d * self.v


class SpringDamperParallel(PartialDampedLineForce):
    """Linear spring and linear damper side by side."""

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness")
    s_unstretched: Real = parameter(default=0.0, unit="m", doc="Length without force")
    d: Real = parameter(unit="N.s/m", min=0.0, doc="Damping")

    def equations(self) -> Equations:
        yield self.f == self.c * (self.s - self.s_unstretched) + self.d * self.v


class SpringWithMass(PartialLine, PartialHeavy):
    """Linear spring that carries a point mass on its line.

    A separate class rather than `Spring(m=...)`: with a mass, the force depends on the accelerations of both frames.
    """

    c: Real = parameter(unit="N/m", min=0.0, doc="Stiffness")
    s_unstretched: Real = parameter(default=0.0, unit="m", doc="Length without force")
    m: Real = parameter(unit="kg", min=0.0, doc="Mass")
    length_fraction: Real = parameter(default=0.5, unit="1", min=0.0, max=1.0, doc="Position of the mass: 0 at frame_a")
    f: Real = variable(unit="N", doc="Force of the spring, positive in tension")
    v_CM_0: Real = variable(unit="m/s", shape=3, doc="Velocity of the mass, in world axes")

    def equations(self) -> Equations:
        a, b = self.frame_a, self.frame_b
        towards_b = self.length_fraction
        # The mass stays at a fixed fraction of the line, so that its velocity is a weighted mean of the frames'.
        yield self.v_CM_0 == (1 - towards_b) * der(a.r_0) + towards_b * der(b.r_0)
        r_CM_0 = (1 - towards_b) * a.r_0 + towards_b * b.r_0
        f_CM_0 = self.m * (der(self.v_CM_0) - self.gravity_at(r_CM_0))
        yield self.f == self.c * (self.s - self.s_unstretched)
        yield a.f == resolve_in_frame(a, (1 - towards_b) * f_CM_0 - self.e_rel_0 * self.f)
        yield b.f == resolve_in_frame(b, towards_b * f_CM_0 + self.e_rel_0 * self.f)
