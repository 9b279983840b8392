"""The Oregonator: the Belousov-Zhabotinskii reaction in three variables."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, variable


class Oregonator(Component):
    """A limit cycle with changes over many orders of magnitude.

    Source: R. J. Field, R. M. Noyes, J. Chem. Phys. 60 (1974); problem `orego` of the test set.
    """

    s: Real = parameter(default=77.27)
    q: Real = parameter(default=8.375e-6)
    w: Real = parameter(default=0.161)
    y1: Real = variable(default=fixed(1.0), doc="HBrO2")
    y2: Real = variable(default=fixed(2.0), doc="Br-")
    y3: Real = variable(default=fixed(3.0), doc="Ce(IV)")

    experiment: ClassVar[Experiment] = Experiment(stop_time=360.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1", "y2", "y3"), title="Concentrations"),)

    def equations(self) -> Equations:
        yield der(self.y1) == self.s * (self.y2 + self.y1 - self.y1 * self.y2 - self.q * self.y1**2)
        yield der(self.y2) == (self.y3 - (1 + self.y1) * self.y2) / self.s
        yield der(self.y3) == self.w * (self.y1 - self.y3)
