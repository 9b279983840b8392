"""A ring modulator with stray capacitances: fast oscillations that are hardly damped."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Expr, Panel, Real, der, exp, fixed, parameter, sin, time, variable


class RingModulator(Component):
    """Mixes a 1 kHz signal with a 10 kHz carrier; capacitances of 2 pF make it ring at 1e9 rad/s.

    Source: E. H. Horneber (1976); problem `ringmod` of the test set. y1 ... y7 are voltages, y8 ... y15 currents.
    """

    C: Real = parameter(default=1.6e-8, unit="F")
    Cs: Real = parameter(default=2e-12, unit="F", doc="Stray capacitance")
    Cp: Real = parameter(default=1e-8, unit="F")
    R: Real = parameter(default=25e3, unit="Ohm")
    Rp: Real = parameter(default=50.0, unit="Ohm")
    Lh: Real = parameter(default=4.45, unit="H")
    Ls1: Real = parameter(default=2e-3, unit="H")
    Ls2: Real = parameter(default=5e-4, unit="H")
    Ls3: Real = parameter(default=5e-4, unit="H")
    Rg1: Real = parameter(default=36.3, unit="Ohm")
    Rg2: Real = parameter(default=17.3, unit="Ohm")
    Rg3: Real = parameter(default=17.3, unit="Ohm")
    Ri: Real = parameter(default=50.0, unit="Ohm")
    Rc: Real = parameter(default=600.0, unit="Ohm")
    gamma: Real = parameter(default=40.67286402e-9, unit="A", doc="Saturation current of a diode")
    delta: Real = parameter(default=17.7493332, unit="1/V")
    y1: Real = variable(default=fixed(0.0), unit="V", nominal=0.1)
    y2: Real = variable(default=fixed(0.0), unit="V", nominal=0.1)
    y3: Real = variable(default=fixed(0.0), unit="V")
    y4: Real = variable(default=fixed(0.0), unit="V")
    y5: Real = variable(default=fixed(0.0), unit="V")
    y6: Real = variable(default=fixed(0.0), unit="V")
    y7: Real = variable(default=fixed(0.0), unit="V")
    y8: Real = variable(default=fixed(0.0), unit="A", nominal=1e-4)
    y9: Real = variable(default=fixed(0.0), unit="A", nominal=1e-4)
    y10: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    y11: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    y12: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    y13: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    y14: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    y15: Real = variable(default=fixed(0.0), unit="A", nominal=1e-2)
    u1: Real = variable(unit="V", doc="Signal")
    u2: Real = variable(unit="V", doc="Carrier")
    q1: Real = variable(unit="A", doc="Current of the first diode")
    q2: Real = variable(unit="A")
    q3: Real = variable(unit="A")
    q4: Real = variable(unit="A")

    experiment: ClassVar[Experiment] = Experiment(stop_time=1e-3, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y1", "y2"), title="Voltages"),)

    def equations(self) -> Equations:
        yield self.u1 == 0.5 * sin(2000 * math.pi * time)
        yield self.u2 == 2 * sin(20000 * math.pi * time)
        yield from self._diodes()
        yield from self._voltages()
        yield from self._currents()

    def _diode(self, u: Expr) -> Expr:
        return self.gamma * (exp(self.delta * u) - 1)

    def _diodes(self) -> Equations:
        y3, y4, y5, y6, y7, u2 = self.y3, self.y4, self.y5, self.y6, self.y7, self.u2
        yield self.q1 == self._diode(y3 - y5 - y7 - u2)
        yield self.q2 == self._diode(-y4 + y6 - y7 - u2)
        yield self.q3 == self._diode(y4 + y5 + y7 + u2)
        yield self.q4 == self._diode(-y3 - y6 + y7 + u2)

    def _voltages(self) -> Equations:
        yield self.C * der(self.y1) == self.y8 - 0.5 * self.y10 + 0.5 * self.y11 + self.y14 - self.y1 / self.R
        yield self.C * der(self.y2) == self.y9 - 0.5 * self.y12 + 0.5 * self.y13 + self.y15 - self.y2 / self.R
        yield self.Cs * der(self.y3) == self.y10 - self.q1 + self.q4
        yield self.Cs * der(self.y4) == -self.y11 + self.q2 - self.q3
        yield self.Cs * der(self.y5) == self.y12 + self.q1 - self.q3
        yield self.Cs * der(self.y6) == -self.y13 - self.q2 + self.q4
        yield self.Cp * der(self.y7) == -self.y7 / self.Rp + self.q1 + self.q2 - self.q3 - self.q4

    def _currents(self) -> Equations:
        yield self.Lh * der(self.y8) == -self.y1
        yield self.Lh * der(self.y9) == -self.y2
        yield self.Ls2 * der(self.y10) == 0.5 * self.y1 - self.y3 - self.Rg2 * self.y10
        yield self.Ls3 * der(self.y11) == -0.5 * self.y1 + self.y4 - self.Rg3 * self.y11
        yield self.Ls2 * der(self.y12) == 0.5 * self.y2 - self.y5 - self.Rg2 * self.y12
        yield self.Ls3 * der(self.y13) == -0.5 * self.y2 + self.y6 - self.Rg3 * self.y13
        yield self.Ls1 * der(self.y14) == -self.y1 + self.u1 - (self.Ri + self.Rg1) * self.y14
        yield self.Ls1 * der(self.y15) == -self.y2 - (self.Rc + self.Rg1) * self.y15
