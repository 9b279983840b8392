"""Blocks of Boolean signals, and comparisons that make them. Names as in Modelica.Blocks.Logical."""

from __future__ import annotations

from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    boolean_input,
    boolean_output,
    change,
    edge,
    initial,
    parameter,
    part,
    pre,
    signal_input,
    signal_output,
    structural,
    where,
)
from acausal.library.blocks.interfaces import PartialSISO


class PartialBooleanSISO(Component):
    """Block with one Boolean input and one Boolean output."""

    u: Real = boolean_input(doc="Input signal")
    y: Real = boolean_output(doc="Output signal")


class PartialBooleanSI2SO(Component):
    """Block with two Boolean inputs and one Boolean output."""

    u1: Real = boolean_input(doc="First input signal")
    u2: Real = boolean_input(doc="Second input signal")
    y: Real = boolean_output(doc="Output signal")


class PartialThreshold(Component):
    """Comparison of a number with a parameter."""

    u: Real = signal_input(doc="Input signal")
    y: Real = boolean_output(doc="Output signal")
    threshold: Real = parameter(default=0.0, doc="What it is compared with")


class PartialComparison(Component):
    """Comparison of two numbers."""

    u1: Real = signal_input(doc="First input signal")
    u2: Real = signal_input(doc="Second input signal")
    y: Real = boolean_output(doc="Output signal")


class And(PartialBooleanSI2SO):
    """True while both inputs are."""

    def equations(self) -> Equations:
        yield self.y == (self.u1 & self.u2)


class Or(PartialBooleanSI2SO):
    """True while at least one input is."""

    def equations(self) -> Equations:
        yield self.y == (self.u1 | self.u2)


class Xor(PartialBooleanSI2SO):
    """True while exactly one input is."""

    def equations(self) -> Equations:
        yield self.y == (self.u1 & ~self.u2 | ~self.u1 & self.u2)


class Nor(PartialBooleanSI2SO):
    """True while no input is."""

    def equations(self) -> Equations:
        yield self.y == ~(self.u1 | self.u2)


class Nand(PartialBooleanSI2SO):
    """True unless both inputs are."""

    def equations(self) -> Equations:
        yield self.y == ~(self.u1 & self.u2)


class Not(PartialBooleanSISO):
    """True while the input is false."""

    def equations(self) -> Equations:
        yield self.y == ~self.u


class Pre(PartialBooleanSISO):
    """The input as it was just before an event, `y = pre(u)`: it breaks an algebraic loop of Boolean signals."""

    def equations(self) -> Equations:
        yield self.y == pre(self.u)


class Edge(PartialBooleanSISO):
    """True at the instants at which the input becomes true."""

    def equations(self) -> Equations:
        yield self.y == edge(self.u)


class FallingEdge(PartialBooleanSISO):
    """True at the instants at which the input becomes false."""

    def equations(self) -> Equations:
        yield self.y == edge(~self.u)


class Change(PartialBooleanSISO):
    """True at the instants at which the input changes."""

    def equations(self) -> Equations:
        yield self.y == change(self.u)


class RSFlipFlop(Component):
    """RS flip-flop, a memory of one bit: `S` sets it, `R` resets it; while both are true it keeps its value.

    `Q_ini` is its value at the start.
    """

    S: Real = boolean_input(doc="Sets")
    R: Real = boolean_input(doc="Resets")
    Q: Real = boolean_output(doc="What it keeps")
    QI: Real = boolean_output(doc="The opposite of Q")
    Q_ini: bool = structural(default=False, doc="Q at the start")

    def equations(self) -> Equations:
        kept = initial() & self.Q_ini | ~initial() & pre(self.Q)
        yield self.Q == (self.S & ~self.R | kept & ~(self.R & ~self.S))
        yield self.QI == ~self.Q


class GreaterThreshold(PartialThreshold):
    """True while the input is greater than the threshold."""

    def equations(self) -> Equations:
        yield self.y == (self.u > self.threshold)


class GreaterEqualThreshold(PartialThreshold):
    """True while the input is at least the threshold."""

    def equations(self) -> Equations:
        yield self.y == (self.u >= self.threshold)


class LessThreshold(PartialThreshold):
    """True while the input is less than the threshold."""

    def equations(self) -> Equations:
        yield self.y == (self.u < self.threshold)


class LessEqualThreshold(PartialThreshold):
    """True while the input is at most the threshold."""

    def equations(self) -> Equations:
        yield self.y == (self.u <= self.threshold)


class Greater(PartialComparison):
    """True while the first input is the greater one."""

    def equations(self) -> Equations:
        yield self.y == (self.u1 > self.u2)


class Less(PartialComparison):
    """True while the first input is the smaller one."""

    def equations(self) -> Equations:
        yield self.y == (self.u1 < self.u2)


class Switch(Component):
    """`u1` while `u2` is true, else `u3`."""

    u1: Real = signal_input(doc="Input while u2 is true")
    u2: Real = boolean_input(doc="Chooses")
    u3: Real = signal_input(doc="Input while u2 is false")
    y: Real = signal_output(doc="The selected input")

    def equations(self) -> Equations:
        yield self.y == where(self.u2, self.u1, self.u3)


class Hysteresis(Component):
    """Boolean hysteresis: true once the input has risen above `u_high`, until it falls below `u_low`."""

    u: Real = signal_input(doc="Input signal")
    y: Real = boolean_output(doc="Output signal")
    u_low: Real = parameter(default=0.0, doc="Below this it becomes false")
    u_high: Real = parameter(default=1.0, doc="Above this it becomes true")
    pre_y_start: bool = structural(default=False, doc="Output before the start")

    def equations(self) -> Equations:
        yield assert_(self.u_low <= self.u_high, "the lower threshold u_low is above the upper one, u_high")
        before = initial() & self.pre_y_start | ~initial() & pre(self.y)
        yield self.y == ((self.u > self.u_high) | before & (self.u >= self.u_low))


class OnOffController(Component):
    """Two-point controller: true while the signal is below the reference, with a hysteresis of width `bandwidth`."""

    reference: Real = signal_input(doc="Set point of `u`")
    u: Real = signal_input(doc="Measured signal")
    y: Real = boolean_output(doc="On")
    bandwidth: Real = parameter(doc="Width of the band around the reference in which the output does not change")
    pre_y_start: bool = structural(default=False, doc="Output before the start")

    def equations(self) -> Equations:
        before = initial() & self.pre_y_start | ~initial() & pre(self.y)
        half = self.bandwidth / 2.0
        stays = before & (self.u < self.reference + half)
        yield self.y == (stays | (self.u < self.reference - half))


class BooleanToReal(Component):
    """Boolean to real signal: one value while the input is true, another while it is false."""

    u: Real = boolean_input(doc="Input signal")
    y: Real = signal_output(doc="Output signal")
    real_true: Real = parameter(default=1.0, doc="Output while the input is true")
    real_false: Real = parameter(default=0.0, doc="Output while the input is false")

    def equations(self) -> Equations:
        yield self.y == where(self.u, self.real_true, self.real_false)


class RealToBoolean(Component):
    """True while the input is at least the threshold."""

    u: Real = signal_input(doc="Input signal")
    y: Real = boolean_output(doc="Output signal")
    threshold: Real = parameter(default=0.5, doc="Smallest input that counts as true")

    def equations(self) -> Equations:
        yield self.y == (self.u >= self.threshold)


class Relay(PartialSISO):
    """Relay: `y_on` once the input has risen above `u_high`, `y_off` once it has fallen below `u_low`."""

    u_low: Real = parameter(default=0.0, doc="Below this it is off")
    u_high: Real = parameter(default=0.0, doc="Above this it is on")
    y_on: Real = parameter(default=1.0, doc="Output while on")
    y_off: Real = parameter(default=-1.0, doc="Output while off")
    hysteresis: Hysteresis = part(doc="When it is on")

    def build(self) -> None:
        self.hysteresis = Hysteresis(u_low=self.u_low, u_high=self.u_high, u=self.u)

    def equations(self) -> Equations:
        yield self.y == where(self.hysteresis.y, self.y_on, self.y_off)
