"""Compliant contact between the drill and the ground of the hole: the dynamic drilling force."""

from __future__ import annotations

import math

from acausal import (
    Equations,
    Expr,
    Real,
    as_expr,
    guess,
    maximum,
    minimum,
    no_event,
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

    - Equation (20), the default: k (s - s_tar) + d_c (v - v_tar). With `explicit=False` it is solved implicitly for the
      force per engaged width: the equation is then monotone, without a jump of its slope, at any rotation and any
      width, nothing is divided by the width, and a drill that does not press has a negative `line_force` and no force.
    - Equations (21) and (16), `as_printed=True`: k (s - s_tar) + d_c v, which gives the feed explicitly. It breaks
      when a rotating drill first touches: the feed rate grows without bound as the engaged width vanishes.

    `explicit=True`, the default, solves (20) inside the equations, by a fixed number of steps of Newton's method that
    always reach it (see `feed_under`). A scene then is an ordinary differential equation: what costs one algebraic
    variable less needs some dozens of operations more, and events are located exactly.

    Source: founding paper, equations (11) and (16) to (21).

    Beyond the paper, with `chisel=True`: the middle of the chisel edge hardly moves along its cutting direction and
    is pressed in like a punch, with the pressure `p_indent` on the engaged part of a circle of diameter `d_indent`.
    That thrust is there at any feed, so that the whole thrust does not vanish with the feed as Kienzle's law does. The
    pressure of a punch is (2 + pi)/sqrt(3) to 3 times the yield stress (L. Prandtl, Nachr. Ges. Wiss. Goettingen
    (1920) 74-85; D. Tabor, The Hardness of Metals, 1951, chapter IV). The circle is what is indented and not cut, much
    smaller than the web: W. A. Mauch, L. K. Lauderbaugh, Modeling the drilling processes - an analytical model to
    predict thrust force and torque, ASME Winter Annual Meeting 1990; fit it to a measured thrust at vanishing feed.
    """

    as_printed: bool = structural(default=False, doc="Equation (21) instead of (20)")
    explicit: bool = structural(default=True, doc="Equation (20) solved by a fixed number of Newton steps")
    chisel: bool = structural(default=False, doc="With the indentation of the chisel edge")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    w_min: Real = parameter(
        default=1e-9, unit="m", min=0.0, doc="Engaged width below which the force has not grown to its full value yet"
    )
    p_indent: Real = parameter(default=0.0, unit="Pa", min=0.0, doc="Pressure below the indenting chisel edge")
    d_indent: Real = parameter(default=0.0, unit="m", min=0.0, doc="Diameter of the part that is indented")
    f_indent: Real = parameter(
        default=1e-7, unit="m", min=0.0, doc="Feed per edge at which half of the indentation force acts"
    )

    s: Real = signal_input(unit="m", doc="Depth of the tip, from DrillGeometry")
    v: Real = signal_input(unit="m/s", doc="Rate of the depth, from DrillGeometry")
    s_tar: Real = signal_input(unit="m", doc="Target depth, from DrillDepthCalculation")

    F_N: Real = signal_output(unit="N", nominal=1e3, doc="Contact force, not negative")
    F_i: Real = signal_output(unit="N", nominal=1e3, doc="Indentation force of the chisel edge")
    line_force: Real = variable(
        unit="N/m",
        default=guess(0.0),
        nominal=1e6,
        doc="Contact force per engaged width; negative when the drill does not press",
        hint="are the stiffness k of the contact and w_min greater than 0?",
    )

    def thrust_on_axis(self) -> Expr:
        return self.F_N

    def equations(self) -> Equations:
        width = self.d_O - self.d_I
        spring = self.k * (self.s - self.s_tar)
        edges = self.feed_force_factor * self.z_E / 2
        indentation = self.indentation() if self.chisel else as_expr(0.0)
        yield self.F_N == self.F_f + self.F_i  # (11)
        if self.as_printed:
            contact = maximum(spring + self.d_c * self.v, 0.0)  # (21)
            yield self.F_i == (minimum(contact, indentation) if self.chisel else 0.0)
            yield self.line_force == where(width > 0, (contact - self.F_i) / maximum(width, self.w_min), 0.0)
            yield self.f_z == self.feed(self.line_force / edges)  # (16)
        elif self.explicit:
            yield self.line_force == self.F_f / maximum(width, self.w_min)
            yield self.F_i == (indentation * self.f_z / (self.f_z + self.f_indent) if self.chisel else 0.0)
            pressing = maximum(spring + self.d_c * self.v, 0.0)
            yield self.f_z == self.feed_under(pressing, edges * maximum(width, self.w_min), indentation)
        else:
            yield self.f_z == self.feed(maximum(self.line_force, 0.0) / edges)
            # A free drill has a feed and a width too, the mirror image of those behind the face: no force follows
            # from them, but the equation keeps its slope when the drill touches or starts to turn.
            f_free = self.feed(maximum(-self.line_force, 0.0) / edges)
            v_tar = self.z_E * self.n * (self.f_z - f_free)
            mirrored = width + 2 * tan(self.sigma / 2) * maximum(-self.s, 0.0)
            contact = maximum(mirrored, self.w_min) * self.line_force
            if self.chisel:
                yield self.F_i == indentation * self.f_z / (self.f_z + self.f_indent)
                contact += indentation * (self.f_z - f_free) / (self.f_z + f_free + self.f_indent)
            else:
                yield self.F_i == 0.0
            yield spring + self.d_c * (self.v - v_tar) == contact  # (20)

    def indentation(self) -> Expr:
        """Indentation force [N] of an edge that is pressed in."""
        outer, inner = minimum(self.d_O, self.d_indent), minimum(self.d_I, self.d_indent)
        return self.p_indent * (math.pi / 4) * (outer**2 - inner**2)

    def feed_under(self, force: Expr, edge: Expr, indentation: Expr) -> Expr:
        """Feed per edge [m] at which edges, indentation and damper together take up `force` [N]: (20), solved.

        All terms grow with the feed along concave curves. Their sum reaches the force at the latest where one of them
        would take its equal share of it alone, and, as the indentation force is bounded, where edges and damper would
        share the rest. From the larger of these feeds, which is below the solution, Newton's method comes nearer from
        below, for it follows tangents that lie above the curve. What is left of the force after five steps, or nine
        with the indentation, is rounding: less than 1e-14 of it for forces of 1 mN to 1 MN, widths of 1 nm to 20 mm
        and speeds of 0 to 100 1/s.
        """
        slowest = self.h_min / sin(self.sigma / 2)
        damper = self.d_c * self.z_E * self.n
        terms = 3 if self.chisel else 2
        share = force / terms
        # The floors keep derivatives finite where the drill stands still or does not touch.
        f = minimum(self.feed(share / edge), share / maximum(damper, 1e-6))
        if self.chisel:
            f = minimum(f, self.f_indent * share / maximum(indentation - share, 1e-6 * share + 1e-6))
            half = maximum(force - indentation, 0.0) / 2
            f = maximum(f, minimum(self.feed(half / edge), half / maximum(damper, 1e-6)))
        for _ in range(9 if self.chisel else 5):
            k_c = self.k_c11 * (maximum(f, slowest) * sin(self.sigma / 2) / self.h_1) ** (-self.z)
            rest = force - edge * k_c * f - damper * f
            slope = edge * k_c * where(no_event(f > slowest), 1 - self.z, 1.0) + damper
            if self.chisel:
                rest -= indentation * f / (f + self.f_indent)
                slope += indentation * self.f_indent / (f + self.f_indent) ** 2
            f = maximum(f + rest / slope, 0.0)
        return f

    def feed(self, x: Expr) -> Expr:
        """Feed per edge [m] from `x = f_z k_c(f_z)` [N/m], not negative: equation (16).

        Below h_min k_c is constant and the feed proportional to `x`; the larger of the two is the valid one.
        """
        share = x / (self.k_c11 * self.h_1)
        # Zero to a power has no derivative by the exponent; the number is too small to survive the power.
        power = maximum(share * sin(self.sigma / 2) ** self.z, 1e-300) ** (1 / (1 - self.z))
        straight = share * (self.h_min / self.h_1) ** self.z
        return self.h_1 * maximum(power, straight)
