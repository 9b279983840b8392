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

    left: Mass = part()
    right: Mass = part()

    def build(self) -> None:
        self.left = Mass(m=1.0)
        self.right = Mass(m=1.0)


@corpus.broken(
    "AC133",
    "left.m",
    """
error[AC133]: parameter left.m has no value
  at      test_value_messages.py:N
              self.left = mass()
                          ^^^^^^
          left.m [kg]   Mass
  help    give it where the component is made: Mass(m=...)
""",
)
class MissingValue(Two):
    def build(self) -> None:
        self.left = mass()
        self.right = Mass(m=1.0)


@corpus.broken(
    "AC133",
    "a.c, a.d",
    """
error[AC133]: 2 parameters have no value: a.c, a.d
  at      test_value_messages.py:N
              self.a = spring_damper()
                       ^^^^^^^^^^^^^^^
          a.c [N/m]   Stiffness
          a.d [N.s/m]   Damping constant
  help    give it where the component is made: SpringDamper(c=...)
""",
)
class MissingValues(Component):
    a: translational.SpringDamper = part()

    def build(self) -> None:
        self.a = spring_damper()


@corpus.broken(
    "AC134",
    "mass.m -> mass.density -> mass.m",
    """
error[AC134]: parameters are bound in a circle: mass.m -> mass.density -> mass.m
  at      test_value_messages.py:N
              m: Real = parameter(default=lambda self: 2.0 * self.density)
  at      test_value_messages.py:N
              density: Real = parameter(default=lambda self: self.m / 2.0)
          mass.m = 2 * mass.density
          mass.density = mass.m / 2
  help    give one of them a number
""",
)
class BoundInACircle(Component):
    class Ball(Component):
        m: Real = parameter(default=lambda self: 2.0 * self.density)
        density: Real = parameter(default=lambda self: self.m / 2.0)

    mass: Ball = part()

    def build(self) -> None:
        self.mass = self.Ball()


@corpus.broken(
    "AC135",
    "left.m",
    """
error[AC135]: left.m is bound to x, which varies in time
  at      test_value_messages.py:N
              self.left = Mass(m=self.x)
                          ^^^^^^^^^^^^^^
  help    bind parameters to parameters; give signals by connect or to a signal_input
""",
)
class ParameterThatVaries(Component):
    x: Real = variable(unit="kg")
    left: Mass = part()

    def build(self) -> None:
        self.left = Mass(m=self.x)

    def equations(self) -> Equations:
        yield self.x == 1.0


@corpus.broken(
    "AC136",
    "left.m",
    """
error[AC136]: left.m = -1 kg is outside its limits 0 ... inf
  at      test_value_messages.py:N
              self.left = Mass(m=-1.0)
                          ^^^^^^^^^^^^
          left.m   Mass
  help    give a value of at least 0 kg
""",
)
class OutsideItsLimits(Two):
    def build(self) -> None:
        self.left = Mass(m=-1.0)
        self.right = Mass(m=1.0)


@corpus.wrong(
    "AC150",
    "furlong",
    """
error[AC150]: unknown unit "furlongg" in "furlongg/s"
  at      test_value_messages.py:N
              variable(unit="furlongg/s")
  help    write units as in Modelica: N.m, kg/(m.s2), m/s2, 1/s, mm, kN, deg, degC
""",
)
def unknown_unit() -> None:
    variable(unit="furlongg/s")


@corpus.wrong(
    "AC153",
    "'mm'",
    """
error[AC153]: declared unit 'mm' is not coherent (1 mm = 0.001 SI units)
  at      test_value_messages.py:N
              variable(unit="mm")
  help    declare in SI; values given on the command line are converted: --set length=16mm
""",
)
def incoherent_unit() -> None:
    variable(unit="mm")


@corpus.broken(
    "AC155",
    "left.s == left.v",
    """
error[AC155]: `left.s == left.v`: the left side is in m, the right side in m/s
  at      test_value_messages.py:N
              yield self.left.s == self.left.v
          left.s  [m]
          left.v  [m/s]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class PositionIsVelocity(Two):
    def equations(self) -> Equations:
        yield self.left.s == self.left.v


@corpus.broken(
    "AC155",
    "left.s + left.v",
    """
error[AC155]: `left.s + left.v` mixes m and m/s
  at      test_value_messages.py:N
              yield self.x == self.left.s + self.left.v
          x  [m]
          left.s  [m]
          left.v  [m/s]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class SumOfDifferentUnits(Two):
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == self.left.s + self.left.v


@corpus.broken(
    "AC155",
    "sin(left.s)",
    """
error[AC155]: `sin(left.s)`: sin takes a number or an angle, not m
  at      test_value_messages.py:N
              yield self.x == sin(self.left.s)
          x  [1]
          left.s  [m]
  cause   a factor is missing or two quantities are mixed up
  help    check the declared units; a plain number adapts to any unit
""",
)
class SineOfALength(Two):
    x: Real = variable(unit="1")

    def equations(self) -> Equations:
        yield self.x == sin(self.left.s)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
