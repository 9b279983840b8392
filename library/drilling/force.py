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
    tan,
    variable,
    where,
)
from acausal.library.drilling.cutting import PartialCuttingForce


class DrillContactForce(PartialCuttingForce):
    """Spring and damper in series with the cut: the feed is what the contact force can press through.

    The ground of the hole recedes with the target feed rate `v_tar = z_E n f_z`. Two forms of the contact force:

    - Equation (20), the default: k (s - s_tar) + d_c (v - v_tar). It is solved implicitly for the force per engaged
      width: the equation is then monotone, without a jump of its slope, at any rotation and any width, nothing is
      divided by the width, and a drill that does not press has a negative `line_force` and no force.
    - Equations (21) and (16), `as_printed=True`: k (s - s_tar) + d_c v, which gives the feed explicitly. It breaks
      when a rotating drill first touches: the feed rate grows without bound as the engaged width vanishes.

    Source: founding paper, equations (11) and (16) to (21).
    """

    as_printed: bool = structural(default=False, doc="Equation (21) instead of (20)")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    w_min: Real = parameter(
        default=1e-9, unit="m", min=0.0, doc="Engaged width below which the force has not grown to its full value yet"
    )

    s: Real = signal_input(unit="m", doc="Depth of the tip, from DrillGeometry")
    v: Real = signal_input(unit="m/s", doc="Rate of the depth, from DrillGeometry")
    s_tar: Real = signal_input(unit="m", doc="Target depth, from DrillDepthCalculation")

    F_N: Real = signal_output(unit="N", nominal=1e3, doc="Contact force, not negative")
    line_force: Real = variable(
        unit="N/m",
        default=guess(0.0),
        nominal=1e6,
        doc="Contact force per engaged width; negative when the drill does not press",
        hint="are the stiffness k of the contact and w_min greater than 0?",
    )

    def equations(self) -> Equations:
        width = self.d_O - self.d_I
        spring = self.k * (self.s - self.s_tar)
        edges = self.feed_force_factor * self.z_E / 2
        if self.as_printed:
            yield self.F_N == maximum(spring + self.d_c * self.v, 0.0)  # (21)
            yield self.line_force == where(width > 0, self.F_N / maximum(width, self.w_min), 0.0)
            yield self.f_z == self.feed(self.line_force / edges)  # (16)
        else:
            yield self.F_N == self.F_f  # (11)
            yield self.f_z == self.feed(maximum(self.line_force, 0.0) / edges)
            # A free drill has a feed and a width too, the mirror image of those behind the face: no force follows
            # from them, but the equation keeps its slope when the drill touches or starts to turn.
            v_tar = self.z_E * self.n * (self.f_z - self.feed(maximum(-self.line_force, 0.0) / edges))
            mirrored = width + 2 * tan(self.sigma / 2) * maximum(-self.s, 0.0)
            yield spring + self.d_c * (self.v - v_tar) == maximum(mirrored, self.w_min) * self.line_force  # (20)

    def feed(self, x: Expr) -> Expr:
        """Feed per edge [m] from `x = f_z k_c(f_z)` [N/m], not negative: equation (16).

        Below h_min k_c is constant and the feed proportional to `x`; the larger of the two is the valid one.
        """
        share = x / (self.k_c11 * self.h_1)
        # Zero to a power has no derivative by the exponent; the number is too small to survive the power.
        power = maximum(share * sin(self.sigma / 2) ** self.z, 1e-300) ** (1 / (1 - self.z))
        straight = share * (self.h_min / self.h_1) ** self.z
        return self.h_1 * maximum(power, straight)
