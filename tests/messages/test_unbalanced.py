"""Components and models that state too few or too many equations, or equations that depend on each other by numbers."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, connect, der, parameter, part, signal_input, signal_output, variable
from acausal.errors import AcausalError
from acausal.library import translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class SpringWithoutLaw(translational.PartialCompliant):
    """Nobody has written down Hooke's law."""

    c: Real = parameter(unit="N/m")


class SpringWithTwoLaws(translational.PartialCompliant):
    """The balance of forces is in the base class already."""

    c: Real = parameter(unit="N/m")

    def equations(self) -> Equations:
        yield self.f == self.c * self.s_rel
        yield self.flange_a.f + self.flange_b.f == 0.0


class Scene(Component):
    """A mass on something."""

    mass: translational.Mass = part()
    wall: translational.Fixed = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0)
        self.wall = translational.Fixed()


@corpus.broken(
    "AC201",
    "spring",
    "SpringWithoutLaw(c=1.0)",
    "def equations(self) -> Equations:",
    text="""
error[AC201]: MissingLaw: spring states 3 equations for 4 unknowns
  at      test_unbalanced.py:N
              self.spring = SpringWithoutLaw(c=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^
  at      translational/interfaces.py:N
              def equations(self) -> Equations:
          unknowns: spring.s_rel, spring.f, spring.flange_a.f and spring.flange_b.f
          equations:
            spring.s_rel == spring.flange_b.s - spring.flange_a.s   (SpringWithoutLaw, translational/interfaces.py:N)
            spring.flange_b.f == spring.f   (SpringWithoutLaw, translational/interfaces.py:N)
            spring.flange_a.f == -spring.f   (SpringWithoutLaw, translational/interfaces.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors
  help    state 1 more equation in SpringWithoutLaw.equations
""",
)
class MissingLaw(Scene):
    spring: SpringWithoutLaw = part()

    def build(self) -> None:
        super().build()
        self.spring = SpringWithoutLaw(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


@corpus.broken("AC202", "spring", "SpringWithTwoLaws(c=1.0)", "def equations(self) -> Equations:")
class SuperfluousLaw(Scene):
    """The equation too many follows from the others; it would be dropped silently."""

    spring: SpringWithTwoLaws = part()

    def build(self) -> None:
        super().build()
        self.spring = SpringWithTwoLaws(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


class Base(Component):
    x: Real = variable(unit="m")
    y: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == 1.0


def test_super_is_named_as_the_cause() -> None:
    with pytest.raises(AcausalError, match=r"super\(\)\.equations\(\)` repeats the equations of Base"):
        corpus["StatesItsBaseAgain"].run()


class Controller(Component):
    """Says twice what its output is."""

    e: Real = variable()
    y: Real = signal_output()

    def equations(self) -> Equations:
        yield der(self.e) == -self.e
        yield self.y == 2.0 * self.e
        yield self.e == 0.5 * self.y


class Plant(Component):
    """Says nothing about one of its variables."""

    u: Real = signal_input()
    inner: Real = variable()
    lost: Real = variable()

    def equations(self) -> Equations:
        yield self.inner + self.lost == self.u


@corpus.broken("AC201", "plant states 1 equation for 2 unknowns", "Plant()", "Controller()")
class OneHereOneThere(Component):
    """An equation too many in one part, one too few in another: the model as a whole is balanced."""

    controller: Controller = Controller()
    plant: Plant = Plant()

    def equations(self) -> Equations:
        yield connect(self.controller.y, self.plant.u)


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
  at      test_unbalanced.py:N
              yield self.x + self.y == 1.0
  at      test_unbalanced.py:N
              yield self.x + self.y == 2.0
          their unknowns cancel:
            x + y == 1   (Contradiction, test_unbalanced.py:N)
            x + y == 2   (Contradiction, test_unbalanced.py:N)
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
BoundPosition(Scene) AC202 mass
# The constructor of the mass gets an expression for a variable that its equations determine.
x: Real = variable(unit="m")
spring: translational.Spring = translational.Spring(c=1.0)
build: self.wall = translational.Fixed()
build: self.mass = <<translational.Mass(m=1.0, s=self.x)>>
yield connect(self.wall.flange, self.spring.flange_a)
yield connect(self.spring.flange_b, self.mass.flange_a)
yield self.x == 1.0

LooseCapacitor AC202 capacitor.n.v
# ModelingToolkit issue 1544, "ExtraEquationsSystemException": the list of extra equations is empty there.
resistor1: electrical.Resistor = electrical.Resistor(R=1.0)
resistor2: electrical.Resistor = electrical.Resistor(R=2.0)
capacitor: electrical.Capacitor = electrical.Capacitor(C=1.0)
source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.resistor1.p)
yield connect(self.resistor1.n, self.capacitor.p, self.resistor2.p)
yield connect(self.resistor2.n, self.source.n, self.ground.p)
> yield self.capacitor.n.v == 1.0

RigidByEquation AC202 left.s == right.s
# Two masses are tied by an equation instead of a connection: no force belongs to it.
left: translational.Mass = translational.Mass(m=1.0)
right: translational.Mass = translational.Mass(m=1.0)
> yield self.left.s == self.right.s

Tank AC201 Tank
# The outflow occurs in the balance, but nothing says how large it is; its author has left a hint.
level: Real = variable(unit="m")
inflow: Real = variable(unit="m3/s")
outflow: Real = variable(unit="m3/s", hint="the outflow needs a valve law; Torricelli: A * sqrt(2 * g * level)")
area: Real = parameter(default=1.0, unit="m2")
> def equations(self):
yield self.area * der(self.level) == self.inflow - self.outflow
yield self.inflow == 0.1

Forgotten AC201 unused
# A variable that no equation holds.
x: Real = variable(unit="m")
unused: Real = variable(unit="m")
> def equations(self):
yield self.x == 1.0

Twice AC202 Twice
# One unknown, two equations, one component.
x: Real = variable(unit="m")
> def equations(self):
yield self.x == 1.0
yield 2.0 * self.x == 3.0

StatesItsBaseAgain(Base) AC202 StatesItsBaseAgain
# The equations of a base class belong to its subclasses without a call, as in Modelica.
> def equations(self):
yield from super().equations()
yield self.y == self.x

MixedUp AC201 x
# As many equations as unknowns, but all of them about one of the two.
x: Real = variable()
y: Real = variable()
> def equations(self):
yield self.y * self.y == 4.0
yield self.y * self.y * self.y == 8.0

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
