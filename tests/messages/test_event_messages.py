"""AC108, AC140 to AC149: misuse of the language of events."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    assert_,
    boolean,
    boolean_input,
    boolean_output,
    change,
    connect,
    der,
    discrete,
    edge,
    equals,
    fixed,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    signal_output,
    smooth,
    terminate,
    variable,
    when,
    where,
)
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Thing(Component):
    """One of everything."""

    x: Real = variable(unit="m")
    v: Real = variable(shape=3)
    k: Real = parameter(default=2.0)
    on: Real = boolean()
    n: Real = integer()
    kept: Real = discrete(unit="m")


# Any: a type checker would refuse most of what follows.
thing: Any = Thing()
make: Any = Thing
anything: Any = 0


class Relay(Component):
    """Input and output that are true or false."""

    u: Real = boolean_input(doc="Switches it")
    y: Real = boolean_output(doc="The opposite")

    def equations(self) -> Equations:
        yield self.y == ~self.u


@corpus.wrong(
    "AC108",
    "x",
    "return where(thing.x, 1.0, 2.0)",
    text="""
error[AC108]: `x` is a number, not a condition
  at      test_event_messages.py:N
              return where(thing.x, 1.0, 2.0)
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def where_of_a_number() -> object:
    return where(thing.x, 1.0, 2.0)


@corpus.wrong("AC108", "n == 1", "return where(thing.n == 1, 1.0, thing.x)")
def where_of_an_equation() -> object:
    return where(thing.n == 1, 1.0, thing.x)


@corpus.wrong("AC108", "True", "return where(True, 1.0, thing.x)  # type: ignore[arg-type]")
def where_of_python() -> object:
    return where(True, 1.0, thing.x)  # type: ignore[arg-type]


@corpus.wrong("AC108", "x", "return thing.x & thing.on")
def and_of_a_number() -> object:
    return thing.x & thing.on


@corpus.wrong("AC108", "n", "return ~thing.n")
def not_of_an_integer() -> object:
    return ~thing.n


@corpus.wrong("AC108", "n", "return when(thing.n, reset(thing.kept, 1.0))")
def when_an_integer() -> object:
    return when(thing.n, reset(thing.kept, 1.0))


@corpus.wrong("AC108", "kept", "return edge(thing.kept)")
def edge_of_a_number() -> object:
    return edge(thing.kept)


@corpus.wrong("AC108", "()", "return when((), reset(thing.n, 1))")
def when_nothing() -> object:
    return when((), reset(thing.n, 1))


@corpus.wrong("AC140", "3", "return when(thing.x > 0, 3)  # type: ignore[arg-type]")
def when_without_action() -> object:
    return when(thing.x > 0, 3)  # type: ignore[arg-type]


@corpus.wrong("AC141", "k", "return reset(thing.k, 1.0)")
def reset_of_a_parameter() -> object:
    return reset(thing.k, 1.0)


@corpus.wrong("AC141", "x + 1", "return reset(thing.x + 1.0, 0.0)")
def reset_of_an_expression() -> object:
    return reset(thing.x + 1.0, 0.0)


@corpus.wrong("AC105", "on", "return reset(thing.on, thing.v)")
def reset_to_a_vector() -> object:
    return reset(thing.on, thing.v)


@corpus.wrong("AC146", "x", "return change(thing.x)")
def change_of_what_always_changes() -> object:
    return change(thing.x)


@corpus.wrong("AC146", "x", "return equals(thing.x, 1.0)")
def equality_of_numbers() -> object:
    return equals(thing.x, 1.0)


@corpus.wrong("AC147", "on", "return reset(thing.on, thing.x)")
def boolean_reset_to_a_number() -> object:
    return reset(thing.on, thing.x)


@corpus.wrong("AC147", "n", "return reset(thing.n, 0.5)")
def half_an_integer() -> object:
    return reset(thing.n, 0.5)


@corpus.wrong("AC147", "on", "return make(on=2.0)")
def boolean_given_a_number() -> object:
    return make(on=2.0)


@corpus.wrong("AC149", "fatal", 'return assert_(thing.x > 0, "below ground", level="fatal")')
def unknown_level() -> object:
    return assert_(thing.x > 0, "below ground", level="fatal")


@corpus.wrong("AC149", "terminate", "return terminate(anything)")
def terminate_without_a_reason() -> object:
    return terminate(anything)


@corpus.wrong("AC149", "smooth", "return smooth(-1, thing.x)")
def smooth_of_no_order() -> object:
    return smooth(-1, thing.x)


@corpus.broken("AC145", "n", "yield self.n == 1", "yield self.n == pre(self.n) + 1")
class TwoEquations(Component):
    n: Real = integer()

    def equations(self) -> Equations:
        yield self.n == 1
        yield self.n == pre(self.n) + 1


@corpus.broken("AC145", "n", "yield self.n == where(self.x > 1.0, 1, 0)", "yield when(self.x > 2.0, reset(self.n, 2))")
class EquationAndReset(Component):
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.n == where(self.x > 1.0, 1, 0)
        yield when(self.x > 2.0, reset(self.n, 2))


@corpus.broken("AC145", "relay.u", "yield self.relay.u == ~self.on", "Relay(u=self.on)")
class BoundAndConnectedInside(Component):
    relay: Relay = part()
    on: Real = boolean()

    def build(self) -> None:
        self.relay = Relay(u=self.on)

    def equations(self) -> Equations:
        yield self.on == pre(self.on)
        yield self.relay.u == ~self.on


@corpus.broken("AC146", "pre(x)", "yield self.y == pre(self.x)")
class PreOfAState(Component):
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == pre(self.x)


@corpus.broken("AC147", "on", "yield self.on == self.x")
class NumberForABoolean(Component):
    x: Real = variable(default=fixed(0.0))
    on: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.on == self.x


@corpus.broken("AC147", "relay.y", "yield connect(self.relay.y, self.y)")
class BooleanToNumber(Component):
    relay: Relay = Relay(u=True)
    y: Real = signal_output()

    def equations(self) -> Equations:
        yield connect(self.relay.y, self.y)


@corpus.broken("AC148", "relay.u", "Relay()")
class OpenInput(Component):
    relay: Relay = Relay()


@corpus.broken("AC148", "y", "cls()")
class OpenOutput(Component):
    y: Real = boolean_output()


@corpus.broken("AC155", "kept", "yield when(sample(0.0, 0.1), reset(self.kept, self.x))")
class ResetToAnotherUnit(Component):
    x: Real = variable(unit="m/s", default=fixed(0.0))
    kept: Real = discrete(unit="m")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.0, 0.1), reset(self.kept, self.x))


@corpus.broken("AC155", "x", 'yield assert_(self.x < self.kept, "too fast")')
class ConditionMixesUnits(Component):
    x: Real = variable(unit="m/s", default=fixed(0.0))
    kept: Real = discrete(unit="m")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield assert_(self.x < self.kept, "too fast")


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
