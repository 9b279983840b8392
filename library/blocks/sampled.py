"""Sampled blocks, which act only at the ticks of a clock. Names as in Modelica.Blocks.Discrete.

The outputs are held between the ticks `start_time + k*sample_period`, which are time events, located exactly.
"""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Expr,
    Real,
    assert_,
    boolean_input,
    clamp,
    discrete,
    edge,
    fixed,
    integer,
    no_event,
    parameter,
    pre,
    reset,
    sample,
    signal_input,
    signal_output,
    time,
    when,
    where,
)
from acausal.library.blocks.interfaces import PartialSISO


class PartialDiscrete(Component):
    """Block with a clock, the base of all sampled blocks."""

    sample_period: Real = parameter(default=0.1, unit="s", min=1e-60, doc="Time from one tick to the next")
    start_time: Real = parameter(default=0.0, unit="s", doc="First tick")

    def tick(self) -> Expr:
        """True at the ticks."""
        return sample(self.start_time, self.sample_period)


class PartialDiscreteSISO(PartialDiscrete, PartialSISO):
    """Sampled block with one input and one output."""


class Sampler(PartialDiscreteSISO):
    """The input at the last tick; 0 before the first tick."""

    held: Real = discrete(doc="Input at the last tick")

    def equations(self) -> Equations:
        yield when(self.tick(), reset(self.held, self.u))
        yield self.y == self.held


class ZeroOrderHold(PartialDiscreteSISO):
    """The input at the last tick, held; 0 before the first tick."""

    y_sample: Real = discrete(doc="Input at the last tick")

    def equations(self) -> Equations:
        yield when(self.tick(), reset(self.y_sample, self.u))
        yield self.y == self.y_sample


class FirstOrderHold(PartialDiscreteSISO):
    """First-order hold: extrapolates the line through the inputs at the last two ticks."""

    t_sample: Real = discrete(unit="s", doc="Time of the last tick")
    u_sample: Real = discrete(doc="Input at the last tick")
    c: Real = discrete(doc="Slope of the line")
    ticks: Real = integer(doc="Number of ticks so far")

    def equations(self) -> Equations:
        rise = (self.u - pre(self.u_sample)) / self.sample_period
        yield when(
            self.tick(),
            reset(self.t_sample, time),
            reset(self.u_sample, self.u),
            reset(self.c, where(pre(self.ticks) > 0.5, rise, 0.0)),
            reset(self.ticks, pre(self.ticks) + 1),
        )
        yield self.y == self.u_sample + self.c * (time - self.t_sample)


class UnitDelay(PartialDiscreteSISO):
    """Unit delay 1/z: the input at the tick before the last one; `y_start` until there is one."""

    y_start: Real = parameter(default=0.0, doc="Output until the second tick")
    u_last: Real = discrete(doc="Input at the last tick")
    y_held: Real = discrete(doc="Output")

    def build(self) -> None:
        self.u_last = fixed(self.y_start)
        self.y_held = fixed(self.y_start)

    def equations(self) -> Equations:
        yield when(self.tick(), reset(self.u_last, self.u), reset(self.y_held, pre(self.u_last)))
        yield self.y == self.y_held


class TriggeredSampler(PartialSISO):
    """The input when `trigger` last became true; `y_start` until it does."""

    trigger: Real = boolean_input(doc="Takes a sample when it becomes true")
    y_start: Real = parameter(default=0.0, doc="Output until the first trigger")
    held: Real = discrete(doc="Input at the last trigger")

    def build(self) -> None:
        self.held = fixed(self.y_start)

    def equations(self) -> Equations:
        yield when(edge(self.trigger), reset(self.held, self.u))
        yield self.y == self.held


class DiscretePID(PartialDiscrete):
    """Sampled PID controller with limits; its integral stops where the output is at a limit.

    At each tick, with the error e = u_s - u_m and T = sample_period,

        y = clamp(v),  v = k*(wp*u_s - u_m) + I + D
        I becomes I + k*T/Ti*e + T/Tt*(y - v)
        D becomes Td/(Td + Nd*T)*D - k*Td*Nd/(Td + Nd*T)*(u_m - u_m at the last tick)

    Source: K. J. Astrom, T. Hagglund, PID Controllers: Theory, Design, and Tuning (1995), chapter 3.6: backward
    differences for D, forward for I, tracking time Tt = Ti.
    """

    u_s: Real = signal_input(doc="Set point")
    u_m: Real = signal_input(doc="Measurement")
    y: Real = signal_output(doc="Output of the controller, held between the ticks")
    k: Real = parameter(default=1.0, doc="Gain")
    Ti: Real = parameter(default=1e10, unit="s", min=1e-60, doc="Time constant of the integral")
    Td: Real = parameter(default=0.0, unit="s", min=0.0, doc="Time constant of the derivative")
    Nd: Real = parameter(default=10.0, unit="1", min=0.0, doc="Time constant of the derivative filter is Td/Nd")
    wp: Real = parameter(default=1.0, unit="1", doc="Weight of the set point in the proportional part")
    y_max: Real = parameter(default=1e10, doc="Upper limit of the output")
    y_min: Real = parameter(default=lambda self: -self.y_max, doc="Lower limit of the output")
    y_start: Real = parameter(default=0.0, doc="Integral part at the start")
    held: Real = discrete(doc="Output")
    integral: Real = discrete(doc="Integral part")
    derivative: Real = discrete(doc="Derivative part")
    u_last: Real = discrete(doc="Measurement at the last tick")
    ticks: Real = integer(doc="Number of ticks so far")

    def build(self) -> None:
        self.integral = fixed(self.y_start)

    def equations(self) -> Equations:
        yield assert_(self.y_min <= self.y_max, "the lower limit y_min is above the upper limit y_max")
        T = self.sample_period
        last = where(pre(self.ticks) > 0.5, pre(self.u_last), self.u_m)  # no derivative kick at the first tick
        forget = self.Td / (self.Td + self.Nd * T)
        derivative = forget * (pre(self.derivative) - self.k * self.Nd * (self.u_m - last))
        wanted = self.k * (self.wp * self.u_s - self.u_m) + pre(self.integral) + derivative
        limited = clamp(wanted, self.y_min, self.y_max)
        gained = self.k * T / self.Ti * (self.u_s - self.u_m) + T / self.Ti * (limited - wanted)
        yield when(
            self.tick(),
            reset(self.held, no_event(limited)),
            reset(self.integral, pre(self.integral) + no_event(gained)),
            reset(self.derivative, derivative),
            reset(self.u_last, self.u_m),
            reset(self.ticks, pre(self.ticks) + 1),
        )
        yield self.y == self.held
