"""Compliant contact between the drill and the bottom of the hole: the dynamic drilling force."""

from __future__ import annotations

import math

from acausal import (
    Equations,
    Expr,
    Real,
    assert_,
    guess,
    maximum,
    minimum,
    parameter,
    signal_input,
    signal_output,
    structural,
    variable,
    where,
)
from acausal.library.drilling.cutting import PartialCuttingForce


class DrillContactForce(PartialCuttingForce):
    """Spring and damper in series with the cut: the contact force determines the feed.

    The bottom of the hole recedes with the target feed rate `v_tar = z_E n f_z`. There are two forms of the contact
    force:

    - Equation (20), the default: k (s - s_tar) + d_c (v - v_tar). All its terms grow with the feed along curves that
      bend to one side, so that the compiler solves it for the feed inside the equations (`f_z` is declared
      `monotone_above=0.0`), which leaves an ordinary differential equation.
    - Equation (21), `as_printed=True`: k (s - s_tar) + d_c v. It fails when a rotating drill first touches: the feed
      rate grows without bound as the engaged width vanishes.

    Source: founding paper, equations (11) and (16) to (21).

    Beyond the paper, with `chisel=True`: the middle of the chisel edge hardly moves along its cutting direction and
    is pressed in like a punch, with the pressure `p_indent` on the engaged part of a circle of diameter `d_indent`.
    This force acts at any feed, so that the total thrust does not vanish with the feed, as by Kienzle's law alone. The
    pressure of a punch is (2 + pi)/sqrt(3) to 3 times the yield stress (L. Prandtl, Nachr. Ges. Wiss. Goettingen
    (1920) 74-85; D. Tabor, The Hardness of Metals, 1951, chapter IV). The circle covers what is indented rather than
    cut and is much smaller than the web: W. A. Mauch, L. K. Lauderbaugh, Modeling the drilling processes - an
    analytical model to predict thrust force and torque, ASME Winter Annual Meeting 1990. Fit it to a measured thrust at
    vanishing feed.
    """

    as_printed: bool = structural(default=False, doc="Equation (21) instead of (20)")
    chisel: bool = structural(default=False, doc="With the indentation of the chisel edge")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    w_min: Real = parameter(
        default=1e-9, unit="m", min=1e-18, doc="Engaged width below which the force is less than its full value"
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
        monotone_above=0.0,
        doc="Contact force per engaged width",
        hint="are the stiffness k of the contact and w_min greater than 0?",
    )

    def thrust_on_axis(self) -> Expr:
        return self.F_N

    def equations(self) -> Equations:
        yield assert_(
            self.z <= _STEEPEST,
            f"the exponent z of the cutting force is above {_STEEPEST}: pressed onto the point of its cone, a drill "
            "would be fed faster than numbers tell; those of metals are below 0.5",
        )
        engaged = self.d_O - self.d_I
        v_tar = self.z_E * self.n * self.f_z  # (17), (18)
        # The contact with the bottom is located as an event: the bottom stays while a drill is drawn back, and a solver
        # whose steps have grown meanwhile would step over the next contact. Without pressure, feed and v_tar are 0.
        closing = self.k * (self.s - self.s_tar) + self.d_c * self.v
        pressing = maximum(where(closing > 0, closing, 0.0), 0.0)  # not negative just before the event, either
        contact = where(engaged > 0, pressing, 0.0) if self.as_printed else pressing - self.d_c * v_tar  # (21), (20)
        yield self.line_force == self.feed_force_factor * self.z_E / 2 * self.k_c * self.f_z  # (6) to (10)
        yield self.line_force * maximum(engaged, self.w_min) + self.F_i == contact
        yield self.F_i == (self.indentation() * self.f_z / (self.f_z + self.f_indent) if self.chisel else 0.0)
        yield self.F_N == self.F_f + self.F_i  # (11)

    def indentation(self) -> Expr:
        """Indentation force [N] of an edge that is pressed in."""
        outer, inner = minimum(self.d_O, self.d_indent), minimum(self.d_I, self.d_indent)
        return self.p_indent * (math.pi / 4) * (outer**2 - inner**2)


_STEEPEST = 0.6
"""Exponent above which the feed at a touch with 0.1 m/s, on `w_min`, is beyond 1e14 m."""
