"""Class bodies and constructors that are wrong in Python's own terms, and values of the wrong dimension."""

from __future__ import annotations

from typing import Any

import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    der,
    discrete,
    fixed,
    parameter,
    part,
    pre,
    reset,
    sample,
    sign,
    variable,
    when,
)
from acausal.analyse.aliases import reduce
from acausal.diagnose.constraints import undetermined
from acausal.flatten.flatten import flatten
from acausal.library import translational
from acausal.library.multibody import Body
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


@corpus.wrong("AC109", "Typed defines __init__", "def __init__(self) -> None:")
def constructor_that_does_nothing() -> None:
    class Typed(Decay):
        def __init__(self) -> None:
            pass

    acausal.compile(Typed())


@corpus.wrong("AC126", "Fast.k hides the parameter k", "k = 2.0  # type: ignore[assignment]")
def value_that_hides_a_field() -> None:
    class Fast(Decay):
        k = 2.0  # type: ignore[assignment]

    Fast()


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


@corpus.wrong("AC105", "shape='3'", 'variable(shape="3")  # type: ignore[arg-type]')
def shape_in_words() -> None:
    variable(shape="3")  # type: ignore[arg-type]


@corpus.wrong("AC110", "min=10 is above max=1", "parameter(min=10.0, max=1.0)")
def limits_the_wrong_way_round() -> None:
    parameter(min=10.0, max=1.0)


@corpus.wrong("AC110", "nominal=0", "variable(nominal=0.0)")
def no_magnitude() -> None:
    variable(nominal=0.0)


@corpus.wrong("AC105", "ShortStart: 'r'", "r: Real = variable(shape=3, default=fixed((0.0, 0.0)))")
def default_of_another_shape() -> None:
    class ShortStart(Component):
        r: Real = variable(shape=3, default=fixed((0.0, 0.0)))

    ShortStart()


@corpus.broken("AC144", "`a` is a parameter", "yield der(self.a) == 1.0")
class ParameterThatMoves(Component):
    a: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.a * self.x
        yield der(self.a) == 1.0


@corpus.broken("AC144", "`d` is discrete", "yield der(self.x) == der(self.d)")
class RateOfACounter(Component):
    d: Real = discrete()
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == der(self.d)
        yield when(self.x > 2.0, reset(self.d, pre(self.d) + 1.0))


@corpus.broken("AC144", "sign(x)", "yield self.y == der(self.x * self.x + 2.0 * sign(self.x))")
class RateOfASign(Component):
    """The derivative of a sign is zero wherever it exists."""

    x: Real = variable(default=1.0)
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.y == der(self.x * self.x + 2.0 * sign(self.x))


@corpus.broken("AC145", "d is reset twice", "yield when(self.x > 0.5, reset(self.d, 1.0), reset(self.d, 2.0))")
class TwoNewValues(Component):
    d: Real = discrete()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.5, reset(self.d, 1.0), reset(self.d, 2.0))


@corpus.bad_start("AC505", "its interval is 0 s", "yield when(sample(0.0, self.period), reset(self.d, self.x))")
class StoppedClock(Component):
    d: Real = discrete()
    period: Real = parameter(default=0.0, unit="s")
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.0, self.period), reset(self.d, self.x))


@corpus.broken("AC155", "mass.m == length", "translational.Mass(m=self.length)")
class MassInMetres(Component):
    length: Real = parameter(default=1.0, unit="m")
    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=self.length)


@corpus.broken(
    "AC155",
    "area == length * length",
    'area: Real = parameter(default=lambda self: self.length * self.length, unit="m")',
)
class AreaInMetres(Component):
    length: Real = parameter(default=1.0, unit="m")
    area: Real = parameter(default=lambda self: self.length * self.length, unit="m")
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == self.area


@corpus.broken("AC155", "mass.s == weight", "translational.Mass(m=1.0, s=fixed(self.weight))")
class StartInKilograms(Component):
    weight: Real = parameter(default=1.0, unit="kg")
    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0, s=fixed(self.weight))


@corpus.broken("AC155", "force.u == mass.s", "translational.Force(u=self.mass.s)")
class ForceInMetres(Component):
    mass: translational.Mass = part()
    force: translational.Force = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0)
        self.force = translational.Force(u=self.mass.s)


@corpus.broken("AC155", "body.r_CM == (weight, 0, 0)", "Body(m=1.0, r_CM=(self.weight, 0.0, 0.0))")
class VectorInKilograms(Component):
    """Literals of a vector adapt to the entries that have a unit."""

    weight: Real = parameter(default=1.0, unit="kg")
    body: Body = part()

    def build(self) -> None:
        self.body = Body(m=1.0, r_CM=(self.weight, 0.0, 0.0))


@corpus.bad_start(
    "AC302", "`x + y == 1` and `x + y == 3`", "yield self.x + self.y == 1.0", "yield self.x + self.y == 3.0"
)
class TwoSums(Component):
    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -self.x
        yield der(self.y) == -self.y

    def initial_equations(self) -> Equations:
        yield self.x + self.y == 1.0
        yield self.x + self.y == 3.0


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


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
