"""One stiff component, on which some methods ring and others lose their order."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, cos, der, fixed, parameter, sin, time, variable


class Ringing(Component):
    """Scene `ringing`: y' = -1e6*(y - cos t) - sin t from y = 2; y = cos t after 0.1 ms."""

    rate: Real = parameter(default=1e6, doc="Rate of the decay")
    om: Real = parameter(default=1.0, unit="rad/s", doc="Frequency of the slow solution")
    y: Real = variable(default=fixed(2.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-6, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y",), title="Solution"),)

    def equations(self) -> Equations:
        yield der(self.y) == -self.rate * (self.y - cos(self.om * time)) - sin(self.om * time)


class OrderReduction(Component):
    """Scene `order-reduction`: y' = -1e6*(y - sin t) + cos t; y = sin t."""

    rate: Real = parameter(default=1e6, doc="Rate of the decay")
    om: Real = parameter(default=1.0, unit="rad/s", doc="Frequency of the slow solution")
    y: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-6, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("y",), title="Solution"),)

    def equations(self) -> Equations:
        yield der(self.y) == -self.rate * (self.y - sin(self.om * time)) + cos(self.om * time)
