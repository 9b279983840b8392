"""Voltage and current sources. Names and signs as in Modelica.Electrical.Analog.Sources.

A voltage source sets `v = p.v - n.v`; a current source drives `i` from `p` through itself to `n`.
"""

from __future__ import annotations

from acausal import Equations, Real, parameter, signal_input
from acausal.library.blocks import waveforms
from acausal.library.electrical.interfaces import PartialOnePort


class PartialVoltageSource(PartialOnePort):
    """Voltage source whose waveform begins at `start_time`."""

    offset: Real = parameter(default=0.0, unit="V", doc="Added to the waveform; the voltage before start_time")
    start_time: Real = parameter(default=0.0, unit="s", doc="Voltage is offset for time < start_time")


class PartialCurrentSource(PartialOnePort):
    """Current source whose waveform begins at `start_time`."""

    offset: Real = parameter(default=0.0, unit="A", doc="Added to the waveform; the current before start_time")
    start_time: Real = parameter(default=0.0, unit="s", doc="Current is offset for time < start_time")


class ConstantVoltage(PartialOnePort):
    """Constant voltage."""

    V: Real = parameter(unit="V", doc="Voltage")

    def equations(self) -> Equations:
        yield self.v == self.V


class StepVoltage(PartialVoltageSource):
    """Voltage that jumps by V at `start_time`."""

    V: Real = parameter(unit="V", doc="Height of the jump")

    def equations(self) -> Equations:
        yield self.v == waveforms.step(self.V, self.offset, self.start_time)


class RampVoltage(PartialVoltageSource):
    """Voltage that rises by V within `duration`."""

    V: Real = parameter(unit="V", doc="Height of the ramp")
    duration: Real = parameter(unit="s", min=0.0, doc="Duration of the rise")

    def equations(self) -> Equations:
        yield self.v == waveforms.ramp(self.V, self.duration, self.offset, self.start_time)


class SineVoltage(PartialVoltageSource):
    """Sine voltage."""

    V: Real = parameter(unit="V", doc="Amplitude")
    f: Real = parameter(unit="Hz", doc="Frequency")
    phase: Real = parameter(default=0.0, unit="rad", doc="Phase at start_time")

    def equations(self) -> Equations:
        yield self.v == waveforms.sine(self.V, self.f, self.phase, self.offset, self.start_time)


class SignalVoltage(PartialOnePort):
    """Voltage given by an input signal [V]."""

    u: Real = signal_input(unit="V", doc="Voltage")

    def equations(self) -> Equations:
        yield self.v == self.u


class ConstantCurrent(PartialOnePort):
    """Constant current."""

    I: Real = parameter(unit="A", doc="Current from p to n")  # noqa: E741

    def equations(self) -> Equations:
        yield self.i == self.I


class StepCurrent(PartialCurrentSource):
    """Current that jumps by I at `start_time`."""

    I: Real = parameter(unit="A", doc="Height of the jump")  # noqa: E741

    def equations(self) -> Equations:
        yield self.i == waveforms.step(self.I, self.offset, self.start_time)


class RampCurrent(PartialCurrentSource):
    """Current that rises by I within `duration`."""

    I: Real = parameter(unit="A", doc="Height of the ramp")  # noqa: E741
    duration: Real = parameter(unit="s", min=0.0, doc="Duration of the rise")

    def equations(self) -> Equations:
        yield self.i == waveforms.ramp(self.I, self.duration, self.offset, self.start_time)


class SineCurrent(PartialCurrentSource):
    """Sine current."""

    I: Real = parameter(unit="A", doc="Amplitude")  # noqa: E741
    f: Real = parameter(unit="Hz", doc="Frequency")
    phase: Real = parameter(default=0.0, unit="rad", doc="Phase at start_time")

    def equations(self) -> Equations:
        yield self.i == waveforms.sine(self.I, self.f, self.phase, self.offset, self.start_time)


class SignalCurrent(PartialOnePort):
    """Current given by an input signal [A]."""

    u: Real = signal_input(unit="A", doc="Current from p to n")

    def equations(self) -> Equations:
        yield self.i == self.u
