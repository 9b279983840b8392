"""The drilling force without its frames: the power law at zero feed, wind-up in free air, the compliant scene."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Panel,
    Real,
    der,
    fixed,
    maximum,
    parameter,
    sin,
    sqrt,
    structural,
    time,
    variable,
    where,
)

EDGES = 2
SPEED = 9.28
"""Rotation of the drill [1/s]."""
POINT = math.radians(118.0)
K = 0.008 * 2240e6 * (1e3 * math.sin(0.5 * POINT)) ** -0.21
"""Cutting force per edge and feed**0.79 [N/m**0.79]: k_c1.1 = 2240 N/mm2, d = 16 mm, z = 0.21, sigma = 118 degrees."""
THRUST = EDGES * math.sin(POINT) * K
"""Feed force per feed**0.79."""


class PowerLaw(Component):
    """Scene `power-law`: the feed under a force that changes its sign, f = (F/K)**(1/(1 - z)).

    With `inverted=False` it is F = K*f**(1 - z) as usually printed, whose slope at zero feed is infinite.
    """

    inverted: bool = structural(default=True, doc="Feed as a function of the force, instead of the reverse")
    m: Real = parameter(default=10.0, doc="Mass of the drill, if the force follows the feed")
    force: Real = parameter(default=4881.341711, doc="Amplitude of the force")
    rate: Real = parameter(default=2.0 * math.pi, unit="rad/s", doc="Frequency of the force")
    F: Real = variable(nominal=1e3, doc="Feed force")
    f: Real = variable(nominal=1e-4, doc="Feed per edge")
    s: Real = variable(default=fixed(0.0), nominal=1e-3, doc="Depth")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("f",), title="Feed"), Panel(("s",), title="Depth"))

    def equations(self) -> Equations:
        yield der(self.s) == EDGES * SPEED * self.f
        if self.inverted:
            yield self.F == self.force * sin(self.rate * time)
            yield self.f == (maximum(self.F, 0.0) / THRUST) ** (1.0 / 0.79)
        else:
            yield self.F == THRUST * self.f**0.79
            yield self.m * EDGES * SPEED * der(self.f) == self.force - self.F

    def initial_equations(self) -> Equations:
        if not self.inverted:
            yield self.f == 0.0


class PartialCompliantDrill(Component):
    """A drill on a spring and damper that only push, following a target depth that grows with the force.

    m*s'' = F(t) - F_N; s_tar' = zE*n*(F_N/(zE*sin(118 deg)*K))**(1/0.79).
    """

    m: Real = parameter(default=10.0, unit="kg", min=0.0, doc="Mass")
    k: Real = parameter(default=1e7, unit="N/m", min=0.0, doc="Stiffness of the contact")
    zeta: Real = parameter(default=1.0, unit="1", min=0.0, doc="Damping ratio of the contact")
    s: Real = variable(unit="m", nominal=1e-2, doc="Depth")
    v: Real = variable(unit="m/s", nominal=1e-2, doc="Its rate")
    s_tar: Real = variable(default=fixed(0.0), unit="m", nominal=1e-2, doc="Depth of the hole")
    F: Real = variable(unit="N", nominal=1e3, doc="Force on the drill")
    F_N: Real = variable(unit="N", nominal=1e3, doc="Force of the contact")
    one_newton: Real = parameter(default=1.0, unit="N")
    one_metre_per_second: Real = parameter(default=1.0, unit="m/s")

    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("s", "s_tar"), title="Depth", unit="mm"),
        Panel(("F", "F_N"), title="Force"),
    )

    def equations(self) -> Equations:
        d = 2.0 * self.zeta * sqrt(self.k * self.m)
        pressed = maximum(self.k * (self.s - self.s_tar) + d * self.v, 0.0)
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.F - self.F_N
        yield self.F_N == where(self.s > self.s_tar, pressed, 0.0)
        feed = (self.F_N / self.one_newton / THRUST) ** (1.0 / 0.79)
        yield der(self.s_tar) == EDGES * SPEED * feed * self.one_metre_per_second


class DrillDynamic(PartialCompliantDrill):
    """Scenes `drill-dynamic` and `abstol`: 50 N rising to 4881 N in 1 s, held to 8 s, down to 20 N at 8.5 s.

    s(10) = 1.284243480e-2, 1.282439797e-2, 1.282259563e-2 m for k = 1e6, 1e7, 1e8 N/m with m = 10 kg, zeta = 1.
    """

    one_second: Real = parameter(default=1.0, unit="s")

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8, solver="rosenbrock")

    def equations(self) -> Equations:
        t = time / self.one_second
        full = 4881.341711
        rising = 50.0 + (full - 50.0) * t
        falling = full + (20.0 - full) * (t - 8.0) / 0.5
        first = where(time < self.one_second, rising, full)
        last = where(time < 8.5 * self.one_second, falling, 20.0)
        yield self.F == self.one_newton * where(time < 8.0 * self.one_second, first, last)

    def initial_equations(self) -> Equations:
        yield self.s == 0.0
        yield self.v == 0.0


class WindUp(PartialCompliantDrill):
    """Scene `wind-up`: the drill approaches in free air at 50 mm/s, drills, and retracts.

    The damper alone would feed the target depth by 0.22 mm/s in the air.
    """

    one_second: Real = parameter(default=1.0, unit="s")
    gap: Real = parameter(default=5e-3, unit="m", doc="Distance to the work at the start")
    approach: Real = parameter(default=0.05, unit="m/s", doc="Speed of the approach")

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.0, tolerance=1e-8, solver="rosenbrock")

    def equations(self) -> Equations:
        pushing = where(time < 0.1 * self.one_second, 0.0, 1000.0)
        yield self.F == self.one_newton * where(time < 0.5 * self.one_second, pushing, -20.0)

    def initial_equations(self) -> Equations:
        yield self.s == -self.gap
        yield self.v == self.approach
