"""Compliant contact between the drill and the ground of the hole: the dynamic drilling force."""

from __future__ import annotations

from acausal import (
    Equations,
    Expr,
    Real,
    guess,
    maximum,
    parameter,
    signal_input,
    signal_output,
    sin,
    structural,
    variable,
    where,
)
from acausal.library.drilling.cutting import PartialCuttingForce

_NO_WIDTH = 1e-12  # [m] keeps (16) defined where no edge is engaged


class DrillContactForce(PartialCuttingForce):
    """Spring and damper in series with the cut: the feed is what the contact force can press through.

    The ground of the hole recedes with the target feed rate `v_tar = z_E n f_z`. Two forms of the contact force:

    - Equation (20), the default: k (s - s_tar) + d_c (v - v_tar). Solved implicitly for the feed, with neither a
      division by the engaged width nor a fractional power of a quotient, so that it holds through the first touch,
      at standstill and without contact. A drill that does not press has a negative `feed` and no force.
    - Equations (21) and (16), `as_printed=True`: k (s - s_tar) + d_c v, which gives the feed explicitly. It breaks
      when a rotating drill first touches: the feed rate grows without bound as the engaged width vanishes.

    Source: founding paper, equations (11) and (16) to (21).
    """

    as_printed: bool = structural(default=False, doc="Equation (21) instead of (20)")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    c: Real = parameter(default=1e-2, unit="N/m", min=0.0, doc="Regularisation: slope of force over feed at standstill")

    s: Real = signal_input(unit="m", doc="Depth of the tip, from DrillGeometry")
    v: Real = signal_input(unit="m/s", doc="Rate of the depth, from DrillGeometry")
    s_tar: Real = signal_input(unit="m", doc="Target depth, from DrillDepthCalculation")

    F_N: Real = signal_output(unit="N", nominal=1e3, doc="Contact force, not negative")
    feed: Real = variable(
        unit="m",
        default=guess(0.0),
        nominal=1e-4,
        doc="Feed per edge with sign; negative when the drill does not press",
        hint="is the stiffness k of the contact greater than 0?",
    )

    def equations(self) -> Equations:
        spring = self.k * (self.s - self.s_tar)
        yield self.f_z == maximum(self.feed, 0.0)
        if self.as_printed:
            yield self.F_N == maximum(spring + self.d_c * self.v, 0.0)  # (21)
            yield self.feed == self._feed_of_force()
        else:
            yield self.F_N == self.F_f  # (11)
            v_tar = self.z_E * self.n * self.feed
            # a drill in the air has feed = s - s_tar: a number as small as the gap, whatever the stiffness
            regular = where(self.feed > 0, self.c, self.k) * self.feed
            yield spring + self.d_c * (self.v - v_tar) == self.F_N + regular  # (20)

    def _feed_of_force(self) -> Expr:
        """Equation (16), and its straight continuation below h_min: the larger of the two is the valid one."""
        width = self.d_O - self.d_I
        edge = self.F_N / (self.z_E * self.feed_force_factor)
        share = 2 * edge / (maximum(width, _NO_WIDTH) * self.k_c11 * self.h_1)
        power = self.h_1 * (share * sin(self.sigma / 2) ** self.z) ** (1 / (1 - self.z))
        straight = self.h_1 * share * (self.h_min / self.h_1) ** self.z
        return where(width > 0, maximum(power, straight), 0.0)
