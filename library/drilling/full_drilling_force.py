"""The drilling force with friction at margins and tip, which the founding paper leaves out."""

from __future__ import annotations

from acausal import Equations, Real, connect, parameter, part, signal_output
from acausal.library.drilling.drilling_force import DrillingForce
from acausal.library.drilling.friction import MarginFriction, TipFriction


class FullDrillingForce(DrillingForce):
    """DrillingForce with friction of the margins in the hole and of the tip across the axis.

    It has the frames and the variables of DrillingForce. Each addition is inactive until its coefficients are given;
    `chisel=True` adds the indentation of the chisel edge. `total_thrust` [N] and `total_torque` [N.m] are the values
    that a force sensor behind the drill measures.
    """

    mu_margin: Real = parameter(default=0.0, unit="1", min=0.0, doc="Coefficient of friction of the margins")
    line_load: Real = parameter(
        default=0.0, unit="N/m", min=0.0, doc="Normal force of the wall per length of engaged margin"
    )
    margin_length: Real = parameter(default=1.0, unit="m", min=0.0, doc="Length of the margins from the corner up")
    mu_tip: Real = parameter(default=0.0, unit="1", min=0.0, doc="Coefficient of friction of the tip across the axis")

    margin: MarginFriction = part()
    side: TipFriction = part()

    total_thrust: Real = signal_output(unit="N", nominal=1e3, doc="Force on the drill along its axis, with friction")
    total_torque: Real = signal_output(unit="N.m", nominal=10.0, doc="Torque on the drill, with sign and friction")
    power_friction: Real = signal_output(unit="W", doc="Power lost by friction at margins and tip")

    def build(self) -> None:
        super().build()
        self.margin = MarginFriction(
            axis_a=self.axis_a,
            mu=self.mu_margin,
            line_load=self.line_load,
            length=self.margin_length,
            d=self.d,
            sigma=self.sigma,
        )
        self.side = TipFriction(
            axis_a=self.axis_a,
            mu=self.mu_tip,
            length=self.length,
            thrust=self.force.F_N,
            radius=(self.geometry.d_O + self.geometry.d_I) / 4,
        )

    def equations(self) -> Equations:
        geometry, margin, side = self.geometry, self.margin, self.side
        yield connect(self.frame_a, margin.frame_a, side.frame_a)
        yield connect(self.frame_w, margin.frame_w, side.frame_w)
        yield connect(geometry.tip, margin.tip, side.tip)
        yield connect(geometry.axis, margin.axis, side.axis)
        yield connect(geometry.omega, margin.omega, side.omega)
        yield connect(geometry.s, margin.s)
        yield connect(geometry.s_exit, margin.s_exit)
        yield self.total_thrust == self.thrust + margin.F
        yield self.total_torque == self.force.braking() + margin.torque
        yield self.power_friction == margin.power + side.power
