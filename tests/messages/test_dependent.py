"""Equations that depend on each other by their numbers: no look at their structure shows it."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, connect, variable
from acausal.library import translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Pair(Component):
    """Two unknowns."""

    x: Real = variable()
    y: Real = variable()


@corpus.broken(
    "AC204",
    "Contradiction",
    "yield self.x + self.y == 1.0",
    "yield self.x + self.y == 2.0",
    text="""
error[AC204]: equations of Contradiction contradict each other
  at      test_dependent.py:N
              yield self.x + self.y == 1.0
  at      test_dependent.py:N
              yield self.x + self.y == 2.0
          their unknowns cancel:
            x + y == 1   (Contradiction, test_dependent.py:N)
            x + y == 2   (Contradiction, test_dependent.py:N)
          together they demand 0 == 1
          and leave undetermined: x and y
  cause   two equations state the same about these unknowns, possibly with different numbers
  help    replace one of these equations by one for the undetermined unknowns
""",
)
class Contradiction(Pair):
    """The textbook case: structurally regular, and no solution."""

    def equations(self) -> Equations:
        yield self.x + self.y == 1.0
        yield self.x + self.y == 2.0


class Empty(translational.PartialCompliant):
    """Its own equation says nothing."""

    def equations(self) -> Equations:
        yield self.f - self.f == 0.0


@corpus.broken("AC204", "spring", "yield self.f - self.f == 0.0")
class Tautology(Component):
    """The unknown of an equation cancels in the equation itself."""

    wall: translational.Fixed = translational.Fixed()
    spring: Empty = Empty()
    mass: translational.Mass = translational.Mass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


corpus.table(
    """
Repetition(Pair) AC204 Repetition
# The same without a contradiction: infinitely many solutions.
> yield self.x + self.y == 1.0
> yield 2.0 * self.x + 2.0 * self.y == 2.0

Circle(Pair) AC204 Circle
# A nonlinear block: the Jacobian is singular wherever one looks.
> yield self.x**2 + self.y**2 == 1.0
> yield 2.0 * self.x**2 + 2.0 * self.y**2 == 2.0

Exponential(Pair) AC204 Exponential
# A linear and a nonlinear equation for one and the same sum.
> yield exp(self.x + self.y) == 2.0
> yield self.x + self.y == 2.0

Pendulum AC204 Pendulum
# The length of a pendulum is stated twice, with a force for each.
x: Real = variable(unit="m")
y: Real = variable(unit="m")
force: Real = variable(unit="1/s2")
other: Real = variable(unit="1/s2")
yield der(der(self.x)) == -(self.force + self.other) * self.x
yield der(der(self.y)) == -(self.force + self.other) * self.y - quantity(9.81, "m/s2")
> yield self.x**2 + self.y**2 == 1.0
> yield 3.0 * self.x**2 + 3.0 * self.y**2 == 3.0

UnitFeedback AC204 gain.k = 1
# y = u + k*y determines y for every gain but 1.
sum: blocks.Add = <<blocks.Add()>>
gain: blocks.Gain = <<blocks.Gain(k=1.0)>>
constant: blocks.Constant = <<blocks.Constant(k=1.0)>>
yield connect(self.constant.y, self.sum.u1)
yield connect(self.sum.y, self.gain.u)
yield connect(self.gain.y, self.sum.u2)

MasslessMass AC204 mass.m = 0
# A force on nothing.
mass: translational.Mass = <<translational.Mass(m=0.0)>>
force: translational.ConstantForce = <<translational.ConstantForce(f_constant=1.0)>>
yield connect(self.force.flange, self.mass.flange_a)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
