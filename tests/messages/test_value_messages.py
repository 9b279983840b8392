"""AC133 to AC136 and AC15x: values of parameters, and units."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Real,
    parameter,
    part,
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


corpus.table(
    """
AC150 furlong -- variable(unit="furlongg/s")
AC153 'mm' -- variable(unit="mm")

MissingValue(Two) AC133 left.m
build: self.left = <<mass()>>
build: self.right = Mass(m=1.0)

MissingValues AC133 a.c, a.d
a: translational.SpringDamper = <<spring_damper()>>

ParameterThatVaries AC135 left.m
x: Real = variable(unit="kg")
left: Mass = part()
build: self.left = <<Mass(m=self.x)>>
yield self.x == 1.0

OutsideItsLimits(Two) AC136 left.m
build: self.left = <<Mass(m=-1.0)>>
build: self.right = Mass(m=1.0)

PositionIsVelocity(Two) AC155 left.s == left.v
> yield self.left.s == self.left.v

SumOfDifferentUnits(Two) AC155 left.s + left.v
x: Real = variable(unit="m")
> yield self.x == self.left.s + self.left.v

SineOfALength(Two) AC155 sin(left.s)
x: Real = variable(unit="1")
> yield self.x == sin(self.left.s)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
