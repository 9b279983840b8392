"""A ball that bounces until it comes to rest."""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    der,
    fixed,
    integer,
    parameter,
    pre,
    reset,
    variable,
    when,
)


class BouncingBall(Component):
    """A ball that falls on a floor and bounces with the coefficient of restitution `e`.

    The times between bounces, 2*v/g, decrease: the bounces accumulate at t = sqrt(2*h0/g)*(1 + e)/(1 - e), 2.56 s
    with the values below, and from then on the ball lies on the floor.
    """

    e: Real = parameter(default=0.7, unit="1", min=0.0, max=1.0, doc="Coefficient of restitution")
    g: Real = parameter(default=9.81, unit="m/s2", doc="Gravity")
    h0: Real = parameter(default=1.0, unit="m", doc="Height at the start")
    h: Real = variable(unit="m", doc="Height of the ball")
    v: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity, upward")
    bounces: Real = integer(doc="Number of bounces")

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("h",), title="Height"),
        Panel(("v",), title="Velocity"),
    )

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g
        yield when(self.h < 0.0, reset(self.v, -self.e * pre(self.v)), reset(self.bounces, pre(self.bounces) + 1))

    def initial_equations(self) -> Equations:
        yield self.h == self.h0
