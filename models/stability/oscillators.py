"""Oscillations that methods damp, amplify, or needlessly resolve."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, cos, der, fixed, parameter, sqrt, time, variable


class UndampedOscillator(Component):
    """Scene `undamped`: x'' = -x over 1000 periods; amplitude 1."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))
    amplitude: Real = variable(doc="Amplitude, observed")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2000.0 * math.pi, tolerance=1e-6, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("amplitude",), title="Amplitude"),)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.x
        yield self.amplitude == sqrt(self.x**2 + self.v**2)


class FastSlow(Component):
    """Scene `fast-slow`: x'' = -w**2*(x - cos t) - cos t from x = cos t, which remains the solution."""

    w: Real = parameter(default=1e4, doc="Frequency of the fast mode")
    om: Real = parameter(default=1.0, unit="rad/s", doc="Frequency of the slow solution")
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-6, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x",), title="Position"),)

    def equations(self) -> Equations:
        slow = cos(self.om * time)
        yield der(self.x) == self.v
        yield der(self.v) == -(self.w**2) * (self.x - slow) - slow
