"""AC108, AC140 to AC149: misuse of the language of events."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    boolean,
    boolean_input,
    boolean_output,
    discrete,
    integer,
    parameter,
    part,
    pre,
    variable,
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


@corpus.broken("AC145", "relay.u", "yield self.relay.u == ~self.on", "Relay(u=self.on)")
class BoundAndConnectedInside(Component):
    relay: Relay = part()
    on: Real = boolean()

    def build(self) -> None:
        self.relay = Relay(u=self.on)

    def equations(self) -> Equations:
        yield self.on == pre(self.on)
        yield self.relay.u == ~self.on


@corpus.broken("AC148", "y", "cls()")
class OpenOutput(Component):
    y: Real = boolean_output()


corpus.table(
    """
AC108 n == 1 -- where(thing.n == 1, 1.0, thing.x)
AC108 True -- where(True, 1.0, thing.x)
AC108 x -- thing.x & thing.on
AC108 n -- ~thing.n
AC108 n -- when(thing.n, reset(thing.kept, 1.0))
AC108 kept -- edge(thing.kept)
AC108 () -- when((), reset(thing.n, 1))
AC140 3 -- when(thing.x > 0, 3)
AC141 k -- reset(thing.k, 1.0)
AC141 x + 1 -- reset(thing.x + 1.0, 0.0)
AC105 on -- reset(thing.on, thing.v)
AC146 x -- change(thing.x)
AC146 x -- equals(thing.x, 1.0)
AC147 on -- reset(thing.on, thing.x)
AC147 n -- reset(thing.n, 0.5)
AC147 on -- Thing(on=2.0)
AC149 fatal -- assert_(thing.x > 0, "below ground", level="fatal")
AC149 terminate -- terminate(0)
AC149 smooth -- smooth(-1, thing.x)

TwoEquations AC145 n
n: Real = integer()
> yield self.n == 1
> yield self.n == pre(self.n) + 1

EquationAndReset AC145 n
x: Real = variable(default=fixed(0.0))
n: Real = integer()
yield der(self.x) == 1.0
> yield self.n == where(self.x > 1.0, 1, 0)
> yield when(self.x > 2.0, reset(self.n, 2))

PreOfAState AC146 pre(x)
x: Real = variable(default=fixed(0.0))
y: Real = variable()
yield der(self.x) == 1.0
> yield self.y == pre(self.x)

ValueThatVaries AC146 kept
x: Real = variable(unit="m", default=fixed(0.0))
kept: Real = discrete(unit="m")
yield der(self.x) == 1.0
> yield self.kept == self.x

ValueWithoutEvent AC146 on
x: Real = variable(default=fixed(0.0))
on: Real = boolean()
yield der(self.x) == 1.0
> yield self.on == no_event(self.x > 0.5)

DelayedValue AC146 kept
x: Real = variable(default=fixed(0.0))
kept: Real = discrete()
yield der(self.x) == 1.0
> yield self.kept == where(self.x > 0.5, delay(self.x, 0.1), 0.0)

WhenWithoutEvent AC146 x > 0.5
x: Real = variable(default=fixed(0.0))
on: Real = boolean()
yield der(self.x) == 1.0
> yield when(no_event(self.x > 0.5), reset(self.on, True))

WhenHalfWithoutEvent AC146 x > 0.5
x: Real = variable(default=fixed(0.0))
on: Real = boolean()
yield der(self.x) == 1.0
> yield when((self.x > 0.1) & no_event(self.x > 0.5), reset(self.on, True))

EdgeWithoutEvent AC146 edge
x: Real = variable(default=fixed(0.0))
on: Real = boolean()
yield der(self.x) == 1.0
> yield when(edge(no_event(self.x > 0.5)), reset(self.on, True))

AssertedEdge AC146 edge
x: Real = variable(default=fixed(0.0))
yield der(self.x) == 1.0
> yield assert_(~edge(self.x > 0.5), "never checked")

NumberForABoolean AC147 on
x: Real = variable(default=fixed(0.0))
on: Real = boolean()
yield der(self.x) == 1.0
> yield self.on == self.x

BooleanToNumber AC147 relay.y
relay: Relay = Relay(u=True)
y: Real = signal_output()
> yield connect(self.relay.y, self.y)

OpenInput AC148 relay.u
relay: Relay = <<Relay()>>

ResetToAnotherUnit AC155 kept
x: Real = variable(unit="m/s", default=fixed(0.0))
kept: Real = discrete(unit="m")
yield der(self.x) == 1.0
> yield when(sample(0.0, 0.1), reset(self.kept, self.x))

ConditionMixesUnits AC155 x
x: Real = variable(unit="m/s", default=fixed(0.0))
kept: Real = discrete(unit="m")
yield der(self.x) == 1.0
> yield assert_(self.x < self.kept, "too fast")
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
