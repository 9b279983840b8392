"""The dynamic drilling force, composed of its three blocks."""

from __future__ import annotations

from acausal import Equations, Real, connect, parameter, part, signal_output, structural
from acausal.library.drilling.depth import DrillDepthCalculation
from acausal.library.drilling.force import DrillContactForce
from acausal.library.drilling.interfaces import PartialDrillingForce


class DrillingForce(PartialDrillingForce):
    """Compliant drilling force between a drill and a plate that both move freely under their forces.

    DrillGeometry -> DrillDepthCalculation -> DrillContactForce, as Figure 3 of the founding paper.
    """

    as_printed: bool = structural(default=False, doc="Contact force by equation (21) instead of (20)")
    k: Real = parameter(unit="N/m", min=0.0, nominal=1e8, doc="Stiffness of the contact")
    d_c: Real = parameter(unit="N.s/m", min=0.0, nominal=1e4, doc="Damping of the contact")
    s_start: Real = parameter(default=0.0, unit="m", min=0.0, doc="Depth of the hole at the start")

    depth: DrillDepthCalculation = part()
    force: DrillContactForce = part()

    v_tar: Real = signal_output(unit="m/s", nominal=1e-3, doc="Target feed rate")
    s_tar: Real = signal_output(unit="m", nominal=1e-3, doc="Target depth: the ground of the hole")

    def build(self) -> None:
        super().build()
        self.depth = DrillDepthCalculation(z_E=self.z_E, s_start=self.s_start)
        self.force = DrillContactForce(
            as_printed=self.as_printed,
            axis_a=self.axis_a,
            sigma=self.sigma,
            z_E=self.z_E,
            k_c11=self.k_c11,
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
