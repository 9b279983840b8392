"""What the generator methods of a component may yield, and in which order it counts."""

from __future__ import annotations

import math
from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Connector,
    Equations,
    Real,
    connect,
    der,
    discrete,
    fixed,
    flow,
    parameter,
    pre,
    reset,
    sample,
    variable,
    when,
)
from acausal.errors import AcausalError
from acausal.flatten.instances.statements import statements
from acausal.language.expressions.expression import Equation
from tests.expected import fails_with


class Pin(Connector):
    v: Real = variable()
    i: Real = flow()


class Base(Component):
    a: Pin = Pin()
    b: Pin = Pin()
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield self.a.v == 1.0
        yield self.b.i == 2.0


class Derived(Base):
    def equations(self) -> Equations:
        yield der(self.x) == -self.x


def test_equations_of_all_classes_add_up_base_first() -> None:
    found = [str(item) for item, _ in statements(Derived())]
    assert found == ["a.v == 1", "b.i == 2", "der(x) == -x"]


def test_places_are_those_of_the_statements() -> None:
    """Through `yield from` too: the place is that of the inner statement."""

    class Delegating(Derived):
        def more(self) -> Equations:
            yield self.a.v == self.b.v

        def equations(self) -> Equations:
            yield from self.more()

    texts = [origin.span().text for item, origin in statements(Delegating()) if isinstance(item, Equation)]
    assert texts == [
        "yield self.a.v == 1.0",
        "yield self.b.i == 2.0",
        "yield der(self.x) == -self.x",
        "yield self.a.v == self.b.v",
    ]


def model(method: str, *items: Any) -> Component:
    """A component whose `method` yields the items, given as functions of it."""

    def generator(self: Any) -> Equations:
        yield from (item(self) for item in items)

    made: Component = type("Model", (Base,), {method: generator})()
    return made


@pytest.mark.parametrize(
    ("method", "item"),
    [
        pytest.param("equations", lambda self: True, id="a comparison of numbers"),
        pytest.param("equations", lambda self: self.x, id="an expression"),
        pytest.param("equations", lambda self: None, id="nothing"),
        pytest.param("initial_equations", lambda self: connect(self.a, self.b), id="a connection at the start"),
        pytest.param(
            "initial_equations", lambda self: when(self.x > 1, reset(self.x, 0.0)), id="an event at the start"
        ),
        pytest.param("initial_equations", lambda self: 3.0, id="a number"),
    ],
)
def test_wrong_items(method: str, item: Any) -> None:
    with fails_with(AcausalError, "AC130"):
        acausal.flatten(model(method, item))


def test_a_method_that_returns() -> None:
    broken = type("Model", (Base,), {"equations": lambda self: [self.x == 1.0]})()
    with fails_with(AcausalError, "AC129"):
        acausal.flatten(broken)


class Switch(Component):
    """Counts how often a part crosses zero: the equations of a composite may act at events, too."""

    inner: Derived = Derived()
    n: Real = acausal.discrete()

    def equations(self) -> Equations:
        yield when(self.inner.x < 0.5, reset(self.n, pre(self.n) + 1))


def test_composites_act_at_events() -> None:
    """x = exp(-t) falls below 0.5 once."""
    flat = acausal.flatten(Switch())
    assert len(flat.whens) == 1


def test_a_part_that_occurs_twice_at_each_of_sixty_levels_is_visited_once() -> None:
    """Sixty halvings of a sum of two equal terms have 2^60 paths to one symbol: checks along paths would never end."""

    def halved(e: Any) -> Any:
        for _ in range(60):
            e = 0.5 * e + 0.5 * e
        return e

    class Shared(Component):
        x: Real = variable(default=fixed(1.0))
        T: Real = parameter(default=0.25)
        y: Real = variable()
        n: Real = discrete(default=0.0)

        def equations(self) -> Equations:
            yield der(self.x) == -self.x
            yield self.y == der(halved(self.x) * self.x + halved(self.x))
            yield when(sample(0.0, halved(self.T)), reset(self.n, pre(self.n) + 1.0))

    result = acausal.simulate(Shared(), stop_time=1.1)
    assert result.final("n") == 5.0
    assert result.final("y") == pytest.approx(-2.0 * math.exp(-2.2) - math.exp(-1.1), rel=1e-5)
