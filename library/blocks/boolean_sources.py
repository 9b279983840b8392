"""Signals of time that are true or false. Names as in Modelica.Blocks.Sources; their edges are exact time events."""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Real,
    boolean_output,
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
    """Block with one output that is true or false."""

    y: Real = boolean_output(doc="Output signal")


class BooleanConstant(PartialBooleanSource):
    """Always `k`."""

    k: bool = structural(default=True, doc="Output")

    def equations(self) -> Equations:
        yield self.y == self.k


class BooleanStep(PartialBooleanSource):
    """`start_value` before `start_time`, its opposite from then on."""

    start_time: Real = parameter(default=0.0, unit="s", doc="Time of the step")
    start_value: bool = structural(default=False, doc="Output before start_time")

    def equations(self) -> Equations:
        later = time >= self.start_time
        yield self.y == (~later if self.start_value else later)


class BooleanPulse(PartialBooleanSource):
    """True for the share `width` of each `period`, from `start_time` on."""

    width: Real = parameter(default=0.5, unit="1", min=0.0, max=1.0, doc="Pulse length as a fraction of the period")
    period: Real = parameter(unit="s", min=1e-60, doc="Time from one pulse to the next")
    start_time: Real = parameter(default=0.0, unit="s", doc="Beginning of the first pulse")

    def equations(self) -> Equations:
        # two clocks: both edges are exact. With width = 1 they tick together, and the beginning of a pulse counts
        begin = sample(self.start_time, self.period)
        end = sample(self.start_time + self.width * self.period, self.period)
        yield when(begin, reset(self.y, no_event(self.width > 0.0))).elsewhen(end, reset(self.y, False))


class SampleTrigger(PartialBooleanSource):
    """True at the instants `start_time + k*period` alone."""

    period: Real = parameter(unit="s", min=1e-60, doc="Time from one instant to the next")
    start_time: Real = parameter(default=0.0, unit="s", doc="First instant")

    def equations(self) -> Equations:
        yield self.y == sample(self.start_time, self.period)


class BooleanTable(PartialBooleanSource):
    """Changes at each time of `table`, beginning with `start_value`."""

    table: tuple[float, ...] = structural(doc="Times [s] at which the output changes, increasing")
    start_value: bool = structural(default=False, doc="Output before the first of them")

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
