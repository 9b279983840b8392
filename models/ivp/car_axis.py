"""A car axle on a bumpy road, written with stiff springs and a constraint that depends on time."""

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
    guess,
    parameter,
    sin,
    sqrt,
    time,
    variable,
)


class CarAxis(Component):
    """Left wheel on a flat road, right wheel on a sine; a DAE of index 3.

    Source: S. Schneider (1994); problem `caraxis` of the test set.
    """

    M: Real = parameter(default=10.0, doc="Mass")
    eps: Real = parameter(default=1e-2, doc="Square root of the inverse stiffness, in effect")
    L: Real = parameter(default=1.0, doc="Length of the axle")
    L0: Real = parameter(default=0.5, doc="Free length of the springs")
    r: Real = parameter(default=0.1, doc="Height of the bumps")
    w: Real = parameter(default=10.0, doc="Frequency of the bumps")
    g: Real = parameter(default=1.0, doc="Gravity")
    xl: Real = variable(default=fixed(0.0), nominal=0.1)
    yl: Real = variable(default=fixed(0.5))
    xr: Real = variable(default=fixed(1.0))
    yr: Real = variable(default=fixed(0.5))
    vxl: Real = variable(default=fixed(-0.5))
    vyl: Real = variable(default=fixed(0.0))
    vxr: Real = variable(default=fixed(-0.5))
    vyr: Real = variable(default=fixed(0.0))
    lam1: Real = variable(default=guess(0.0), nominal=1e-3)
    lam2: Real = variable(default=guess(0.0), nominal=1e-3)
    yb: Real = variable(doc="Height of the right wheel's contact")
    xb: Real = variable(doc="Position of the right wheel's contact")
    Ll: Real = variable(doc="Length of the left spring")
    Lr: Real = variable(doc="Length of the right spring")

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("yl", "yr"), title="Height of the axle's ends"),)

    def equations(self) -> Equations:
        xl, yl, xr, yr, xb, yb = self.xl, self.yl, self.xr, self.yr, self.xb, self.yb
        K = self.M * self.eps**2 / 2
        yield yb == self.r * sin(self.w * time)
        yield xb == sqrt(self.L**2 - yb**2)
        yield self.Ll == sqrt(xl**2 + yl**2)
        yield self.Lr == sqrt((xr - xb) ** 2 + (yr - yb) ** 2)
        yield der(xl) == self.vxl
        yield der(yl) == self.vyl
        yield der(xr) == self.vxr
        yield der(yr) == self.vyr
        left = (self.L0 - self.Ll) / self.Ll
        right = (self.L0 - self.Lr) / self.Lr
        yield K * der(self.vxl) == left * xl + self.lam1 * xb + 2 * self.lam2 * (xl - xr)
        yield K * der(self.vyl) == left * yl + self.lam1 * yb + 2 * self.lam2 * (yl - yr) - K * self.g
        yield K * der(self.vxr) == right * (xr - xb) - 2 * self.lam2 * (xl - xr)
        yield K * der(self.vyr) == right * (yr - yb) - 2 * self.lam2 * (yl - yr) - K * self.g
        yield xb * xl + yb * yl == 0
        yield (xl - xr) ** 2 + (yl - yr) ** 2 - self.L**2 == 0
