"""Van der Pol's oscillator, very stiff."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, variable


class VanDerPol(Component):
    """Relaxation oscillations: slow arcs and jumps of about 1/mu.

    Source: B. van der Pol (1926); problem `vdpolm` of the test set.
    """

    mu: Real = parameter(default=1000.0, min=0.0, doc="Strength of the nonlinear damping")
    y1: Real = variable(default=fixed(2.0))
    y2: Real = variable(default=fixed(0.0), nominal=1e-3)

    experiment: ClassVar[Experiment] = Experiment(stop_time=2000.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1",), title="Displacement"),)

    def equations(self) -> Equations:
        yield der(self.y1) == self.y2
        yield der(self.y2) == self.mu * (1 - self.y1**2) * self.y2 - self.y1
