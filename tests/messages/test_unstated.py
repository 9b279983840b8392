"""What is stated and not yielded would be lost; it is refused with its line (AC186)."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    discrete,
    equals,
    fixed,
    flatten,
    parameter,
    part,
    reset,
    variable,
    when,
    where,
)
from acausal.errors import DeclarationError
from acausal.library import translational
from tests.expected import fails_with
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Oscillator(Component):
    """A mass on a spring; subclasses damp it, or forget to."""

    mass: translational.Mass = translational.Mass(m=1.0, s=fixed(0.1))
    spring: translational.Spring = translational.Spring(c=100.0)
    damper: translational.Damper = translational.Damper(d=1.0)
    wall: translational.Fixed = translational.Fixed()

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


@corpus.broken("AC186", "calls `self.outputs()`", "self.outputs()")
class Helper(Component):
    """Nobody yields what it makes."""

    x: Real = variable(default=1.0)
    y: Real = variable()

    def outputs(self) -> Equations:
        yield self.y == self.x

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        self.outputs()


corpus.table(
    """
Connection(Oscillator) AC186 Connection.equations makes `connect(wall.flange, damper.flange_a)`
> eq: connect(self.wall.flange, self.damper.flange_a)
yield connect(self.damper.flange_b, self.mass.flange_a)

OneOfAList(Oscillator) AC186 damper.flange_b
eq: made = [connect(self.wall.flange, self.damper.flange_a), <<connect(self.damper.flange_b, self.mass.flange_a)>>]
yield made[0]

OfALeaf AC186 `y == 2 * x`
x: Real = variable(default=1.0)
y: Real = variable()
yield der(self.x) == -self.x
eq: y = <<self.y == 2.0 * self.x>>

InBuild(Oscillator) AC186 InBuild.build makes `connect(wall.flange, damper.flange_a)`, and 1 more
> build: connect(self.wall.flange, self.damper.flange_a)
> build: connect(self.damper.flange_b, self.mass.flange_a)

InBuildWithoutEquations AC186 InBuildWithoutEquations.build
a: translational.Mass = translational.Mass(m=1.0)
b: translational.Mass = translational.Mass(m=1.0)
> build: connect(self.a.flange_b, self.b.flange_a)

BuildThatYields(Oscillator) AC129 BuildThatYields.build yields
> def build(self):
build: yield connect(self.wall.flange, self.damper.flange_a)

ResetWithoutWhen AC186 reset(n, 1)
x: Real = variable(default=1.0)
n: Real = discrete()
yield der(self.x) == -self.x
eq: add = <<reset(self.n, 1.0)>>
yield when(self.x < 0.5, reset(self.x, 1.0))
eq: del add

WhenAndAssertion AC186 and 1 more
x: Real = variable(default=1.0)
yield der(self.x) == -self.x
> eq: when(self.x < 0.5, reset(self.x, 1.0))
> eq: assert_(self.x > 0.0, "x is positive")

Branch(Oscillator) AC186 elsewhen
# At the line of the `elsewhen`.
n: Real = discrete()
eq: first = when(self.mass.s > 0.1, reset(self.n, 1.0))
yield first
> eq: first.elsewhen(self.mass.s > 0.05, reset(self.n, 2.0))

Sum(Oscillator) AC186 an expression
> eq: self.damper.s_rel - self.spring.s_rel
yield connect(self.damper.flange_b, self.mass.flange_a)

Comparison(Oscillator) AC186 an expression
yield connect(self.damper.flange_b, self.mass.flange_a)
> eq: self.mass.s > 0.0
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()


def test_what_build_keeps_and_equations_yield_is_not_lost() -> None:
    class Damped(Oscillator):
        def build(self) -> None:
            self.ends = [
                connect(self.wall.flange, self.damper.flange_a),
                connect(self.damper.flange_b, self.mass.flange_a),
            ]

        def equations(self) -> Equations:
            yield from self.ends

    assert flatten(Damped()).equations


def test_what_is_used_is_not_refused() -> None:
    """Lists, branches of a `when`, helpers, conditions: whatever reaches a yield."""

    class Rate(Component):
        k: Real = parameter(default=2.0)
        x: Real = variable(default=1.0)
        n: Real = discrete()
        on: Real = variable()

        def rates(self, x: Any) -> Equations:
            yield der(x) == -self.k * x

        def equations(self) -> Equations:
            later = [self.on == where(equals(self.n, 1.0), 1.0, 0.0)]
            once = reset(self.n, 1.0)
            clause = when(self.x < 0.5, once)
            clause = clause.elsewhen(self.x < 0.2, reset(self.n, 2.0))
            yield from self.rates(self.x)
            yield clause
            yield from later

    class Two(Component):
        rates: list[Rate] = part()

        def build(self) -> None:
            self.rates = [Rate(k=float(k)) for k in (1, 2)]

    assert len(flatten(Two()).equations) == len(flatten(Rate()).equations) * 2


def test_a_connection_outside_of_a_component() -> None:
    """Of a model that exists already: nothing would yield it, and the mass would swing undamped."""
    model = Oscillator()
    with fails_with(DeclarationError, "AC186", match=r"`connect\(damper.flange_b, mass.flange_a\)` is made outside"):
        connect(model.damper.flange_b, model.mass.flange_a)
