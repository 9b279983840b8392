"""The dynamic drilling scene written by hand for one axis: the result to which `acausal reduce` is compared."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Expr,
    Panel,
    Real,
    assert_,
    clamp,
    der,
    fabs,
    fixed,
    initial,
    maximum,
    minimum,
    no_event,
    parameter,
    part,
    sin,
    structural,
    tan,
    variable,
    where,
)
from acausal.library.blocks import TimeTable
from acausal.models.drilling_dynamic import FORCE, SPEED, Points


class OneAxisDrilling(Component):
    """A drill with one degree of freedom in a block; the states are depth, speed and bottom of the hole.

    The equations and parameter values of `ThickBlock` (docs/drilling.md) for motion along the drill axis: without
    frames, bodies and the angle of the spindle.
    """

    force_profile: Points = structural(default=FORCE, doc="Rows (time [s], force [N]), straight in between")
    speed_profile: Points = structural(default=SPEED, doc="Rows (time [s], rotational speed [1/s])")
    m: Real = parameter(default=5.0, unit="kg", min=0.0, doc="Mass of the drill with its spindle")
    gap: Real = parameter(default=1e-3, unit="m", doc="Distance from the tip to the block at the start")
    t: Real = parameter(default=0.05, unit="m", min=0.0, doc="Thickness of the block")
    d: Real = parameter(default=0.016, unit="m", min=0.0, doc="Diameter of the drill")
    sigma: Real = parameter(default=math.radians(118.0), unit="rad", min=0.0, doc="Point angle of the drill")
    z_E: Real = parameter(default=2.0, unit="1", min=1.0, doc="Number of cutting edges")
    k_c11: Real = parameter(default=2240e6, unit="Pa", min=0.0, doc="Specific cutting force at h = b = 1 mm")
    z: Real = parameter(default=0.21, unit="1", min=0.0, max=1.0, doc="Exponent of the chip thickness")
    h_1: Real = parameter(default=1e-3, unit="m", min=0.0, doc="Chip thickness that k_c11 refers to")
    h_min: Real = parameter(default=1e-6, unit="m", min=0.0, doc="Chip thickness below which k_c stays constant")
    k: Real = parameter(default=1e8, unit="N/m", min=0.0, doc="Stiffness of the contact")
    d_c: Real = parameter(default=2e4, unit="N.s/m", min=0.0, doc="Damping of the contact")
    w_min: Real = parameter(
        default=1e-9, unit="m", min=0.0, doc="Engaged width below which the force is less than full"
    )

    force_table: TimeTable = part()
    speed_table: TimeTable = part()

    F: Real = variable(unit="N", doc="Force on the drill along its axis")
    n: Real = variable(unit="1/s", doc="Rotational speed, without sign")
    s: Real = variable(unit="m", doc="Depth of the tip behind the entry face")
    v: Real = variable(unit="m/s", doc="Rate of the depth")
    s_tar: Real = variable(unit="m", nominal=1e-3, default=fixed(0.0), doc="Depth of the hole")
    width: Real = variable(unit="m", doc="Difference of the diameters between which the edges cut")
    f_z: Real = variable(unit="m", doc="Feed per edge and revolution")
    k_c: Real = variable(unit="Pa", doc="Specific cutting force")
    F_c: Real = variable(unit="N", doc="Cutting force")
    F_f: Real = variable(unit="N", doc="Feed force")

    experiment: ClassVar[Experiment] = Experiment(stop_time=40.0, tolerance=1e-8, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("s", "s_tar"), title="Actual and target depth", unit="mm"),
        Panel(("F", "F_f"), title="Force", unit="N"),
    )

    def build(self) -> None:
        self.force_table = TimeTable(table=self.force_profile)
        self.speed_table = TimeTable(table=self.speed_profile)
        self.s = fixed(-self.gap)
        self.v = fixed(0.0)

    def equations(self) -> Equations:
        yield self.F == self.force_table.y
        yield self.n == fabs(self.speed_table.y)
        slope = tan(self.sigma / 2)
        h_c = self.d / (2 * slope)
        yield self.width == 2 * slope * (clamp(self.s, 0.0, h_c) - clamp(self.s - self.t, 0.0, h_c))

        factor = sin(self.sigma)
        edges = factor * self.z_E / 2
        pressing = maximum(self.k * (self.s - self.s_tar) + self.d_c * self.v, 0.0)
        yield self.f_z == self.feed_under(pressing, edges * maximum(self.width, self.w_min))
        yield self.k_c == self.k_c11 * (maximum(self.f_z * sin(self.sigma / 2), self.h_min) / self.h_1) ** (-self.z)
        yield self.F_c == self.z_E * self.width / 2 * self.f_z * self.k_c
        yield self.F_f == factor * self.F_c

        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.F - self.F_f
        # No event at the touch, because the force grows continuously from zero.
        yield der(self.s_tar) == where(no_event(self.s > 0), self.z_E * self.n * self.f_z, 0.0)
        yield assert_(
            ~initial() | no_event((self.s < self.d / 100) | (self.k * self.s < edges * self.d * self.k_c11 * self.h_1)),
            "the drill starts inside the material: move it back",
        )

    def feed_under(self, force: Expr, edge: Expr) -> Expr:
        """Feed per edge [m] at which edges and damper take up `force` [N]."""
        slowest = self.h_min / sin(self.sigma / 2)
        damper = self.d_c * self.z_E * self.n
        f = minimum(self.feed(force / 2 / edge), force / 2 / maximum(damper, 1e-6))
        for _ in range(5):
            k_c = self.k_c11 * (maximum(f, slowest) * sin(self.sigma / 2) / self.h_1) ** (-self.z)
            slope = edge * k_c * where(no_event(f > slowest), 1 - self.z, 1.0) + damper
            f = maximum(f + (force - edge * k_c * f - damper * f) / slope, 0.0)
        return f

    def feed(self, x: Expr) -> Expr:
        """Feed per edge [m] of `x = f_z k_c(f_z)` [N/m]."""
        share = x / (self.k_c11 * self.h_1)
        power = maximum(share * sin(self.sigma / 2) ** self.z, 1e-300) ** (1 / (1 - self.z))
        return self.h_1 * maximum(power, share * (self.h_min / self.h_1) ** self.z)
