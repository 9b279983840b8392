"""AC133 to AC136 and AC15x: values of parameters, and units."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    parameter,
    part,
    sin,
    variable,
)
from acausal.library import translational
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()

# Any: a type checker would refuse constructors without their values.
mass: Any = Mass
spring_damper: Any = translational.SpringDamper


class Two(Component):
    """Two masses and what subclasses do with them."""

    left: Mass = Mass(m=1.0)
    right: Mass = Mass(m=1.0)


@corpus.broken("AC133", "left.m", "mass()")
class MissingValue(Two):
    def build(self) -> None:
        self.left = mass()
        self.right = Mass(m=1.0)


@corpus.broken("AC133", "a.c, a.d", "spring_damper()")
class MissingValues(Component):
    a: translational.SpringDamper = spring_damper()


@corpus.broken(
    "AC134",
    "mass.m -> mass.density -> mass.m",
    "m: Real = parameter(default=lambda self: 2.0 * self.density)",
    "density: Real = parameter(default=lambda self: self.m / 2.0)",
)
class BoundInACircle(Component):
    class Ball(Component):
        m: Real = parameter(default=lambda self: 2.0 * self.density)
        density: Real = parameter(default=lambda self: self.m / 2.0)

    mass: Ball = part()

    def build(self) -> None:
        self.mass = self.Ball()


@corpus.broken("AC135", "left.m", "Mass(m=self.x)")
class ParameterThatVaries(Component):
    x: Real = variable(unit="kg")
    left: Mass = part()

    def build(self) -> None:
        self.left = Mass(m=self.x)

    def equations(self) -> Equations:
        yield self.x == 1.0


@corpus.broken("AC136", "left.m", "Mass(m=-1.0)")
class OutsideItsLimits(Two):
    def build(self) -> None:
        self.left = Mass(m=-1.0)
        self.right = Mass(m=1.0)


@corpus.wrong("AC150", "furlong", 'variable(unit="furlongg/s")')
def unknown_unit() -> None:
    variable(unit="furlongg/s")


@corpus.wrong("AC153", "'mm'", 'variable(unit="mm")')
def incoherent_unit() -> None:
    variable(unit="mm")


@corpus.broken("AC155", "left.s == left.v", "yield self.left.s == self.left.v")
class PositionIsVelocity(Two):
    def equations(self) -> Equations:
        yield self.left.s == self.left.v


@corpus.broken("AC155", "left.s + left.v", "yield self.x == self.left.s + self.left.v")
class SumOfDifferentUnits(Two):
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == self.left.s + self.left.v


@corpus.broken("AC155", "sin(left.s)", "yield self.x == sin(self.left.s)")
class SineOfALength(Two):
    x: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield self.x == sin(self.left.s)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
