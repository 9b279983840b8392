"""The planar pendulum in x, y: drift, a fixed choice of states, the index-3 form, an inconsistent start."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, cos, der, fixed, guess, parameter, sin, variable

GRAVITY = 13.750371636040745654980191559621114395801712
"""(2*K)**2 with the complete elliptic integral K of modulus 1/sqrt(2): the period from the horizontal is 2 s."""


class PartialPendulum(Component):
    """A point mass on a circle of radius 1, as a DAE of index 3; subclasses define its start."""

    g: Real = parameter(default=GRAVITY, doc="Gravity")
    x: Real = variable(default=guess(1.0))
    y: Real = variable()
    vx: Real = variable()
    vy: Real = variable(default=fixed(0.0))
    lam: Real = variable(default=guess(0.0), doc="Tension of the rod per length")
    length2: Real = variable(doc="Square of the length, observed")
    energy: Real = variable(doc="Energy per mass, observed")

    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x", "y"), title="Position"), Panel(("energy",), title="Energy"))

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.lam * self.x
        yield der(self.vy) == -self.lam * self.y - self.g
        yield self.x**2 + self.y**2 == 1.0
        yield self.length2 == self.x**2 + self.y**2
        yield self.energy == 0.5 * (self.vx**2 + self.vy**2) + self.g * self.y


class PartialFromHorizontal(PartialPendulum):
    """Released at rest from (1, 0)."""

    def initial_equations(self) -> Equations:
        yield self.x == 1.0
        yield self.y == 0.0
        yield self.vx == 0.0


class PendulumDrift(PartialFromHorizontal):
    """Scene `drift`: 500 swings from the horizontal; back at (1, 0), at rest, at every even time."""

    experiment: ClassVar[Experiment] = Experiment(stop_time=1000.0, tolerance=1e-8, solver="rosenbrock")


class PendulumStaticState(PartialPendulum):
    """Scene `static-state`: from 0.3 rad below the horizontal; reduced to (y, vy) it stops at its lowest point."""

    phi0: Real = parameter(default=-0.3, doc="Start, angle above the horizontal")

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8, solver="rosenbrock")

    def initial_equations(self) -> Equations:
        yield self.x == cos(self.phi0)
        yield self.y == sin(self.phi0)
        yield self.vx == 0.0


class PendulumDirect(PartialFromHorizontal):
    """Scene `index3-direct`: one period; BDF on the equations as written fails at every tolerance."""

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8, solver="rosenbrock")


class PendulumInconsistent(PartialPendulum):
    """Scene `inconsistent`, part (a): a start at (1.01, 0), off the circle, is rejected."""

    x0: Real = parameter(default=1.01, doc="Start, horizontally")
    vx0: Real = parameter(default=0.0, doc="Speed at the start, along the rod")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8, solver="rosenbrock")

    def initial_equations(self) -> Equations:
        yield self.x == self.x0
        yield self.y == 0.0
        yield self.vx == self.vx0
