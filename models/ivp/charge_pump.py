"""A charge pump: one MOS transistor between two capacitors, driven by a clock."""

from __future__ import annotations

from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Expr,
    Panel,
    Real,
    connect,
    der,
    fixed,
    guess,
    maximum,
    minimum,
    parameter,
    part,
    signal_input,
    sqrt,
    variable,
    where,
)
from acausal.library.blocks import TimeTable

PERIOD = 120e-9
PERIODS = 10
HIGH = 20.0
CLOCK = (
    *(
        (period * PERIOD + t, v)
        for period in range(PERIODS)
        for t, v in ((0.0, 0.0), (50e-9, 0.0), (60e-9, HIGH), (110e-9, HIGH))
    ),
    (PERIODS * PERIOD, 0.0),
)
"""Rows (time [s], voltage [V]) of the clock."""


class MosCircuit(Component):
    """The transistor, described by its charges, and the two capacitors; nine equations as published."""

    VT0: Real = parameter(default=0.20, unit="V", doc="Threshold")
    gamma: Real = parameter(default=0.035, doc="Body effect [sqrt(V)]")
    phi: Real = parameter(default=1.01, unit="V")
    Cox: Real = parameter(default=4e-12, unit="F", min=0.0, doc="Capacitance of the oxide")
    CD: Real = parameter(default=0.40e-12, unit="F", min=0.0)
    CS: Real = parameter(default=1.60e-12, unit="F", min=0.0)
    Vin: Real = signal_input(unit="V", doc="Clock")
    YT1: Real = variable(default=guess(1.2628e-13), unit="C", nominal=1e-11, doc="Charge of the gate")
    YS: Real = variable(default=fixed(0.0), unit="C", nominal=1e-11)
    YT2: Real = variable(default=fixed(0.0), unit="C", nominal=1e-11)
    YD: Real = variable(default=fixed(0.0), unit="C", nominal=1e-11)
    YT3: Real = variable(default=fixed(0.0), unit="C", nominal=1e-11)
    U1: Real = variable(unit="V", doc="Voltage of the gate")
    U2: Real = variable(default=fixed(0.0), unit="V", doc="Voltage of the source")
    U3: Real = variable(default=fixed(0.0), unit="V", doc="Voltage of the drain")
    I: Real = variable(unit="A", nominal=1e-3, doc="Current of the clock")  # noqa: E741

    def equations(self) -> Equations:
        gate, channel = self._charges()
        yield der(self.YT1) == -self.I
        yield der(self.YS) + der(self.YT2) == 0
        yield der(self.YD) + der(self.YT3) == 0
        yield self.U1 == self.Vin
        yield self.YT1 == gate
        yield self.YS == self.CS * self.U2
        yield self.YT2 == channel
        yield self.YD == self.CD * self.U3
        yield self.YT3 == channel

    def _charges(self) -> tuple[Expr, Expr]:
        """Charge of the gate, and of source and drain, in the three regions of the transistor."""
        ugb = self.U1
        ugs = maximum(self.U1 - self.U2, self.U1 - self.U3)
        ugd = minimum(self.U1 - self.U2, self.U1 - self.U3)
        ubs = ugs - ugb
        vfb = self.VT0 - self.gamma * sqrt(self.phi) - self.phi
        vte = self.VT0 + self.gamma * (sqrt(self.phi - ubs) - sqrt(self.phi))
        a, b = ugs - vte, maximum(ugd - vte, 0.0)
        mean = a + b - a * b / (a + b)
        half = self.gamma / 2
        flat = self.Cox * (ugb - vfb)
        weak = self.Cox * self.gamma * (sqrt(half**2 + ugb - vfb) - half)
        strong = self.Cox * (2 / 3 * mean + self.gamma * sqrt(self.phi - ubs))
        off = ugs <= vte
        # The charges are continuous; as published, the region is selected at every evaluation, without events.
        gate = where(ugb <= vfb, flat, where(off, weak, strong, smooth=True), smooth=True)
        channel = where(off, 0.0, -self.Cox / 3 * mean, smooth=True)
        return gate, where(ugb <= vfb, 0.0, channel, smooth=True)


class ChargePump(Component):
    """Ten periods of the clock; a DAE of index 2 with kinks in time and in the charges.

    Source: M. Guenther, G. Denk, U. Feldmann, preprint 1745, TH Darmstadt (1995); problem `pump` of the test set.
    At the stop time all charges but YT1 have returned to 0, and YT1 and I have a closed form.
    """

    clock: TimeTable = part()
    circuit: MosCircuit = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=PERIODS * PERIOD, tolerance=1e-8, solver="idas")
    figure: ClassVar[tuple[Panel, ...]] = (Panel(("circuit.U1", "circuit.U2", "circuit.U3"), title="Voltages"),)

    def build(self) -> None:
        self.clock = TimeTable(table=CLOCK)
        self.circuit = MosCircuit()

    def equations(self) -> Equations:
        yield connect(self.clock.y, self.circuit.Vin)
