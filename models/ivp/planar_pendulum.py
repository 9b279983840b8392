"""A pendulum in Cartesian coordinates whose period is exactly 2 s."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, guess, parameter, variable

GRAVITY = 13.750371636040745654980191559621114395801712
"""(2*K)**2 with the complete elliptic integral K of modulus 1/sqrt(2): the period of large swings is then 2 s."""


class PlanarPendulum(Component):
    """A point mass on a circle, released at rest from the horizontal; a DAE of index 3.

    The exact solution is known at all whole times: at even ones it is back at (1, 0), at odd ones at (-1, 0), at rest.
    """

    g: Real = parameter(default=GRAVITY, doc="Gravity")
    x: Real = variable(default=fixed(1.0))
    y: Real = variable(default=fixed(0.0))
    vx: Real = variable(default=fixed(0.0))
    vy: Real = variable(default=fixed(0.0))
    lam: Real = variable(default=guess(0.0), doc="Tension of the rod per length")

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x", "y"), title="Position"), Panel(("lam",), title="Tension"))

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.lam * self.x
        yield der(self.vy) == -self.lam * self.y - self.g
        yield self.x**2 + self.y**2 == 1.0
