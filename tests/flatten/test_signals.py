"""Signals: one source, any number of readers, through any number of levels; what cannot be connected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Real,
    connect,
    flow,
    parameter,
    part,
    signal_input,
    signal_output,
    variable,
)
from acausal.errors import DeclarationError, UnitError


class Source(Component):
    y: Real = signal_output(unit="A")

    def equations(self) -> Equations:
        yield self.y == 4.0


class Sink(Component):
    u: Real = signal_input(unit="A")
    y: Real = signal_output(unit="A")

    def equations(self) -> Equations:
        yield self.y == 2 * self.u


class Filter(Component):
    """Its own input feeds a part, whose output is its own output."""

    u: Real = signal_input(unit="A")
    y: Real = signal_output(unit="A")
    sink: Sink = Sink()

    def equations(self) -> Equations:
        yield connect(self.u, self.sink.u)
        yield connect(self.sink.y, self.y)


def test_signals_through_the_hierarchy() -> None:
    class Line(Component):
        source: Source = Source()
        filter: Filter = Filter()
        many: list[Sink] = part()

        def build(self) -> None:
            self.many = [Sink(), Sink()]

        def equations(self) -> Equations:
            yield connect(self.source.y, self.filter.u)
            yield connect(self.filter.y, *(s.u for s in self.many))

    result = acausal.simulate(Line())
    assert result.final("filter.y") == 8.0
    assert result.final("many[1].y") == 16.0


@pytest.mark.parametrize(("given", "expected"), [({"u": 5.0}, 10.0), ({}, 3.0)])
def test_input_bound_or_defaulted_and_passed_on(given: dict[str, Any], expected: float) -> None:
    """An input with a number of its own that its component connects to a part."""

    class Defaulted(Component):
        u: Real = signal_input(unit="A", default=1.5)
        sink: Sink = Sink()

        def equations(self) -> Equations:
            yield connect(self.u, self.sink.u)

    class Line(Component):
        defaulted: Defaulted = Defaulted(**given)

    assert acausal.simulate(Line()).final("defaulted.sink.y") == expected
    assert acausal.simulate(Defaulted(**given)).final("sink.y") == expected


def test_input_bound_and_connected() -> None:
    class Both(Component):
        source: Source = Source()
        sink: Sink = Sink(u=3.0)

        def equations(self) -> Equations:
            yield connect(self.source.y, self.sink.u)

    with pytest.raises(DeclarationError) as caught:
        acausal.flatten(Both())
    assert caught.value.code == "AC137"


def test_two_sources_on_one_signal() -> None:
    class Twice(Component):
        a: Source = Source()
        b: Source = Source()
        sink: Sink = Sink()

        def equations(self) -> Equations:
            yield connect(self.a.y, self.sink.u)
            yield connect(self.b.y, self.sink.u)

    with pytest.raises(DeclarationError) as caught:
        acausal.flatten(Twice())
    assert caught.value.code == "AC132"
    assert {"a.y", "b.y"} <= set(caught.value.fact.replace(":", " ").split())


class Pin(Connector):
    v: Real = variable(unit="V")
    i: Real = flow(unit="A")


class Load(Component):
    pin: Pin = Pin()
    R: Real = parameter(unit="Ohm")


class Angle(Component):
    u: Real = signal_input(unit="rad")


@pytest.mark.parametrize(
    ("make", "code", "kind"),
    [
        (lambda: connect(Pin(), Source().y), "AC120", DeclarationError),
        (lambda: connect(Source().y, Angle().u), "AC154", UnitError),
        (lambda: connect(Load(R=1.0).R, Source().y), "AC121", DeclarationError),
        (lambda: connect(Load(R=1.0), Load(R=1.0)), "AC121", DeclarationError),  # type: ignore[type-var]
    ],
)
def test_what_cannot_be_connected(make: Callable[[], object], code: str, kind: type[DeclarationError]) -> None:
    with pytest.raises(kind) as caught:
        make()
    assert caught.value.code == code
