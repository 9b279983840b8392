"""Attitude of a turning body: Cardan angles through 90 degrees, a rotation matrix, a quaternion."""

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
    dot,
    fixed,
    guess,
    parameter,
    sin,
    skew,
    tan,
    variable,
)

_RATE = math.pi / math.sqrt(2.0)
_UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class GimbalAngles(Component):
    """Scene `gimbal`, failing form: x-y-z angles at a constant body rate pi*(1, 0, 1)/sqrt(2); 90 degrees at t = 1."""

    rate: Real = parameter(default=_RATE, doc="Body rate about x and about z")
    a: Real = variable(default=fixed(0.0), doc="About x")
    b: Real = variable(default=fixed(0.0), doc="About y")
    c: Real = variable(default=fixed(0.0), doc="About z")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("a", "b", "c"), title="Angles"),)

    def equations(self) -> Equations:
        w = self.rate
        yield der(self.a) == w * cos(self.c) / cos(self.b)
        yield der(self.b) == w * sin(self.c)
        yield der(self.c) == w - w * cos(self.c) * tan(self.b)


class GimbalMatrix(Component):
    """Scene `gimbal`, in the form used by frames: the rotation matrix is integrated; R(2) is the identity."""

    rate: Real = parameter(default=_RATE, doc="Body rate about x and about z")
    R: Real = variable(default=fixed(_UNIT), shape=(3, 3))
    w: Real = variable(shape=3, doc="Body rate")

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0, tolerance=1e-8, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("R[0,0]", "R[1,1]", "R[2,2]"), title="Diagonal of the rotation"),)

    def equations(self) -> Equations:
        yield self.w[0] == self.rate
        yield self.w[1] == 0.0
        yield self.w[2] == self.rate
        yield der(self.R) == self.R @ skew(self.w)


class QuaternionDrift(Component):
    """Scene `quaternion-drift`: 10 rad/s about (1, 2, 3)/sqrt(14), with the norm kept as a constraint."""

    rate: Real = parameter(default=10.0 / math.sqrt(14.0), doc="Turn rate per unit of (1, 2, 3)")
    s: Real = variable(default=fixed(1.0), doc="Scalar part")
    q: Real = variable(default=fixed((0.0, 0.0, 0.0)), shape=3, doc="Vector part")
    mu: Real = variable(default=guess(0.0), doc="Multiplier that keeps the norm; 0 except for errors")

    experiment: ClassVar[Experiment] = Experiment(stop_time=1000.0, tolerance=1e-6, solver="erk")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("s",), title="Scalar part"),)

    def equations(self) -> Equations:
        x, y, z = self.q[0], self.q[1], self.q[2]
        a, b, c = self.rate, 2.0 * self.rate, 3.0 * self.rate
        yield der(self.s) == -0.5 * (a * x + b * y + c * z) + self.mu * self.s
        yield der(x) == 0.5 * (a * self.s + c * y - b * z) + self.mu * x
        yield der(y) == 0.5 * (b * self.s + a * z - c * x) + self.mu * y
        yield der(z) == 0.5 * (c * self.s + b * x - a * y) + self.mu * z
        yield self.s**2 + dot(self.q, self.q) == 1.0
