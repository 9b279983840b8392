"""The chemical problem of Akzo Nobel: five balances and one equilibrium."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, guess, parameter, sqrt, variable


class ChemicalAkzoNobel(Component):
    """Two species are mixed while carbon dioxide is added; a DAE of index 1.

    Source: problem `chemakzo` of the test set, from Akzo Nobel Central Research.
    """

    k1: Real = parameter(default=18.7)
    k2: Real = parameter(default=0.58)
    k3: Real = parameter(default=0.09)
    k4: Real = parameter(default=0.42)
    K: Real = parameter(default=34.4, doc="Equilibrium constant")
    klA: Real = parameter(default=3.3, doc="Mass transfer coefficient")
    Ks: Real = parameter(default=115.83, doc="Equilibrium constant of the complex")
    pCO2: Real = parameter(default=0.9, doc="Partial pressure of carbon dioxide")
    H: Real = parameter(default=737.0, doc="Henry's constant")
    y1: Real = variable(default=fixed(0.444), nominal=0.1)
    y2: Real = variable(default=fixed(0.00123), nominal=1e-3)
    y3: Real = variable(default=fixed(0.0), nominal=0.1)
    y4: Real = variable(default=fixed(0.007), nominal=1e-3)
    y5: Real = variable(default=fixed(0.0), nominal=0.01)
    y6: Real = variable(default=guess(0.36), nominal=0.01)
    r1: Real = variable()
    r2: Real = variable()
    r3: Real = variable()
    r4: Real = variable()
    r5: Real = variable()
    Fin: Real = variable(doc="Inflow of carbon dioxide")

    experiment: ClassVar[Experiment] = Experiment(stop_time=180.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1", "y3", "y6"), title="Concentrations"),)

    def equations(self) -> Equations:
        y1, y2, y3, y4, y5, y6 = self.y1, self.y2, self.y3, self.y4, self.y5, self.y6
        yield self.r1 == self.k1 * y1**4 * sqrt(y2)
        yield self.r2 == self.k2 * y3 * y4
        yield self.r3 == self.k2 / self.K * y1 * y5
        yield self.r4 == self.k3 * y1 * y4**2
        yield self.r5 == self.k4 * y6**2 * sqrt(y2)
        yield self.Fin == self.klA * (self.pCO2 / self.H - y2)
        yield der(y1) == -2 * self.r1 + self.r2 - self.r3 - self.r4
        yield der(y2) == -0.5 * self.r1 - self.r4 - 0.5 * self.r5 + self.Fin
        yield der(y3) == self.r1 - self.r2 + self.r3
        yield der(y4) == -self.r2 + self.r3 - 2 * self.r4
        yield der(y5) == self.r2 - self.r3 + self.r5
        yield self.Ks * y1 * y4 - y6 == 0
