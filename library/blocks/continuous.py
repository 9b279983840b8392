"""Blocks with states. Names and parameters as in Modelica.Blocks.Continuous.

A start value is given to the variable that is the state: `Integrator(y=1.0)`, `FirstOrder(T=0.1, y=fixed(2.0))`.
For a start in steady state the model yields `der(block.y) == 0` in `initial_equations`.
"""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    clamp,
    der,
    parameter,
    signal_input,
    signal_output,
    structural,
    variable,
)
from acausal.library.blocks.interfaces import PartialSISO


class Integrator(PartialSISO):
    """Integral of the input times `k`; the start value is that of `y`."""

    k: Real = parameter(default=1.0, doc="Gain of the integrator")

    def equations(self) -> Equations:
        yield der(self.y) == self.k * self.u


class Der(PartialSISO):
    """Exact derivative of the input: the compiler differentiates the equations that determine it."""

    def equations(self) -> Equations:
        yield self.y == der(self.u)


class Derivative(PartialSISO):
    """Approximate derivative k*s/(T*s + 1): a derivative with a first-order lag."""

    k: Real = parameter(default=1.0, doc="Gain")
    T: Real = parameter(default=0.01, unit="s", min=1e-60, doc="Time constant of the lag")
    x: Real = variable(doc="Lagged input")

    def equations(self) -> Equations:
        yield der(self.x) == (self.u - self.x) / self.T
        yield self.y == self.k * (self.u - self.x) / self.T


class FirstOrder(PartialSISO):
    """First-order lag k/(T*s + 1)."""

    k: Real = parameter(default=1.0, doc="Gain")
    T: Real = parameter(unit="s", min=1e-60, doc="Time constant")

    def equations(self) -> Equations:
        yield der(self.y) == (self.k * self.u - self.y) / self.T


class SecondOrder(PartialSISO):
    """Second-order lag k/((s/w)^2 + 2*D*(s/w) + 1)."""

    k: Real = parameter(default=1.0, doc="Gain")
    w: Real = parameter(unit="rad/s", min=0.0, doc="Angular frequency")
    D: Real = parameter(unit="1", min=0.0, doc="Damping ratio")
    yd: Real = variable(doc="Derivative of y")

    def equations(self) -> Equations:
        yield der(self.y) == self.yd
        yield der(self.yd) == self.w * (self.w * (self.k * self.u - self.y) - 2.0 * self.D * self.yd)


class PI(PartialSISO):
    """Proportional-integral controller k*(1 + 1/(T*s))."""

    k: Real = parameter(default=1.0, doc="Gain")
    T: Real = parameter(unit="s", min=1e-60, doc="Time constant of the integral part")
    x: Real = variable(doc="Integral of the input over T")

    def equations(self) -> Equations:
        yield der(self.x) == self.u / self.T
        yield self.y == self.k * (self.x + self.u)


class LimPID(Component):
    """P, PI, PD or PID controller with limited output, anti-windup compensation and set-point weighting.

    `y = limit(k*(wp*u_s - u_m + I + D))`. The part cut off by the limit is fed back to the integrator:
    `der(I) = (u_s - u_m + (y - y_unlimited)/(k*Ni))/Ti`. Source: Modelica.Blocks.Continuous.LimPID, after
    Åström and Hägglund, PID Controllers, 1995.
    """

    with_I: bool = structural(default=True, doc="True: with integral part")
    with_D: bool = structural(default=True, doc="True: with derivative part")
    u_s: Real = signal_input(doc="Set value")
    u_m: Real = signal_input(doc="Measured value")
    y: Real = signal_output(doc="Limited controller output")
    k: Real = parameter(default=1.0, doc="Gain of the controller")
    Ti: Real = parameter(default=0.5, unit="s", min=1e-60, doc="Time constant of the integral part")
    Td: Real = parameter(default=0.1, unit="s", min=1e-60, doc="Time constant of the derivative part")
    y_max: Real = parameter(doc="Upper limit of the output")
    y_min: Real = parameter(default=lambda self: -self.y_max, doc="Lower limit of the output")
    wp: Real = parameter(default=1.0, unit="1", min=0.0, doc="Set-point weight of the proportional part (0..1)")
    wd: Real = parameter(default=0.0, unit="1", min=0.0, doc="Set-point weight of the derivative part (0..1)")
    Ni: Real = parameter(default=0.9, unit="1", min=1e-60, doc="Ni*Ti is the time constant of the anti-windup feedback")
    Nd: Real = parameter(default=10.0, unit="1", min=1e-60, doc="The higher, the more ideal the derivative part")
    y_unlimited: Real = variable(doc="Controller output before the limit")
    I: Real = variable(doc="Integral part divided by k")  # noqa: E741
    D: Real = variable(doc="Derivative part divided by k")
    x_D: Real = variable(doc="Lagged input of the derivative part")

    def equations(self) -> Equations:
        yield self.y_unlimited == self.k * (self.wp * self.u_s - self.u_m + self.I + self.D)
        yield self.y == clamp(self.y_unlimited, self.y_min, self.y_max)
        yield assert_(self.y_min <= self.y_max, "the lower limit y_min is above the upper limit y_max")
        if self.with_I:
            yield der(self.I) == (self.u_s - self.u_m + (self.y - self.y_unlimited) / (self.k * self.Ni)) / self.Ti
        else:
            yield self.I == 0.0
        if self.with_D:
            error = self.wd * self.u_s - self.u_m
            yield der(self.x_D) == (error - self.x_D) * self.Nd / self.Td
            yield self.D == self.Nd * (error - self.x_D)
        else:
            yield self.D == 0.0
            yield self.x_D == 0.0
