"""Signal sources. Parameters as in Modelica.Blocks.Sources."""

from __future__ import annotations

from acausal import Equations, Real, parameter, part, structural, time, where
from acausal.library.blocks.boolean_sources import BooleanPulse
from acausal.library.blocks.interfaces import PartialSignalSource, PartialSource
from acausal.library.blocks.waveforms import Points, pulse, ramp, sine, step, table


class Constant(PartialSource):
    """Constant signal."""

    k: Real = parameter(doc="Value of the output")

    def equations(self) -> Equations:
        yield self.y == self.k


class ContinuousClock(PartialSignalSource):
    """Time that has passed since `start_time` [s]; `offset` before."""

    def equations(self) -> Equations:
        yield self.y == self.offset + where(time < self.start_time, 0.0, time - self.start_time)


class Step(PartialSignalSource):
    """Jump by `height` at `start_time`."""

    height: Real = parameter(default=1.0, doc="Height of the jump")

    def equations(self) -> Equations:
        yield self.y == step(self.height, self.offset, self.start_time)


class Ramp(PartialSignalSource):
    """Straight rise by `height` within `duration`."""

    height: Real = parameter(default=1.0, doc="Height of the ramp")
    duration: Real = parameter(unit="s", min=0.0, doc="Duration of the rise")

    def equations(self) -> Equations:
        yield self.y == ramp(self.height, self.duration, self.offset, self.start_time)


class Sine(PartialSignalSource):
    """Sine wave from `start_time` on."""

    amplitude: Real = parameter(default=1.0, doc="Amplitude of the wave")
    f: Real = parameter(unit="Hz", doc="Frequency")
    phase: Real = parameter(default=0.0, unit="rad", doc="Phase at start_time")

    def equations(self) -> Equations:
        yield self.y == sine(self.amplitude, self.f, self.phase, self.offset, self.start_time)


class Pulse(PartialSignalSource):
    """Rectangular pulses: `nperiod` of them, or infinitely many if it is negative. Edges are exact time events."""

    amplitude: Real = parameter(default=1.0, doc="Height of the pulses")
    width: Real = parameter(default=0.5, unit="1", min=0.0, max=1.0, doc="Pulse length as a fraction of the period")
    period: Real = parameter(unit="s", min=1e-60, doc="Time of one period")
    nperiod: int = structural(default=-1, doc="Number of periods; negative for infinitely many")
    clocks: list[BooleanPulse] = part(doc="Edges of an infinite sequence")

    def build(self) -> None:
        # A finite number of edges needs no clock, and hence no discrete variables.
        endless = BooleanPulse(width=self.width, period=self.period, start_time=self.start_time)
        self.clocks = [endless] if self.nperiod < 0 else []

    def equations(self) -> Equations:
        if self.clocks:
            yield self.y == self.offset + where(self.clocks[0].y, self.amplitude, 0.0)
        else:
            yield self.y == pulse(self.amplitude, self.width, self.period, self.nperiod, self.offset, self.start_time)


class TimeTable(PartialSignalSource):
    """Linear interpolation in a table with rows (time [s], value); two rows with the same time form a jump."""

    table: Points = structural(doc="Rows (time [s], value); times ascend and count from start_time")

    def equations(self) -> Equations:
        yield self.y == table(self.table, self.offset, self.start_time)
