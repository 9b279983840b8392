"""Right-hand sides that switch: infinitely many bounces, dry friction, a short pulse, bang-bang."""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    der,
    fixed,
    parameter,
    reset,
    sign,
    time,
    variable,
    when,
    where,
)


class ZenoBall(Component):
    """Scene `zeno`: a ball whose bounces accumulate; at rest from t = 4.0637127688715781401 s on."""

    g: Real = parameter(default=9.81, unit="m/s2", doc="Gravity")
    e: Real = parameter(default=0.8, unit="1", min=0.0, max=1.0, doc="Restitution")
    h: Real = variable(default=fixed(1.0), unit="m", doc="Height")
    v: Real = variable(default=fixed(0.0), unit="m/s", doc="Velocity, upwards")

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("h",), title="Height"),)

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -self.g
        yield when(self.h <= 0.0, reset(self.v, -self.e * self.v))


class FrictionStop(Component):
    """Scene `friction-stop`: x'' = 3 - 5*sign(x'); stops at t = 0.5, x = 0.25, and sticks."""

    x: Real = variable(default=fixed(0.0))
    v: Real = variable(default=fixed(1.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=100.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x", "v"), title="Motion"),)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == 3.0 - 5.0 * sign(self.v)


class MissedPulse(Component):
    """Scene `missed-pulse`: x' = 1 for 10 ms in 10 s; x(10) = 0.01."""

    begin: Real = parameter(default=5.0, unit="s", doc="Start of the pulse")
    length: Real = parameter(default=0.01, unit="s", doc="Length of the pulse")
    x: Real = variable(default=fixed(0.0))
    y: Real = variable(default=fixed(0.0), doc="x with a lag of 1 s, so that a solver has something to step over")

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-6, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x", "y"), title="The pulse's integral"),)

    def equations(self) -> Equations:
        yield der(self.x) == where(time < self.begin, 0.0, where(time < self.begin + self.length, 1.0, 0.0))
        yield der(self.y) == self.x - self.y


class BangBang(Component):
    """Scene `bang-bang`: x'' = -sign(x) from (1, 0); period 4*sqrt(2)."""

    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=40.0 * 2.0**0.5, tolerance=1e-8, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("x", "v"), title="Motion"),)

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -sign(self.x)
