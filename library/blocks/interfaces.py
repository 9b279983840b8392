"""Partial blocks: the signals of all sources, one-input and two-input blocks."""

from __future__ import annotations

from acausal import Component, Real, parameter, signal_input, signal_output


class PartialSource(Component):
    """Block with one output. Signals have no unit of their own: they take that of their connection."""

    y: Real = signal_output(doc="Output signal")


class PartialSignalSource(PartialSource):
    """Source that adds `offset` to a waveform which begins at `start_time`."""

    offset: Real = parameter(default=0.0, doc="Added to the waveform; the output before start_time")
    start_time: Real = parameter(default=0.0, unit="s", doc="Output is offset for time < start_time")


class PartialSISO(Component):
    """Block with one input and one output."""

    u: Real = signal_input(doc="Input signal")
    y: Real = signal_output(doc="Output signal")


class PartialSI2SO(Component):
    """Block with two inputs and one output."""

    u1: Real = signal_input(doc="First input signal")
    u2: Real = signal_input(doc="Second input signal")
    y: Real = signal_output(doc="Output signal")
