"""Elements of vectors of signals in `connect`, and parts of lists."""

from __future__ import annotations

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    boolean_input,
    boolean_output,
    connect,
    flatten,
    part,
    signal_input,
    signal_output,
    structural,
    time,
)
from acausal.errors import DeclarationError
from acausal.library.blocks import Gain
from tests.expected import fails_with


class Weighted(Component):
    """Sum of its inputs, weighted by 1, 10, 100."""

    u: Real = signal_input(shape=3, default=(5.0, 6.0, 7.0))
    y: Real = signal_output()

    def equations(self) -> Equations:
        yield self.y == self.u[0] + 10 * self.u[1] + 100 * self.u[2]


class Split(Component):
    """Own inputs to gains, gains to a weighted sum, and out again one by one."""

    connected: tuple[int, ...] = structural(default=(0, 1, 2))
    u: Real = signal_input(shape=3)
    y: Real = signal_output(shape=3)
    gains: list[Gain] = part()
    sum: Weighted = Weighted()

    def build(self) -> None:
        self.gains = [Gain(k=float(k + 2)) for k in range(3)]

    def equations(self) -> Equations:
        for k, gain in enumerate(self.gains):
            yield connect(self.u[k], gain.u)
            yield connect(gain.y, self.y[k])
            if k in self.connected:
                yield connect(gain.y, self.sum.u[k])


class Driven(Component):
    """The inputs are 1, 2, 3."""

    connected: tuple[int, ...] = structural(default=(0, 1, 2))
    split: Split = part()

    def build(self) -> None:
        self.split = Split(u=(1.0, 2.0, 3.0), connected=self.connected)


def test_every_element_goes_where_it_is_connected() -> None:
    """Gains 2, 3, 4 of 1, 2, 3 are 2, 6, 12; an element that nobody connects keeps its default."""
    result = acausal.simulate(Driven(), stop_time=1.0)
    assert [result.final(f"split.y[{k}]") for k in range(3)] == [2.0, 6.0, 12.0]
    assert result.final("split.sum.y") == 2.0 + 60.0 + 1200.0
    assert acausal.simulate(Driven(connected=(0, 2)), stop_time=1.0).final("split.sum.y") == 2.0 + 60.0 + 1200.0
    assert acausal.simulate(Driven(connected=(0,)), stop_time=1.0).final("split.sum.y") == 2.0 + 60.0 + 700.0


def test_elements_that_change_at_events() -> None:
    class Levels(Component):
        y: Real = boolean_output(shape=2)

        def equations(self) -> Equations:
            yield self.y[0] == (time > 0.25)
            yield self.y[1] == (time > 0.75)

    class Lamp(Component):
        on: Real = boolean_output()
        given: Real = boolean_input()

        def equations(self) -> Equations:
            yield self.on == self.given

    class Panel(Component):
        lamps: list[Lamp] = part()
        first: Lamp = Lamp()
        levels: Levels = Levels()

        def build(self) -> None:
            self.lamps = [Lamp() for _ in range(2)]

        def equations(self) -> Equations:
            for k, lamp in enumerate(self.lamps):
                yield connect(self.levels.y[k], lamp.given)
            yield connect(self.levels.y[-2], self.first.given)

    result = acausal.simulate(Panel(), stop_time=0.5)
    assert result.final("lamps[0].on") == 1.0
    assert result.final("lamps[1].on") == 0.0
    assert result.final("first.on") == 1.0


def test_an_element_that_is_driven_twice() -> None:
    class Twice(Component):
        a: Gain = Gain(k=1.0, u=1.0)
        b: Gain = Gain(k=1.0, u=2.0)
        sum: Weighted = Weighted()

        def equations(self) -> Equations:
            yield connect(self.a.y, self.sum.u[1])
            yield connect(self.b.y, self.sum.u[1])

    with fails_with(DeclarationError, "AC132", match=r"sum\.u\[1\]"):
        flatten(Twice())


def test_two_inputs_have_no_source() -> None:
    class Sinks(Component):
        a: Gain = Gain(k=1.0)
        sum: Weighted = Weighted()

        def equations(self) -> Equations:
            yield connect(self.a.u, self.sum.u[1])

    with fails_with(DeclarationError, "AC132", match="no source among the ends"):
        flatten(Sinks())
