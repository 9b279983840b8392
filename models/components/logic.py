"""Logic, comparisons and sampling: components of `acausal.library.blocks` whose values change at discrete times."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect
from acausal.library.blocks import (
    And,
    BooleanConstant,
    BooleanStep,
    BooleanTable,
    BooleanToReal,
    Change,
    ContinuousClock,
    Edge,
    FallingEdge,
    FirstOrderHold,
    Greater,
    GreaterEqualThreshold,
    GreaterThreshold,
    Less,
    LessEqualThreshold,
    LessThreshold,
    Nand,
    Nor,
    Not,
    Or,
    Pre,
    RealToBoolean,
    RSFlipFlop,
    Sampler,
    SampleTrigger,
    Sine,
    Switch,
    TriggeredSampler,
    UnitDelay,
    Xor,
    ZeroOrderHold,
)


class Gates(Component):
    """Two Boolean signals through all logic gates."""

    a: BooleanTable = BooleanTable(table=(1.0, 3.0, 5.0, 7.0))
    b: BooleanTable = BooleanTable(table=(2.0, 4.0, 5.5, 6.5))
    conjunction: And = And()
    disjunction: Or = Or()
    nand: Nand = Nand()
    nor: Nor = Nor()
    xor: Xor = Xor()
    inverse: Not = Not()

    experiment: ClassVar[Experiment] = Experiment(stop_time=8.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("a.y",), title="a"),
        Panel(("b.y",), title="b"),
        Panel(("conjunction.y",), title="a and b"),
        Panel(("disjunction.y",), title="a or b"),
        Panel(("nand.y",), title="not (a and b)"),
        Panel(("nor.y",), title="not (a or b)"),
        Panel(("xor.y",), title="either a or b"),
        Panel(("inverse.y",), title="not a"),
    )

    def equations(self) -> Equations:
        gates = (self.conjunction, self.disjunction, self.nand, self.nor, self.xor)
        yield connect(self.a.y, self.inverse.u, *(g.u1 for g in gates))
        yield connect(self.b.y, *(g.u2 for g in gates))


class Memories(Component):
    """Edges sample the clock, a flip-flop remembers the last one, and a loop through `Pre` latches."""

    signal: BooleanTable = BooleanTable(table=(1.0, 2.0, 4.0, 6.0))
    later: BooleanStep = BooleanStep(start_time=5.0)
    always: BooleanConstant = BooleanConstant(k=True)
    both: And = And()
    clock: ContinuousClock = ContinuousClock()
    rise: Edge = Edge()
    fall: FallingEdge = FallingEdge()
    change: Change = Change()
    at_rise: TriggeredSampler = TriggeredSampler()
    at_fall: TriggeredSampler = TriggeredSampler()
    at_change: TriggeredSampler = TriggeredSampler()
    flip_flop: RSFlipFlop = RSFlipFlop()
    latch: Or = Or()
    before: Pre = Pre()
    switch: Switch = Switch()
    number: BooleanToReal = BooleanToReal(real_true=10.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=8.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("signal.y", "later.y"), title="Signals"),
        Panel(("at_rise.y", "at_fall.y", "at_change.y"), title="Time of the last rise, fall, change"),
        Panel(("flip_flop.Q", "latch.y"), title="Flip-flop, and a latch that stays set"),
        Panel(("switch.y", "number.y"), title="Clock or latched time; 10 for true"),
    )

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.rise.u, self.fall.u, self.change.u, self.flip_flop.S, self.latch.u1)
        yield connect(self.signal.y, self.number.u)
        yield connect(self.later.y, self.both.u1)
        yield connect(self.always.y, self.both.u2)
        yield connect(self.both.y, self.flip_flop.R, self.switch.u2)
        yield connect(self.clock.y, self.at_rise.u, self.at_fall.u, self.at_change.u, self.switch.u1)
        yield connect(self.rise.y, self.at_rise.trigger)
        yield connect(self.fall.y, self.at_fall.trigger)
        yield connect(self.change.y, self.at_change.trigger)
        yield connect(self.latch.y, self.before.u)
        yield connect(self.before.y, self.latch.u2)
        yield connect(self.at_change.y, self.switch.u3)


class Comparisons(Component):
    """A sine compared with a ramp and with thresholds."""

    sine: Sine = Sine(f=0.5)
    line: ContinuousClock = ContinuousClock(offset=-1.0)
    greater: Greater = Greater()
    less: Less = Less()
    above: GreaterThreshold = GreaterThreshold(threshold=0.5)
    at_least: GreaterEqualThreshold = GreaterEqualThreshold(threshold=0.5)
    below: LessThreshold = LessThreshold(threshold=-0.5)
    at_most: LessEqualThreshold = LessEqualThreshold(threshold=-0.5)
    as_boolean: RealToBoolean = RealToBoolean(threshold=0.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sine.y", "line.y"), title="Sine and line"),
        Panel(("greater.y", "less.y"), title="Sine above, below the line"),
        Panel(("above.y", "at_least.y"), title="Above 0.5, at least 0.5"),
        Panel(("below.y", "at_most.y"), title="Below -0.5, at most -0.5"),
        Panel(("as_boolean.y",), title="Not negative"),
    )

    def equations(self) -> Equations:
        inputs = (self.above.u, self.at_least.u, self.below.u, self.at_most.u, self.as_boolean.u)
        yield connect(self.sine.y, self.greater.u1, self.less.u1, *inputs)
        yield connect(self.line.y, self.greater.u2, self.less.u2)


class SampledSine(Component):
    """A sine, sampled, held, extrapolated and delayed by one tick."""

    sine: Sine = Sine(f=1.0)
    sampler: Sampler = Sampler(sample_period=0.1)
    hold: ZeroOrderHold = ZeroOrderHold(sample_period=0.1)
    line: FirstOrderHold = FirstOrderHold(sample_period=0.1)
    late: UnitDelay = UnitDelay(sample_period=0.1)
    ticks: SampleTrigger = SampleTrigger(period=0.25)
    rarely: TriggeredSampler = TriggeredSampler()

    experiment: ClassVar[Experiment] = Experiment(stop_time=1.5)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sine.y", "sampler.y", "line.y"), title="Sampled, and on the line through the last two samples"),
        Panel(("sine.y", "hold.y", "late.y"), title="Held, and a tick later"),
        Panel(("sine.y", "rarely.y"), title="Four times in a period"),
    )

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.sampler.u, self.hold.u, self.line.u, self.late.u, self.rarely.u)
        yield connect(self.ticks.y, self.rarely.trigger)
