"""A model whose members are known in closed form, and fail where they are told to."""

from __future__ import annotations

from acausal import Component, Equations, Real, assert_, der, parameter, structural, terminate, variable, when


class Decay(Component):
    """x' = -k x from x = a: x = a exp(-k t); it fails above its limit and ends below its floor."""

    k: Real = parameter(default=1.0, unit="1/s", doc="Rate")
    a: Real = parameter(default=1.0, unit="m", doc="Start")
    half: Real = parameter(default=0.5, doc="Half of a number")
    limit: Real = parameter(default=5.0, unit="m")
    floor: Real = parameter(default=0.0, unit="m")
    n: int = structural(default=1)
    x: Real = variable(unit="m", doc="Length.")
    y: Real = variable(unit="m", doc="Its double")

    def initial_equations(self) -> Equations:
        yield self.x == self.a

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x
        yield self.y == 2.0 * self.x
        yield assert_(self.x < self.limit, "it is too long")
        yield when(self.x < self.floor, terminate("it is short"))
