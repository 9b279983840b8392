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
    """
error[AC108]: `x` is a number, not a condition
  at      test_event_messages.py:N
              return where(thing.x, 1.0, 2.0)
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def where_of_a_number() -> object:
    return where(thing.x, 1.0, 2.0)


@corpus.wrong(
    "AC108",
    "n == 1",
    """
error[AC108]: `n == 1` is an equation, not a condition
  at      test_event_messages.py:N
              return where(thing.n == 1, 1.0, thing.x)
  help    whole numbers are compared with equals(a, b)
""",
)
def where_of_an_equation() -> object:
    return where(thing.n == 1, 1.0, thing.x)


@corpus.wrong(
    "AC108",
    "True",
    """
error[AC108]: `True` (bool) is not a condition
  at      test_event_messages.py:N
              return where(True, 1.0, thing.x)  # type: ignore[arg-type]
  help    write a relation such as x > 0; what is known to Python is decided with a plain `if`
""",
)
def where_of_python() -> object:
    return where(True, 1.0, thing.x)  # type: ignore[arg-type]


@corpus.wrong(
    "AC108",
    "x",
    """
error[AC108]: `x` is a number, not a condition
  at      test_event_messages.py:N
              return thing.x & thing.on
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def and_of_a_number() -> object:
    return thing.x & thing.on


@corpus.wrong(
    "AC108",
    "n",
    """
error[AC108]: `n` is a number, not a condition
  at      test_event_messages.py:N
              return ~thing.n
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def not_of_an_integer() -> object:
    return ~thing.n


@corpus.wrong(
    "AC108",
    "n",
    """
error[AC108]: `n` is a number, not a condition
  at      test_event_messages.py:N
              return when(thing.n, reset(thing.kept, 1.0))
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def when_an_integer() -> object:
    return when(thing.n, reset(thing.kept, 1.0))


@corpus.wrong(
    "AC108",
    "kept",
    """
error[AC108]: `kept` is a number, not a condition
  at      test_event_messages.py:N
              return edge(thing.kept)
  help    write a relation such as x > 0, or declare it with boolean()
""",
)
def edge_of_a_number() -> object:
    return edge(thing.kept)


@corpus.wrong(
    "AC108",
    "()",
    """
error[AC108]: `()` (tuple) is not a condition
  at      test_event_messages.py:N
              return when((), reset(thing.n, 1))
  help    write a relation such as x > 0; what is known to Python is decided with a plain `if`
""",
)
def when_nothing() -> object:
    return when((), reset(thing.n, 1))


@corpus.wrong(
    "AC140",
    "3",
    """
error[AC140]: `3` is not an action
  at      test_event_messages.py:N
              return when(thing.x > 0, 3)  # type: ignore[arg-type]
  help    write when(condition, reset(x, value)) or when(condition, terminate("why"))
""",
)
def when_without_action() -> object:
    return when(thing.x > 0, 3)  # type: ignore[arg-type]


@corpus.wrong(
    "AC141",
    "k",
    """
error[AC141]: `k` cannot be reset: it is a parameter
  at      test_event_messages.py:N
              return reset(thing.k, 1.0)
  help    declare what changes at events with discrete(), boolean() or integer()
""",
)
def reset_of_a_parameter() -> object:
    return reset(thing.k, 1.0)


@corpus.wrong(
    "AC141",
    "x + 1",
    """
error[AC141]: `x + 1` cannot be reset
  at      test_event_messages.py:N
              return reset(thing.x + 1.0, 0.0)
  help    reset takes one declared scalar variable
""",
)
def reset_of_an_expression() -> object:
    return reset(thing.x + 1.0, 0.0)


@corpus.wrong(
    "AC105",
    "on",
    """
error[AC105]: `on` is a scalar, its new value `v` has shape (3,)
  at      test_event_messages.py:N
              return reset(thing.on, thing.v)
""",
)
def reset_to_a_vector() -> object:
    return reset(thing.on, thing.v)


@corpus.wrong(
    "AC146",
    "x",
    """
error[AC146]: change(`x`) has no meaning: it is not discrete
  at      test_event_messages.py:N
              return change(thing.x)
  help    declare it with boolean(), integer() or discrete(), or write a relation
""",
)
def change_of_what_always_changes() -> object:
    return change(thing.x)


@corpus.wrong(
    "AC146",
    "x",
    """
error[AC146]: equals(`x`, `1`): `x` is not discrete
  at      test_event_messages.py:N
              return equals(thing.x, 1.0)
  help    compare what varies continuously with < and >
""",
)
def equality_of_numbers() -> object:
    return equals(thing.x, 1.0)


@corpus.wrong(
    "AC147",
    "on",
    """
error[AC147]: `on` is true or false, `x` is a number
  at      test_event_messages.py:N
              return reset(thing.on, thing.x)
  help    write a relation such as x > 0, or True or False
""",
)
def boolean_reset_to_a_number() -> object:
    return reset(thing.on, thing.x)


@corpus.wrong(
    "AC147",
    "n",
    """
error[AC147]: `n` is an integer, `0.5` is not
  at      test_event_messages.py:N
              return reset(thing.n, 0.5)
  help    a number that is not whole goes into discrete()
""",
)
def half_an_integer() -> object:
    return reset(thing.n, 0.5)


@corpus.wrong(
    "AC147",
    "on",
    """
error[AC147]: Thing: 'on' is true or false, `2` is a number
  at      test_event_messages.py:N
              return make(on=2.0)
  help    write a relation such as x > 0, or True or False
""",
)
def boolean_given_a_number() -> object:
    return make(on=2.0)


@corpus.wrong(
    "AC149",
    "fatal",
    """
error[AC149]: assert_ has no level 'fatal'
  at      test_event_messages.py:N
              return assert_(thing.x > 0, "below ground", level="fatal")
  help    it is "error" or "warning"
""",
)
def unknown_level() -> object:
    return assert_(thing.x > 0, "below ground", level="fatal")


@corpus.wrong(
    "AC149",
    "terminate",
    """
error[AC149]: terminate takes a message, not 0
  at      test_event_messages.py:N
              return terminate(anything)
  help    say in words what has happened
""",
)
def terminate_without_a_reason() -> object:
    return terminate(anything)


@corpus.wrong(
    "AC149",
    "smooth",
    """
error[AC149]: smooth: `-1` is not an order
  at      test_event_messages.py:N
              return smooth(-1, thing.x)
  help    write smooth(1, expression)
""",
)
def smooth_of_no_order() -> object:
    return smooth(-1, thing.x)


@corpus.broken(
    "AC145",
    "n",
    """
error[AC145]: n is determined twice at events
  at      test_event_messages.py:N
              yield self.n == 1
  at      test_event_messages.py:N
              yield self.n == pre(self.n) + 1
          n == 1
          n == pre(n) + 1
  cause   a discrete variable has one equation, or is reset by `when`s, not both
  help    join them to one: where(condition, value, where(other, value, pre(variable)))
""",
)
class TwoEquations(Component):
    n: Real = integer()

    def equations(self) -> Equations:
        yield self.n == 1
        yield self.n == pre(self.n) + 1


@corpus.broken(
    "AC145",
    "n",
    """
error[AC145]: n is determined twice at events
  at      test_event_messages.py:N
              yield self.n == where(self.x > 1.0, 1, 0)
  at      test_event_messages.py:N
              yield when(self.x > 2.0, reset(self.n, 2))
          n == where(x > 1, 1, 0)
          when(x > 2, reset(n, 2))
  cause   a discrete variable has one equation, or is reset by `when`s, not both
  help    join them to one: where(condition, value, where(other, value, pre(variable)))
""",
)
class EquationAndReset(Component):
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.n == where(self.x > 1.0, 1, 0)
        yield when(self.x > 2.0, reset(self.n, 2))


@corpus.broken(
    "AC145",
    "relay.u",
    """
error[AC145]: relay.u is determined twice at events
  at      test_event_messages.py:N
              yield self.relay.u == ~self.on
  at      test_event_messages.py:N
              self.relay = Relay(u=self.on)
                           ^^^^^^^^^^^^^^^^
          relay.u == ~on
          relay.u == on
  cause   a discrete variable has one equation, or is reset by `when`s, not both
  help    join them to one: where(condition, value, where(other, value, pre(variable)))
""",
)
class BoundAndConnectedInside(Component):
    relay: Relay = part()
    on: Real = boolean()

    def build(self) -> None:
        self.relay = Relay(u=self.on)

    def equations(self) -> Equations:
        yield self.on == pre(self.on)
        yield self.relay.u == ~self.on


@corpus.broken(
    "AC146",
    "pre(x)",
    """
error[AC146]: `pre(x)`: `x` is not discrete
  at      test_event_messages.py:N
              yield self.y == pre(self.x)
          y == pre(x)
  cause   between events it is always changing: there is no value it had before
  help    use it in a `when`, or keep the value in a discrete(): yield when(condition, reset(self.held, x))
""",
)
class PreOfAState(Component):
    x: Real = variable(default=fixed(0.0))
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == pre(self.x)


@corpus.broken(
    "AC147",
    "on",
    """
error[AC147]: `on` is true or false, `x` is a number
  at      test_event_messages.py:N
              yield self.on == self.x
  help    write a relation such as x > 0, or True or False
""",
)
class NumberForABoolean(Component):
    x: Real = variable(default=fixed(0.0))
    on: Real = boolean()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.on == self.x


@corpus.broken(
    "AC147",
    "relay.y",
    """
error[AC147]: `relay.y` is true or false, `y` is a number: they cannot be connected
  at      test_event_messages.py:N
              yield connect(self.relay.y, self.y)
  help    put a BooleanToReal or a GreaterThreshold of acausal.library.blocks between them
""",
)
class BooleanToNumber(Component):
    relay: Relay = part()
    y: Real = signal_output()

    def build(self) -> None:
        self.relay = Relay(u=True)

    def equations(self) -> Equations:
        yield connect(self.relay.y, self.y)


@corpus.broken(
    "AC148",
    "relay.u",
    """
error[AC148]: relay.u has no value: nothing is connected to it
  at      test_event_messages.py:N
              self.relay = Relay()
                           ^^^^^^^
          relay.u   Switches it
  help    connect it to a boolean_output, or bind it: Relay(u=...)
""",
)
class OpenInput(Component):
    relay: Relay = part()

    def build(self) -> None:
        self.relay = Relay()


@corpus.broken(
    "AC148",
    "y",
    """
error[AC148]: y has no value: no equation assigns it
  at      cases.py:N
              return self._model(code, named, text, lambda cls: acausal.compile(cls()))
                                                                                ^^^^^
  help    yield self.y == condition in OpenOutput.equations
""",
)
class OpenOutput(Component):
    y: Real = boolean_output()


@corpus.broken(
    "AC155",
    "kept",
    """
error[AC155]: `kept == x`: the left side is in m, the right side in m/s
  at      test_event_messages.py:N
              yield when(sample(0.0, 0.1), reset(self.kept, self.x))
          kept  [m]
          x  [m/s]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class ResetToAnotherUnit(Component):
    x: Real = variable(unit="m/s", default=fixed(0.0))
    kept: Real = discrete(unit="m")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.0, 0.1), reset(self.kept, self.x))


@corpus.broken(
    "AC155",
    "x",
    """
error[AC155]: `x < kept` mixes m/s and m
  at      test_event_messages.py:N
              yield assert_(self.x < self.kept, "too fast")
          x  [m/s]
          kept  [m]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class ConditionMixesUnits(Component):
    x: Real = variable(unit="m/s", default=fixed(0.0))
    kept: Real = discrete(unit="m")

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield assert_(self.x < self.kept, "too fast")


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
