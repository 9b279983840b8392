"""Means over the periods of a signal, updated at the end of each period. Names as in Modelica.Blocks.Math."""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fabs,
    fixed,
    initial,
    maximum,
    no_event,
    parameter,
    part,
    pre,
    reset,
    signal_input,
    signal_output,
    sqrt,
    time,
    variable,
    when,
)


class Mean(Component):
    """Mean of the input over the last full period; 0 before the first one has ended."""

    u: Real = signal_input(doc="Input signal")
    y: Real = signal_output(doc="Mean over the last period")
    f: Real = parameter(unit="Hz", min=1e-60, doc="Base frequency")
    x: Real = variable(default=fixed(0.0), prefer_state=True, doc="Integral since the period began")
    held: Real = discrete(doc="Mean over the last period")
    since: Real = discrete(unit="s", doc="Time at which the integral began")

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield self.y == self.held
        period = 1.0 / self.f
        # Not a clock, whose ticks would begin at zero: a run may begin at any time, also before zero.
        yield when(
            time >= pre(self.since) + period,
            reset(self.held, self.f * pre(self.x)),
            reset(self.x, 0.0),
            reset(self.since, time),
        ).elsewhen(initial(), reset(self.since, time))


class RectifiedMean(Component):
    """Mean of the absolute value of the input over the last full period; 0 before the first one has ended."""

    u: Real = signal_input(doc="Input signal")
    y: Real = signal_output(doc="Rectified mean over the last period")
    f: Real = parameter(unit="Hz", min=1e-60, doc="Base frequency")
    mean: Mean = part(doc="Mean of the absolute value of the input")

    def build(self) -> None:
        self.mean = Mean(f=self.f, u=fabs(self.u))

    def equations(self) -> Equations:
        yield self.y == self.mean.y


class RootMeanSquare(Component):
    """Root mean square of the input over the last full period; 0 before the first one has ended."""

    u: Real = signal_input(doc="Input signal")
    y: Real = signal_output(doc="Root mean square over the last period")
    f: Real = parameter(unit="Hz", min=1e-60, doc="Base frequency")
    mean: Mean = part(doc="Mean of the square of the input")

    def build(self) -> None:
        self.mean = Mean(f=self.f, u=self.u * self.u)

    def equations(self) -> Equations:
        yield self.y == no_event(sqrt(maximum(self.mean.y, 0.0)))
