"""A pendulum on a cart, in Cartesian coordinates, swung up by pushing the cart."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, guess, parameter, signal_input, variable

if TYPE_CHECKING:
    from acausal.optimal_control import Problem


class CartPole(Component):
    """A cart on a line with a point mass on a rod of constant length, in the coordinates x and y of the mass.

    The rod is a constraint, (x - s)**2 + y**2 == length**2; there is no angle.
    """

    f: Real = signal_input(unit="N", min=-20.0, max=20.0, default=0.0, doc="Push on the cart")
    m_c: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Mass of the cart")
    m: Real = parameter(default=0.3, unit="kg", min=0.0, doc="Mass on the rod")
    length: Real = parameter(default=0.5, unit="m", min=0.0, doc="Length of the rod")
    g: Real = parameter(default=9.81, unit="m/s2", doc="Gravity")
    s: Real = variable(unit="m", default=fixed(0.0), doc="Position of the cart")
    v: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity of the cart")
    x: Real = variable(unit="m", default=fixed(0.0), doc="Position of the mass along the line")
    y: Real = variable(unit="m", default=guess(-0.5), doc="Height of the mass above the cart")
    v_x: Real = variable(unit="m/s", default=fixed(0.0), doc="Velocity of the mass along the line")
    v_y: Real = variable(unit="m/s", doc="Velocity of the mass, upward")
    tension: Real = variable(unit="N/m", nominal=10.0, doc="Tension of the rod divided by its length")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8)
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("s", "x", "y"), title="Cart and mass"),)

    def equations(self) -> Equations:
        across = self.x - self.s
        yield der(self.s) == self.v
        yield der(self.x) == self.v_x
        yield der(self.y) == self.v_y
        yield self.m_c * der(self.v) == self.f + self.tension * across
        yield self.m * der(self.v_x) == -self.tension * across
        yield self.m * der(self.v_y) == -self.tension * self.y - self.m * self.g
        yield across**2 + self.y**2 == self.length**2


def swing_up(duration: float = 2.0, intervals: int = 20) -> Problem:
    """Swing-up from the hanging to the upright position, one metre to the side, with the least effort."""
    from acausal.optimal_control import Problem

    problem = Problem(CartPole())
    problem.phase(duration=duration, intervals=intervals)
    problem.subject_to(problem.end("s") == 1.0)
    problem.subject_to(problem.end("v") == 0.0)
    problem.subject_to(problem.end("x") == 1.0)
    problem.subject_to(problem.end("v_x") == 0.0)
    problem.subject_to(problem.end("y") >= 0.0)
    problem.minimize(problem.integral(problem["f"] ** 2))
    problem.guess(lines={"s": (0.0, 1.0), "angle(s, x, y)": (0.0, math.pi)})
    return problem
