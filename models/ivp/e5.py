"""Problem E5: a pyrolysis whose right-hand sides nearly cancel."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, variable


class E5(Component):
    """Four chemical species; the sum of three balances keeps y2 - y3 - y4 constant.

    Source: W. H. Enright, T. E. Hull, B. Lindberg, BIT 15 (1975), problem E5; problem `E5` of the test set. Integrating
    all four balances loses y2 - y3 to rounding errors; the invariant has to be used instead of one of them.
    """

    A: Real = parameter(default=7.89e-10)
    B: Real = parameter(default=1.1e7)
    C: Real = parameter(default=1.13e3)
    M: Real = parameter(default=1e6)
    y1: Real = variable(default=fixed(1.76e-3), nominal=1e-19)
    y2: Real = variable(default=fixed(0.0), nominal=1e-19)
    y3: Real = variable(default=fixed(0.0), nominal=1e-19)
    y4: Real = variable(default=fixed(0.0), nominal=1e-19)

    experiment: ClassVar[Experiment] = Experiment(stop_time=1e13, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1", "y2", "y3", "y4"), title="Concentrations"),)

    def equations(self) -> Equations:
        y1, y2, y3, y4 = self.y1, self.y2, self.y3, self.y4
        yield der(y1) == -self.A * y1 - self.B * y1 * y3
        yield der(y2) == self.A * y1 - self.M * self.C * y2 * y3
        yield der(y3) == self.A * y1 - self.B * y1 * y3 - self.M * self.C * y2 * y3 + self.C * y4
        yield der(y4) == self.B * y1 * y3 - self.C * y4
