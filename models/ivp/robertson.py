"""Robertson's reaction: eleven decades of time, components down to 1e-13."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, guess, parameter, structural, variable


class Robertson(Component):
    """Three species, one slow and two fast reactions.

    Source: H. H. Robertson, The solution of a set of reaction rate equations (1966); problem `rober` of the test set.
    With `conserved` the last balance is replaced by the sum of the masses, which makes it a DAE of index 1.
    """

    conserved: bool = structural(default=False, doc="y1 + y2 + y3 = 1 instead of the balance of y3")
    k1: Real = parameter(default=0.04, doc="Rate constant of the slow reaction")
    k2: Real = parameter(default=3e7, doc="Rate constant of the very fast reaction")
    k3: Real = parameter(default=1e4, doc="Rate constant of the fast reaction")
    y1: Real = variable(default=fixed(1.0), nominal=1e-6)
    y2: Real = variable(default=fixed(0.0), nominal=1e-11)
    y3: Real = variable(default=guess(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1e11, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1", "y3"), title="Fractions"), Panel(("y2",), title="Intermediate"))

    def equations(self) -> Equations:
        yield der(self.y1) == -self.k1 * self.y1 + self.k3 * self.y2 * self.y3
        yield der(self.y2) == self.k1 * self.y1 - self.k2 * self.y2**2 - self.k3 * self.y2 * self.y3
        if self.conserved:
            yield self.y1 + self.y2 + self.y3 == 1.0
        else:
            yield der(self.y3) == self.k2 * self.y2**2

    def initial_equations(self) -> Equations:
        if not self.conserved:
            yield self.y3 == 0.0
