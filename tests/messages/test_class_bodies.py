"""Class bodies and constructors that are wrong in Python's own terms, and values of the wrong dimension."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    der,
    fixed,
    parameter,
    part,
    variable,
)
from acausal.analyse.aliases import reduce
from acausal.diagnose.constraints import undetermined
from acausal.flatten.flatten import flatten
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Bound(Component):
    k: Real = parameter(default=lambda: 1.0)


class Decay(Component):
    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * self.x


@corpus.wrong(
    "AC109",
    "Typed defines __init__",
    "def __init__(self, rate: float) -> None:",
    text="""
error[AC109]: Typed defines __init__
  at      test_class_bodies.py:N
              def __init__(self, rate: float) -> None:
  cause   acausal makes the constructor, which takes the fields by name
  help    declare the arguments as parameter(...) or structural(...), and make parts in `build`
""",
)
def constructor_of_its_own() -> None:
    class Typed(Decay):
        def __init__(self, rate: float) -> None:
            self.rate = rate

    Typed(2.0)


@corpus.broken("AC109", "Selfless.equations", "def equations() -> Equations:  # type: ignore[misc]")
class Selfless(Component):
    x: Real = variable()

    def equations() -> Equations:  # type: ignore[misc]
        yield from ()


@corpus.wrong("AC109", "Bound.k", "k: Real = parameter(default=lambda: 1.0)")
def default_without_the_instance() -> None:
    Bound()


@corpus.broken("AC129", "Listed.equations returns a list", "def equations(self) -> Any:")
class Listed(Component):
    x: Real = variable()

    def equations(self) -> Any:
        return [der(self.x) == -self.x]


@corpus.wrong("AC138", "Hen -> Egg -> Hen", "def build(self) -> None:")
def hen_and_egg() -> None:
    Hen()


class Hen(Component):
    egg: Component = part()

    def build(self) -> None:
        self.egg = Egg()


class Egg(Component):
    hen: Hen = part()

    def build(self) -> None:
        self.hen = Hen()


class Spiral(Component):
    x: Real = variable()
    v: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.v - self.x
        yield der(self.v) == -self.x


@corpus.wrong("AC208", "nothing determines v", "yield der(self.v) == -self.x")
def constraint_that_determines_nothing() -> None:
    """The last line of defence: of six thousand random systems none came here, other messages were better."""
    raise undetermined(reduce(flatten(Spiral())), [1], [1])


corpus.table(
    """
AC105 shape='3' -- variable(shape="3")
AC110 min=10 is above max=1 -- parameter(min=10.0, max=1.0)
AC110 nominal=0 -- variable(nominal=0.0)

constructor_that_does_nothing AC109 Typed defines __init__
class Typed(Decay):
>     def __init__(self) -> None:
        pass
acausal.compile(Typed())

value_that_hides_a_field AC126 Fast.k hides the parameter k
class Fast(Decay):
>     k = 2.0
Fast()

ParameterThatMoves AC144 `a` is a parameter
a: Real = parameter(default=1.0)
x: Real = variable(default=fixed(1.0))
yield der(self.x) == -self.a * self.x
> yield der(self.a) == 1.0

RateOfACounter AC144 `d` is discrete
d: Real = discrete()
x: Real = variable(default=fixed(1.0))
> yield der(self.x) == der(self.d)
yield when(self.x > 2.0, reset(self.d, pre(self.d) + 1.0))

RateOfASign AC144 sign(x)
# The derivative of a sign is zero wherever it exists.
x: Real = variable(default=1.0)
y: Real = variable()
yield der(self.x) == -1.0
> yield self.y == der(self.x * self.x + 2.0 * sign(self.x))

TwoNewValues AC145 d is reset twice
d: Real = discrete()
x: Real = variable(default=fixed(0.0))
yield der(self.x) == 1.0
> yield when(self.x > 0.5, reset(self.d, 1.0), reset(self.d, 2.0))

StoppedClock AC505 its interval is 0 s
d: Real = discrete()
period: Real = parameter(default=0.0, unit="s")
x: Real = variable(default=fixed(0.0))
yield der(self.x) == 1.0
> yield when(sample(0.0, self.period), reset(self.d, self.x))

MassInMetres AC155 mass.m == length
length: Real = parameter(default=1.0, unit="m")
mass: translational.Mass = part()
build: self.mass = <<translational.Mass(m=self.length)>>

StartInKilograms AC155 mass.s == weight
weight: Real = parameter(default=1.0, unit="kg")
mass: translational.Mass = part()
build: self.mass = <<translational.Mass(m=1.0, s=fixed(self.weight))>>

ForceInMetres AC155 force.u == mass.s
mass: translational.Mass = part()
force: translational.Force = part()
build: self.mass = translational.Mass(m=1.0)
build: self.force = <<translational.Force(u=self.mass.s)>>

VectorInKilograms AC155 body.r_CM == (weight, 0, 0)
# Literals of a vector adapt to the entries that have a unit.
weight: Real = parameter(default=1.0, unit="kg")
body: multibody.Body = part()
build: self.body = <<multibody.Body(m=1.0, r_CM=(self.weight, 0.0, 0.0))>>

default_of_another_shape AC105 ShortStart: 'r'
class ShortStart(Component):
>     r: Real = variable(shape=3, default=fixed((0.0, 0.0)))
ShortStart()

AreaInMetres AC155 area == length * length
length: Real = parameter(default=1.0, unit="m")
> area: Real = parameter(default=lambda self: self.length * self.length, unit="m")
x: Real = variable(unit="m")
yield self.x == self.area
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
