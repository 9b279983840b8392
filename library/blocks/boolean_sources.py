"""Sources of Boolean signals, whose edges are exact time events. Names as in Modelica.Blocks.Sources."""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Real,
    boolean_output,
    floor,
    initial,
    no_event,
    parameter,
    reset,
    sample,
    structural,
    time,
    when,
)
from acausal.errors import DeclarationError


class PartialBooleanSource(Component):
    """Block with one Boolean output."""

    y: Real = boolean_output(doc="Output signal")


class BooleanConstant(PartialBooleanSource):
    """Constant Boolean signal `k`."""

    k: bool = structural(default=True, doc="Output")

    def equations(self) -> Equations:
        yield self.y == self.k


class BooleanStep(PartialBooleanSource):
    """Boolean step: `start_value` before `start_time`, its opposite from then on."""

    start_time: Real = parameter(default=0.0, unit="s", doc="Time of the step")
    start_value: bool = structural(default=False, doc="Output before start_time")

    def equations(self) -> Equations:
        later = time >= self.start_time
        yield self.y == (~later if self.start_value else later)


class BooleanPulse(PartialBooleanSource):
    """Boolean pulses: true for the fraction `width` of each `period`, from `start_time` on."""

    width: Real = parameter(default=0.5, unit="1", min=0.0, max=1.0, doc="Pulse length as a fraction of the period")
    period: Real = parameter(unit="s", min=1e-60, doc="Time from one pulse to the next")
    start_time: Real = parameter(default=0.0, unit="s", doc="Beginning of the first pulse")

    def equations(self) -> Equations:
        # One clock for each edge, so that both are exact; the rising edge has priority if they coincide (width = 1).
        begin = sample(self.start_time, self.period)
        end = sample(self.start_time + self.width * self.period, self.period)
        clause = when(begin, reset(self.y, no_event(self.width > 0.0))).elsewhen(end, reset(self.y, False))
        # Sets the initial value, because a run may start within a pulse.
        since = (time - self.start_time) / self.period
        within = (since >= 0.0) & (since - floor(since) < self.width)
        yield clause.elsewhen(initial(), reset(self.y, no_event(within)))


class SampleTrigger(PartialBooleanSource):
    """Trigger: true at the instants `start_time + k*period`, k = 0, 1, 2, ..., and at no other."""

    period: Real = parameter(unit="s", min=1e-60, doc="Time from one instant to the next")
    start_time: Real = parameter(default=0.0, unit="s", doc="First instant")

    def equations(self) -> Equations:
        yield self.y == sample(self.start_time, self.period)


class BooleanTable(PartialBooleanSource):
    """Boolean signal that begins with `start_value` and changes at each time of `table`."""

    table: tuple[float, ...] = structural(doc="Times [s] at which the output changes, increasing")
    start_value: bool = structural(default=False, doc="Output before the first change")

    def build(self) -> None:
        if any(b <= a for a, b in zip(self.table, self.table[1:], strict=False)):
            raise DeclarationError("AC160", f"BooleanTable: {self.table} does not increase", help="sort the times")

    def equations(self) -> Equations:
        times = list(self.table)
        value = time >= times.pop(0) if times else initial() & False
        while times:
            value = value & (time < times.pop(0))
            if times:
                value = value | (time >= times.pop(0))
        yield self.y == (~value if self.start_value else value)
