"""The kinematic drilling force: feed rate and rotation are prescribed, the forces follow."""

from __future__ import annotations

from acausal import (
    Equations,
    Real,
    assert_,
    connect,
    maximum,
    no_event,
    parameter,
    part,
    quantity,
    signal_input,
    signal_output,
)
from acausal.library.drilling.cutting import PartialCuttingForce
from acausal.library.drilling.interfaces import PartialDrillingForce


class KinematicCuttingForce(PartialCuttingForce):
    """Cutting force of a drill whose feed and rotation are prescribed.

    Source: founding paper, section 3.1: f_z = v / (n z_E).
    """

    n_min: Real = parameter(default=1e-3, unit="1/s", min=0.0, doc="Rotational speed below which the feed stays finite")
    v: Real = signal_input(unit="m/s", doc="Feed rate: rate of the depth, from DrillGeometry")

    def equations(self) -> Equations:
        yield self.f_z == maximum(self.v, 0.0) / (self.z_E * maximum(self.n, self.n_min))


class KinematicDrillingForce(PartialDrillingForce):
    """Drilling force of a prescribed motion: DrillGeometry -> KinematicCuttingForce.

    Feed rate and rotation are measured at its frames, so they are prescribed by the drives of these; the forces act on
    both frames and appear as reactions in the drives. The hole is not remembered: a drill that is drawn back and enters
    again cuts material that has already been removed, which the run notes (AC193). `DrillingForce` keeps the depth of
    the hole.
    """

    force: KinematicCuttingForce = part()

    power_cutting: Real = signal_output(
        unit="W", nominal=100.0, doc="Power of the cut: all power supplied by the two frames"
    )

    def build(self) -> None:
        super().build()
        self.force = KinematicCuttingForce(
            axis_a=self.axis_a,
            sigma=self.sigma,
            z_E=self.z_E,
            k_c11=self.corrected_k_c11(),
            z=self.z,
            h_min=self.h_min,
            feed_force_factor=self.feed_force_factor,
        )

    def equations(self) -> Equations:
        yield from self.linked(self.force)
        yield connect(self.geometry.v, self.force.v)
        yield (
            self.power_cutting
            == self.force.thrust_on_axis() * self.v_axial + self.force.braking() * self.geometry.omega
        )
        # Raised at the retreat rather than at the return, which would take a state, and events for every drill.
        yield assert_(
            (self.geometry.s <= 0) | (self.geometry.v >= -_STILL),
            f"AC193: the drill is drawn back in {self.level.name}, but a kinematic force does not remember the hole: "
            "if it enters again, it cuts material that is already gone; use DrillingForce for pecking",
            level="warning",
        )
        yield assert_(
            (self.geometry.s <= 0) | no_event(self.z_E * self.f_z <= self.d),
            f"AC197: the drill is fed into {self.level.name} by more than its diameter in a turn: the force of a drill "
            "that does not turn is that of a crash, and here it depends on n_min alone; turn it before it touches, or "
            "use DrillingForce, which presses it on as a spring",
            level="warning",
        )


_STILL = quantity(1e-9, "m/s")
"""Velocity below which the feed counts as standing still."""
