"""A model with a kink between two phases."""

from __future__ import annotations

from acausal import Component, Equations, Real, der, fixed, maximum, quantity, signal_input, variable


class Kinked(Component):
    """A position that is moved, and a way that grows beyond half a metre only."""

    u: Real = signal_input(unit="m/s", min=-1.0, max=1.0, default=0.6, doc="Velocity")
    x: Real = variable(unit="m", default=fixed(0.0), doc="Position")
    y: Real = variable(unit="m.s", default=fixed(0.0), doc="Integral of what is beyond")

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield der(self.y) == maximum(self.x - quantity(0.5, "m"), 0.0)
