"""Algebraic equations that need care: a poor guess, a linkage through its change point."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    cos,
    der,
    exp,
    fixed,
    guess,
    parameter,
    quantity,
    sin,
    time,
    variable,
)


class DiodeStart(Component):
    """Scene `inconsistent`, part (b): a diode in series with 1 kOhm; v = 0.69249037522418502165 V from any guess."""

    supply: Real = parameter(default=5.0, unit="V", doc="Supply")
    v_T: Real = parameter(default=0.02585, unit="V", doc="Thermal voltage")
    v: Real = variable(default=guess(5.0), unit="V", doc="Voltage across the diode")
    q: Real = variable(default=fixed(0.0), unit="V.s", doc="Its integral")

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-6, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("v",), title="Voltage"),)

    def equations(self) -> Equations:
        yield (self.supply - self.v) / quantity(1.0, "kOhm") == quantity(1e-14, "A") * (exp(self.v / self.v_T) - 1.0)
        yield der(self.q) == self.v


class ChangePoint(Component):
    """Scene `change-point`: a parallelogram linkage driven through the position in which it can fold.

    p = 0 and q = th for all th; the other branch is the antiparallelogram.
    """

    rate: Real = parameter(default=1.0, unit="rad/s", doc="Rate of the crank")
    th: Real = variable(default=fixed(0.5 * math.pi), doc="Crank")
    p: Real = variable(default=guess(0.0), doc="Coupler")
    q: Real = variable(default=guess(0.5 * math.pi), doc="Rocker")

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0 * math.pi, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("th", "p", "q"), title="Angles"),)

    def equations(self) -> Equations:
        yield self.th == 0.5 * math.pi + self.rate * time
        yield cos(self.th) + 2.0 * cos(self.p) - cos(self.q) - 2.0 == 0.0
        yield sin(self.th) + 2.0 * sin(self.p) - sin(self.q) == 0.0
