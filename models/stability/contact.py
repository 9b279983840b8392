"""One body hitting a wall: explicit steps on a stiff spring, and two laws of impact."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, der, fixed, parameter, sqrt, variable, where


class ExplicitPenalty(Component):
    """Scene `explicit-penalty`: m*s'' = -k*s - d*s' with d = 2*zeta*sqrt(k*m); the stiff contact of a drill.

    Largest stable steps: Euler 2*zeta/omega for zeta < 1; RK2 2/|lambda| and RK4 2.785/|lambda| on the real axis.
    """

    m: Real = parameter(default=10.0, unit="kg", min=0.0, doc="Mass")
    k: Real = parameter(default=1e8, unit="N/m", min=0.0, doc="Stiffness")
    zeta: Real = parameter(default=1.0, unit="1", min=0.0, doc="Damping ratio")
    s: Real = variable(default=fixed(1e-5), unit="m", nominal=1e-5, doc="Penetration")
    v: Real = variable(default=fixed(0.0), unit="m/s", nominal=1e-2, doc="Its rate")

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("s",), title="Penetration"),)

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        d = 2.0 * self.zeta * sqrt(self.k * self.m)
        yield self.m * der(self.v) == -self.k * self.s - d * self.v


class PartialImpact(Component):
    """A free body hits a wall at s = 0 with speed `v0`; subclasses define the force of the wall."""

    m: Real = parameter(default=1.0, unit="kg", min=0.0, doc="Mass")
    k: Real = parameter(default=1e5, unit="N/m", min=0.0, doc="Stiffness")
    v0: Real = parameter(default=1.0, unit="m/s", doc="Speed before the impact")
    gap: Real = parameter(default=1e-3, unit="m", min=0.0, doc="Distance at the start")
    s: Real = variable(unit="m", nominal=1e-3, doc="Penetration")
    v: Real = variable(unit="m/s", doc="Its rate")
    f: Real = variable(unit="N", nominal=100.0, doc="Force of the wall")

    figure: ClassVar[tuple[Panel, ...]] = (Panel(("s",), title="Penetration"), Panel(("f",), title="Force"))

    def equations(self) -> Equations:
        yield der(self.s) == self.v
        yield self.m * der(self.v) == -self.f

    def initial_equations(self) -> Equations:
        yield self.s == -self.gap
        yield self.v == self.v0


class KelvinVoigtImpact(PartialImpact):
    """Scene `kv-tension`: spring and damper that only push; the plain law would pull before release.

    Restitution 0.858758, 0.571740, 0.298436 for zeta = 0.05, 0.2, 0.5; release 9.6303, 8.8397, 7.6476 ms after touch.
    """

    zeta: Real = parameter(default=0.2, unit="1", min=0.0, doc="Damping ratio")

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.02, tolerance=1e-8, solver="rosenbrock")

    def equations(self) -> Equations:
        d = 2.0 * self.zeta * sqrt(self.k * self.m)
        plain = self.k * self.s + d * self.v
        # Two relations, so that touch and release are both events.
        yield self.f == where((self.s > 0.0) & (plain > 0.0), plain, 0.0)


class HuntCrossleyImpact(PartialImpact):
    """Scene `hunt-crossley`: f = k*s*(1 + a*s'); the force is smooth at touch, and no method fails.

    The rebound speed u solves v0/a - ln(1 + a*v0)/a**2 = -u/a - ln(1 - a*u)/a**2, independently of m and k.
    """

    a: Real = parameter(default=0.5, unit="s/m", min=0.0, doc="Damping per stiffness")

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.02, tolerance=1e-8, solver="erk")

    def equations(self) -> Equations:
        yield self.f == where(self.s > 0.0, self.k * self.s * (1.0 + self.a * self.v), 0.0)
