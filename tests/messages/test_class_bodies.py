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
from acausal.flatten.flatten import flatten
from acausal.library import translational
from acausal.library.multibody import Body
from acausal.lower.diagnosis.differentiated import undetermined
from acausal.lower.reduce import reduce
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
    """
error[AC109]: Typed defines __init__
  at      test_class_bodies.py:N
              def __init__(self, rate: float) -> None:
  cause   fields are given to the constructor by name; it is made by acausal
  help    declare the arguments as parameter(...) or structural(...), and make parts in `build`
""",
)
def constructor_of_its_own() -> None:
    class Typed(Decay):
        def __init__(self, rate: float) -> None:
            self.rate = rate

    Typed(2.0)


@corpus.wrong(
    "AC109",
    "Typed defines __init__",
    """
error[AC109]: Typed defines __init__
  at      test_class_bodies.py:N
              def __init__(self) -> None:
  cause   fields are given to the constructor by name; it is made by acausal
  help    declare the arguments as parameter(...) or structural(...), and make parts in `build`
""",
)
def constructor_that_does_nothing() -> None:
    class Typed(Decay):
        def __init__(self) -> None:
            pass

    acausal.compile(Typed())


@corpus.wrong(
    "AC126",
    "Fast.k hides the parameter k",
    """
error[AC126]: Fast.k hides the parameter k that it inherits
  at      test_class_bodies.py:N
              k = 2.0  # type: ignore[assignment]
  help    give the value where it is made: Fast(k=...), or in `build`: self.k = ...
""",
)
def value_that_hides_a_field() -> None:
    class Fast(Decay):
        k = 2.0  # type: ignore[assignment]

    Fast()


@corpus.broken(
    "AC109",
    "Selfless.equations",
    """
error[AC109]: Selfless.equations cannot be called: Selfless.equations() takes 0 positional arguments but 1 was given
  at      test_class_bodies.py:N
              def equations() -> Equations:  # type: ignore[misc]
  help    write it as `def equations(self) -> Equations`
""",
)
class Selfless(Component):
    x: Real = variable()

    def equations() -> Equations:  # type: ignore[misc]
        yield from ()


@corpus.wrong(
    "AC109",
    "Bound.k",
    """
error[AC109]: the default of Bound.k cannot be called: Bound.<lambda>() takes 0 positional arguments but 1 was given
  at      test_class_bodies.py:N
              k: Real = parameter(default=lambda: 1.0)
  help    write it as `default=lambda self: ...`
""",
)
def default_without_the_instance() -> None:
    Bound()


@corpus.broken(
    "AC129",
    "Listed.equations returns a list",
    """
error[AC129]: Listed.equations returns a list and yields nothing
  at      test_class_bodies.py:N
              def equations(self) -> Any:
  help    every equation needs a `yield`: yield left == right
""",
)
class Listed(Component):
    x: Real = variable()

    def equations(self) -> Any:
        return [der(self.x) == -self.x]


@corpus.wrong(
    "AC138",
    "Hen -> Egg -> Hen",
    """
error[AC138]: Hen is built inside itself without end: Hen -> Egg -> Hen
  at      test_class_bodies.py:N
              def build(self) -> None:
  help    a part cannot hold what it is a part of; end the recursion by a structural number
""",
)
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


@corpus.wrong(
    "AC105",
    "shape='3'",
    """
error[AC105]: shape='3' is no shape
  at      test_class_bodies.py:N
              variable(shape="3")  # type: ignore[arg-type]
  help    shape=3 declares a vector, shape=(3, 3) a matrix; leave it out for a scalar
""",
)
def shape_in_words() -> None:
    variable(shape="3")  # type: ignore[arg-type]


@corpus.wrong(
    "AC110",
    "min=10 is above max=1",
    """
error[AC110]: min=10 is above max=1
  at      test_class_bodies.py:N
              parameter(min=10.0, max=1.0)
  help    swap the two, or leave out what has no limit
""",
)
def limits_the_wrong_way_round() -> None:
    parameter(min=10.0, max=1.0)


@corpus.wrong(
    "AC110",
    "nominal=0",
    """
error[AC110]: nominal=0 is no magnitude
  at      test_class_bodies.py:N
              variable(nominal=0.0)
  help    give the usual size of the variable: nominal=1e-3
""",
)
def no_magnitude() -> None:
    variable(nominal=0.0)


@corpus.wrong(
    "AC105",
    "ShortStart: 'r'",
    """
error[AC105]: ShortStart: 'r' is a vector of 3, the value `(0, 0)` a vector of 2
  at      test_class_bodies.py:N
              r: Real = variable(shape=3, default=fixed((0.0, 0.0)))
  help    a single number fills a vector or a matrix; anything else needs its shape
""",
)
def default_of_another_shape() -> None:
    class ShortStart(Component):
        r: Real = variable(shape=3, default=fixed((0.0, 0.0)))

    ShortStart()


@corpus.broken(
    "AC144",
    "`a` is a parameter",
    """
error[AC144]: `der(a)`: `a` is a parameter and has no derivative
  at      test_class_bodies.py:N
              yield der(self.a) == 1.0
          der(a) == 1
  cause   it is constant in a run
  help    declare what changes in time by variable(): a: Real = variable(...)
""",
)
class ParameterThatMoves(Component):
    a: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.a * self.x
        yield der(self.a) == 1.0


@corpus.broken(
    "AC144",
    "`d` is discrete",
    """
error[AC144]: `der(d)`: `d` is discrete and has no derivative
  at      test_class_bodies.py:N
              yield der(self.x) == der(self.d)
          der(x) == der(d)
  cause   it keeps its value between events
  help    declare what changes in time by variable(): d: Real = variable(...)
""",
)
class RateOfACounter(Component):
    d: Real = discrete()
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == der(self.d)
        yield when(self.x > 2.0, reset(self.d, pre(self.d) + 1.0))


@corpus.broken(
    "AC144",
    "sign(x)",
    """
error[AC144]: `der(x * x + 2 * sign(x))`: `sign(x)` jumps and has no derivative
  at      test_class_bodies.py:N
              yield self.y == der(self.x * self.x + 2.0 * sign(self.x))
          y == der(x * x + 2 * sign(x))
  cause   between its jumps the derivative is zero, at them it is infinite: the integral would be lost
  help    leave the jump out of der(...), or smooth it: tanh(x / width) for sign(x)
""",
)
class RateOfASign(Component):
    """The derivative of a sign is zero wherever it exists."""

    x: Real = variable(default=1.0)
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == -1.0
        yield self.y == der(self.x * self.x + 2.0 * sign(self.x))


@corpus.broken(
    "AC145",
    "d is reset twice",
    """
error[AC145]: d is reset twice by one `when`
  at      test_class_bodies.py:N
              yield when(self.x > 0.5, reset(self.d, 1.0), reset(self.d, 2.0))
          when(x > 0.5, reset(d, 1), reset(d, 2))
  help    keep one of the two, or make them branches: when(...).elsewhen(...)
""",
)
class TwoNewValues(Component):
    d: Real = discrete()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(self.x > 0.5, reset(self.d, 1.0), reset(self.d, 2.0))


@corpus.bad_start(
    "AC505",
    "its interval is 0 s",
    """
error[AC505]: StoppedClock: sample(0, 0) has no instants: its interval is 0 s
  at      test_class_bodies.py:N
              yield when(sample(0.0, self.period), reset(self.d, self.x))
          when(sample(0, period), reset(d, x))
  help    give a positive interval in seconds
""",
)
class StoppedClock(Component):
    d: Real = discrete()
    period: Real = parameter(default=0.0, unit="s")
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield when(sample(0.0, self.period), reset(self.d, self.x))


@corpus.broken(
    "AC155",
    "mass.m == length",
    """
error[AC155]: `mass.m == length`: the left side is in kg, the right side in m
  at      test_class_bodies.py:N
              self.mass = translational.Mass(m=self.length)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          mass.m  [kg]
          length  [m]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class MassInMetres(Component):
    length: Real = parameter(default=1.0, unit="m")
    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=self.length)


@corpus.broken(
    "AC155",
    "mass.s == weight",
    """
error[AC155]: `mass.s == weight`: the left side is in m, the right side in kg
  at      test_class_bodies.py:N
              self.mass = translational.Mass(m=1.0, s=fixed(self.weight))
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          mass.s  [m]
          weight  [kg]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class StartInKilograms(Component):
    weight: Real = parameter(default=1.0, unit="kg")
    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0, s=fixed(self.weight))


@corpus.broken(
    "AC155",
    "force.u == mass.s",
    """
error[AC155]: `force.u == mass.s`: the left side is in N, the right side in m
  at      test_class_bodies.py:N
              self.force = translational.Force(u=self.mass.s)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          force.u  [N]
          mass.s  [m]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class ForceInMetres(Component):
    mass: translational.Mass = part()
    force: translational.Force = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0)
        self.force = translational.Force(u=self.mass.s)


@corpus.broken(
    "AC155",
    "body.r_CM == (weight, 0, 0)",
    """
error[AC155]: `body.r_CM == (weight, 0, 0)`: the left side is in m, the right side in kg
  at      test_class_bodies.py:N
              self.body = Body(m=1.0, r_CM=(self.weight, 0.0, 0.0))
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          body.r_CM  [m]
          weight  [kg]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class VectorInKilograms(Component):
    """Literals of a vector adapt to the entries that have a unit."""

    weight: Real = parameter(default=1.0, unit="kg")
    body: Body = part()

    def build(self) -> None:
        self.body = Body(m=1.0, r_CM=(self.weight, 0.0, 0.0))


@corpus.bad_start(
    "AC302",
    "`x + y == 1` and `x + y == 3`",
    """
error[AC302]: TwoSums: the start equations `x + y == 1` and `x + y == 3` contradict each other
  at      test_class_bodies.py:N
              yield self.x + self.y == 1.0
  at      test_class_bodies.py:N
              yield self.x + self.y == 3.0
          together they demand 0 == 2:
            start equation x + y == 1   (test_class_bodies.py:N)
            start equation x + y == 3   (test_class_bodies.py:N)
  cause   start conditions say the same with different numbers
  help    remove one of them, or replace it by a condition for something else
""",
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


@corpus.wrong(
    "AC208",
    "nothing determines v",
    """
error[AC208]: Spiral: once the constraints of Spiral are differentiated, nothing determines v
  at      test_class_bodies.py:N
              yield der(self.v) == -self.x
          not determined: v
          these equations are left over:
            der(v) == -x   (Spiral, test_class_bodies.py:N)
  cause   a constraint follows from the others, perhaps only for these values of the parameters
  help    remove one of the constraints, or change the values that make them equal
""",
)
def constraint_that_determines_nothing() -> None:
    """The last line of defence: of six thousand random systems none came here, other messages were better."""
    raise undetermined(reduce(flatten(Spiral())), [1], [1])


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
