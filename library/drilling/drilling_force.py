"""The dynamic drilling force, composed of its three blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from acausal import (
    Equations,
    Real,
    Result,
    assert_,
    connect,
    initial,
    maximum,
    no_event,
    parameter,
    part,
    signal_output,
    structural,
    where,
)
from acausal.library.drilling.depth import DrillDepthCalculation
from acausal.library.drilling.force import DrillContactForce
from acausal.library.drilling.interfaces import PartialDrillingForce
from acausal.library.drilling.review import review


class DrillingForce(PartialDrillingForce):
    """Compliant drilling force between a drill and a plate that both move freely under their forces.

    DrillGeometry -> DrillDepthCalculation -> DrillContactForce, as in Figure 3 of the founding paper. There is a single
    hole, wherever the drill enters (AC194).
    """

    as_printed: bool = structural(default=False, doc="Contact force by equation (21) instead of (20)")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    s_start: Real = parameter(default=0.0, unit="m", min=0.0, doc="Depth of the hole at the start")

    chisel: bool = structural(default=False, doc="With the indentation of the chisel edge")
    p_indent: Real = parameter(default=0.0, unit="Pa", min=0.0, doc="Pressure below the indenting chisel edge")
    d_indent: Real = parameter(default=0.0, unit="m", min=0.0, doc="Diameter of the part that is indented")

    depth: DrillDepthCalculation = part()
    force: DrillContactForce = part()

    v_tar: Real = signal_output(unit="m/s", nominal=1e-3, doc="Target feed rate")
    s_tar: Real = signal_output(unit="m", nominal=1e-3, doc="Target depth: the bottom of the hole")
    thrust: Real = signal_output(unit="N", nominal=1e3, doc="Feed force and indentation force, along the axis")
    power_cutting: Real = signal_output(unit="W", nominal=100.0, doc="Power of the cut, with the indentation")
    power_normal: Real = signal_output(unit="W", doc="Power into the compliance of the contact, stored or lost")
    power_damping: Real = signal_output(
        unit="W", doc="Power lost in the compliance, except what is lost at once where the tip slips off an edge"
    )
    energy: Real = signal_output(unit="J", doc="Energy stored in the compliance of the contact")

    def build(self) -> None:
        super().build()
        self.depth = DrillDepthCalculation(z_E=self.z_E, s_start=self.s_start)
        self.force = DrillContactForce(
            as_printed=self.as_printed,
            chisel=self.chisel,
            p_indent=self.p_indent,
            d_indent=self.d_indent,
            axis_a=self.axis_a,
            sigma=self.sigma,
            z_E=self.z_E,
            k_c11=self.corrected_k_c11(),
            z=self.z,
            h_min=self.h_min,
            feed_force_factor=self.feed_force_factor,
            k=self.k,
            d_c=self.d_c,
        )

    def equations(self) -> Equations:
        geometry, depth, force = self.geometry, self.depth, self.force
        yield from self.linked(force)
        yield connect(geometry.s, depth.s, force.s)
        yield connect(geometry.v, force.v)
        yield connect(geometry.n, depth.n)
        yield connect(force.f_z, depth.f_z)
        yield connect(depth.s_tar, force.s_tar)
        yield self.v_tar == depth.v_tar
        yield self.s_tar == depth.s_tar
        yield from self.powers()
        # An initial force larger than that of a cut of 1 mm per edge would eject the drill from the plate.
        pressed = self.k * (self.s - self.s_start)
        blunt = self.feed_force_factor * self.z_E / 2 * self.d * self.corrected_k_c11() * force.h_1
        outside = (self.s - self.s_start < self.d / 100) | (pressed < blunt)
        yield assert_(
            ~initial() | no_event(outside),
            f"the drill starts inside {self.level.name}: move it back, or give it a hole with s_start",
        )

    @staticmethod
    def review(run: Result, paths: Sequence[str], scalars: Mapping[str, int]) -> Sequence[str]:
        """Notes on drills beside their holes (AC194), and on holes that overlap (AC192)."""
        return review(run, paths, scalars)

    def powers(self) -> Equations:
        """Distribution of the power thrust * v_axial + braking * omega supplied through the two frames.

        The spring of the contact, between the tip and the bottom of the hole, cannot pull: the energy stored in it is
        lost if the tip leaves the bottom too fast for a contact force, and at once if the axis leaves the workpiece.
        No power expresses the latter: it is the integral of `power_normal` minus `energy`.
        """
        geometry, force = self.geometry, self.force
        deflection = maximum(self.s - self.s_tar, 0.0)
        v_ground = where(no_event(self.s > 0), self.v_tar, 0.0)
        yield self.thrust == force.F_N
        yield self.energy == self.k / 2 * deflection**2
        yield self.power_normal == self.thrust * (geometry.v - v_ground)
        yield self.power_damping == (self.thrust - self.k * deflection) * (geometry.v - v_ground)
        # The depth of a tilted tip also changes when it slides along the face.
        along = self.thrust * (v_ground + self.v_axial - geometry.v)
        yield self.power_cutting == along + force.braking() * geometry.omega
