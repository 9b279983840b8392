"""Lateral contact of the drill's flank with the wall of its hole."""

from __future__ import annotations

import math

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    as_expr,
    connect,
    cross,
    der,
    dot,
    maximum,
    minimum,
    no_event,
    parameter,
    part,
    quantity,
    signal_input,
    signal_output,
    sqrt,
    tan,
    variable,
    where,
)
from acausal.library.drilling.full_drilling_force import FullDrillingForce
from acausal.library.multibody.frames import Frame


class FlankContact(Component):
    """Lateral contact: the wall of the hole resists a drill that leaves its axis, sideways or by tilting.

    The hole is where the drill enters: its axis follows that of the drill as long as the tip is free, and is fixed
    while the tip is behind the surface. The engaged length of the flank is supported by two springs, at its lower end
    and at the entry, so that a tilt is resisted too. Each acts when its point is farther from the axis than the
    clearance: F = k L/2 (e - clearance) (1 + a der(e)), at least zero.

    Beyond the founding paper, which allows no lateral force.
    """

    frame_a: Frame = Frame()
    frame_w: Frame = Frame()

    d: Real = parameter(unit="m", min=0.0, doc="Diameter of the drill")
    sigma: Real = parameter(unit="rad", min=0.0, max=math.pi, doc="Point angle of the drill")
    k: Real = parameter(default=0.0, unit="Pa", min=0.0, doc="Stiffness of the wall per engaged length")
    a: Real = parameter(default=50.0, unit="s/m", min=0.0, doc="Damping force divided by rate and elastic force")
    clearance: Real = parameter(default=2e-5, unit="m", min=0.0, doc="Play between flank and wall, on one side")
    T: Real = parameter(default=1e-3, unit="s", min=0.0, doc="Time constant with which the hole follows a free drill")

    s: Real = signal_input(unit="m", doc="Depth of the tip behind the entry face, along the axis")
    s_exit: Real = signal_input(unit="m", doc="Depth of the tip behind the exit face, along the axis")
    tip: Real = signal_input(unit="m", shape=3, doc="Tip, seen from frame_w and resolved there")
    axis: Real = signal_input(unit="1", shape=3, doc="Drill axis towards the tip, resolved in frame_w")

    place: Real = variable(unit="m", shape=3, nominal=1e-2, doc="A point of the axis of the hole, in frame_w")
    direction: Real = variable(unit="1", shape=3, doc="Direction of the axis of the hole, in frame_w")
    engaged: Real = signal_output(unit="m", nominal=1e-2, doc="Length of the flank in the hole")
    force: Real = signal_output(unit="N", shape=3, doc="Force of the wall on the drill, in frame_w")
    energy: Real = signal_output(unit="J", doc="Energy stored in the wall")
    power_normal: Real = signal_output(unit="W", doc="Power into the wall, stored or lost")
    power_damping: Real = signal_output(
        unit="W", doc="Power lost in the wall, except what is lost at once where the tip slips off an edge"
    )

    def equations(self) -> Equations:
        a, w = self.frame_a, self.frame_w
        free = no_event(self.s <= 0)
        for held, present in ((self.place, self.tip), (self.direction, self.axis)):
            yield der(held) == as_expr([where(free, (present[k] - held[k]) / self.T, 0.0) for k in range(3)])
        h_c = self.d / (2 * tan(self.sigma / 2))
        lower = maximum(self.s_exit, h_c)
        yield self.engaged == maximum(self.s - lower, 0.0)
        ends = [self._end(minimum(lower, self.s)), self._end(self.s)]
        total = ends[0][1] + ends[1][1]
        yield self.force == total
        yield self.energy == ends[0][2] + ends[1][2]
        moment = cross(ends[0][0], ends[0][1]) + cross(ends[1][0], ends[1][1])
        yield self.power_normal == -(ends[0][3] + ends[1][3])
        yield self.power_damping == self.power_normal - der(self.energy)
        to_drill = a.R.T @ w.R
        yield w.f == total
        yield w.t == moment
        yield a.f == -(to_drill @ total)
        yield a.t == -(to_drill @ (moment - cross(w.R.T @ (a.r_0 - w.r_0), total)))

    def initial_equations(self) -> Equations:
        yield self.place == self.tip
        yield self.direction == self.axis

    def _end(self, height: Expr) -> tuple[Expr, Expr, Expr, Expr]:
        """Point of the drill's axis `height` above the tip [m], force on it [N], stored energy [J] and power [W]."""
        point = self.tip - self.axis * height
        velocity = der(self.tip) - der(self.axis) * height
        off = point - self.place
        across = off - self.direction * dot(off, self.direction)
        distance = sqrt(dot(across, across) + quantity(_TINY, "m") ** 2)
        pressed = maximum(distance - self.clearance, 0.0)
        outward = across / distance
        elastic = self.k * self.engaged / 2 * pressed
        push = maximum(elastic * (1 + self.a * dot(outward, velocity)), 0.0)
        force = -outward * push
        return point, force, elastic * pressed / 2, dot(force, velocity)


_TINY = 1e-9
"""Smooths the distance from the axis [m], so that it is differentiable on the axis."""


class GuidedDrillingForce(FullDrillingForce):
    """FullDrillingForce with the lateral contact of the flank; off until `k_wall` is given."""

    k_wall: Real = parameter(default=0.0, unit="Pa", min=0.0, doc="Stiffness of the wall per engaged length")
    clearance: Real = parameter(default=2e-5, unit="m", min=0.0, doc="Play between flank and wall, on one side")

    flank: FlankContact = part()

    def build(self) -> None:
        super().build()
        self.flank = FlankContact(
            d=self.d,
            sigma=self.sigma,
            k=self.k_wall,
            clearance=self.clearance,
            s=self.geometry.s,
            s_exit=self.geometry.s_exit,
            tip=self.geometry.tip,
            axis=self.geometry.axis,
        )

    def equations(self) -> Equations:
        yield connect(self.frame_a, self.flank.frame_a)
        yield connect(self.frame_w, self.flank.frame_w)
