"""A ball that is thrown with the least speed so that it bounces once and then hits a target."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, pre, reset, variable, when

if TYPE_CHECKING:
    from acausal.optimal_control import Problem


class ThrownBall(Component):
    """A ball in a plane that bounces off the floor with the coefficient of restitution `e`."""

    e: Real = parameter(default=0.7, unit="1", min=0.0, max=1.0, doc="Coefficient of restitution")
    g: Real = parameter(default=9.81, unit="m/s2", doc="Gravity")
    x: Real = variable(unit="m", default=fixed(0.0), doc="Position along the floor")
    h: Real = variable(unit="m", default=fixed(1.0), doc="Height of the ball")
    v_x: Real = variable(unit="m/s", default=fixed(2.0), doc="Velocity along the floor")
    v_h: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity, upward")

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("h",), title="Path", against="x"),)

    def equations(self) -> Equations:
        yield der(self.x) == self.v_x
        yield der(self.h) == self.v_h
        yield der(self.v_x) == 0.0
        yield der(self.v_h) == -self.g
        yield when(self.h < 0.0, reset(self.v_h, -self.e * pre(self.v_h)))


def gentle_throw(distance: float = 3.0, height: float = 0.8) -> Problem:
    """The throw of least speed that bounces once and then hits a point `distance` away at `height` [m]."""
    from acausal.optimal_control import Problem

    problem = Problem(ThrownBall(), free_start=["v_x", "v_h"])
    problem.phase("thrown", until="h < 0", intervals=2)
    bounced = problem.phase("bounced", duration=(0.01, 10.0), intervals=2, expected=0.4)
    problem.subject_to(bounced.end("x") == distance)
    problem.subject_to(bounced.end("h") == height)
    problem.minimize(problem.start("v_x") ** 2 + problem.start("v_h") ** 2)
    return problem
