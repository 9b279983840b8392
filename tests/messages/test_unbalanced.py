"""Components and models that state too few or too many equations."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, connect, der, parameter, part, signal_input, signal_output, variable
from acausal.library import electrical, translational
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
    """
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


@corpus.broken(
    "AC202",
    "spring",
    """
error[AC202]: SuperfluousLaw: spring states 5 equations for 4 unknowns
  at      test_unbalanced.py:N
              self.spring = SpringWithTwoLaws(c=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_unbalanced.py:N
              def equations(self) -> Equations:
          equations:
            spring.s_rel == spring.flange_b.s - spring.flange_a.s   (SpringWithTwoLaws, translational/interfaces.py:N)
            spring.flange_b.f == spring.f   (SpringWithTwoLaws, translational/interfaces.py:N)
            spring.flange_a.f == -spring.f   (SpringWithTwoLaws, translational/interfaces.py:N)
            spring.f == spring.c * spring.s_rel   (SpringWithTwoLaws, test_unbalanced.py:N)
            spring.flange_a.f + spring.flange_b.f == 0   (SpringWithTwoLaws, test_unbalanced.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors, no more
  help    remove 1 equation from SpringWithTwoLaws
""",
)
class SuperfluousLaw(Scene):
    """The equation too many follows from the others; it would be dropped silently."""

    spring: SpringWithTwoLaws = part()

    def build(self) -> None:
        super().build()
        self.spring = SpringWithTwoLaws(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)


@corpus.broken(
    "AC202",
    "mass",
    """
error[AC202]: BoundPosition: mass states 6 equations for 5 unknowns: `mass.s == x` is one too many
  at      test_unbalanced.py:N
              self.mass = translational.Mass(m=1.0, s=self.x)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          equations:
            mass.flange_a.s == mass.s - mass.L / 2   (Mass, translational/interfaces.py:N)
            mass.flange_b.s == mass.s + mass.L / 2   (Mass, translational/interfaces.py:N)
            mass.v == der(mass.s)   (Mass, translational/components.py:N)
            mass.a == der(mass.v)   (Mass, translational/components.py:N)
            mass.m * mass.a == mass.flange_a.f + mass.flange_b.f   (Mass, translational/components.py:N)
            mass.s == x   (test_unbalanced.py:N)
  cause   the constructor binds a variable that the component determines by its own equations
  help    make the Mass without s=..., or with s=fixed(...) for a start value
""",
)
class BoundPosition(Scene):
    """The constructor of the mass gets an expression for a variable that its equations determine."""

    x: Real = variable(unit="m")
    spring: translational.Spring = part()

    def build(self) -> None:
        self.wall = translational.Fixed()
        self.mass = translational.Mass(m=1.0, s=self.x)
        self.spring = translational.Spring(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a)
        yield self.x == 1.0


@corpus.broken(
    "AC202",
    "capacitor.n.v",
    """
error[AC202]: LooseCapacitor states 1 equation for 0 unknowns: `capacitor.n.v == 1` is one too many
  at      test_unbalanced.py:N
              yield self.capacitor.n.v == 1.0
          equations:
            capacitor.n.v == 1   (LooseCapacitor, test_unbalanced.py:N)
  cause   capacitor.n is not connected, so its flow is zero; it cannot be given a potential as well
  help    remove it, or connect a component that enforces it: a constraint needs a force, a voltage a current
""",
)
class LooseCapacitor(Component):
    """ModelingToolkit issue 1544, "ExtraEquationsSystemException": the list of extra equations is empty there."""

    resistor1: electrical.Resistor = part()
    resistor2: electrical.Resistor = part()
    capacitor: electrical.Capacitor = part()
    source: electrical.ConstantVoltage = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.resistor1 = electrical.Resistor(R=1.0)
        self.resistor2 = electrical.Resistor(R=2.0)
        self.capacitor = electrical.Capacitor(C=1.0)
        self.source = electrical.ConstantVoltage(V=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor1.p)
        yield connect(self.resistor1.n, self.capacitor.p, self.resistor2.p)
        yield connect(self.resistor2.n, self.source.n, self.ground.p)
        yield self.capacitor.n.v == 1.0


@corpus.broken(
    "AC202",
    "left.s == right.s",
    """
error[AC202]: RigidByEquation states 1 equation for 0 unknowns: `left.s == right.s` is one too many
  at      test_unbalanced.py:N
              yield self.left.s == self.right.s
          equations:
            left.s == right.s   (RigidByEquation, test_unbalanced.py:N)
  cause   the variables of its parts are determined by the parts and their connections already
  help    remove it, or connect a component that enforces it: a constraint needs a force, a voltage a current
""",
)
class RigidByEquation(Component):
    """Two masses are tied by an equation instead of a connection: no force belongs to it."""

    left: translational.Mass = part()
    right: translational.Mass = part()

    def build(self) -> None:
        self.left = translational.Mass(m=1.0)
        self.right = translational.Mass(m=1.0)

    def equations(self) -> Equations:
        yield self.left.s == self.right.s


@corpus.broken(
    "AC201",
    "Tank",
    """
error[AC201]: Tank states 2 equations for 3 unknowns
  at      test_unbalanced.py:N
              def equations(self) -> Equations:
          unknowns: level, inflow and outflow
          equations:
            area * der(level) == inflow - outflow   (Tank, test_unbalanced.py:N)
            inflow == 0.1   (Tank, test_unbalanced.py:N)
  cause   the outflow needs a valve law
  help    Torricelli: A * sqrt(2 * g * level)
""",
)
class Tank(Component):
    """The outflow occurs in the balance, but nothing says how large it is; its author has left a hint."""

    level: Real = variable(unit="m")
    inflow: Real = variable(unit="m3/s")
    outflow: Real = variable(unit="m3/s", hint="the outflow needs a valve law; Torricelli: A * sqrt(2 * g * level)")
    area: Real = parameter(default=1.0, unit="m2")

    def equations(self) -> Equations:
        yield self.area * der(self.level) == self.inflow - self.outflow
        yield self.inflow == 0.1


@corpus.broken(
    "AC201",
    "unused",
    """
error[AC201]: Forgotten states 1 equation for 2 unknowns; none holds unused
  at      test_unbalanced.py:N
              def equations(self) -> Equations:
          unknowns: x and unused
          equations:
            x == 1   (Forgotten, test_unbalanced.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors
  help    state 1 more equation in Forgotten.equations
""",
)
class Forgotten(Component):
    """A variable that no equation holds."""

    x: Real = variable(unit="m")
    unused: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == 1.0


@corpus.broken(
    "AC202",
    "Twice",
    """
error[AC202]: Twice states 2 equations for 1 unknown
  at      test_unbalanced.py:N
              def equations(self) -> Equations:
          equations:
            x == 1   (Twice, test_unbalanced.py:N)
            2 * x == 3   (Twice, test_unbalanced.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors, no more
  help    remove 1 equation from Twice
""",
)
class Twice(Component):
    """One unknown, two equations, one component."""

    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == 1.0
        yield 2.0 * self.x == 3.0


@corpus.broken(
    "AC201",
    "x",
    """
error[AC201]: MixedUp: 1 equation too few: x cannot be determined
  at      test_unbalanced.py:N
              def equations(self) -> Equations:
          under-determined part (0 equations, 1 unknown):
            unknowns: x
          while these are too many for what they hold:
            y * y == 4   (MixedUp, test_unbalanced.py:N)
            y * y * y == 8   (MixedUp, test_unbalanced.py:N)
  cause   an equation is missing, or a connector is not connected
  help    state one more equation for these variables, or connect what determines them
""",
)
class MixedUp(Component):
    """As many equations as unknowns, but all of them about one of the two."""

    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield self.y * self.y == 4.0
        yield self.y * self.y * self.y == 8.0


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


@corpus.broken(
    "AC201",
    "plant states 1 equation for 2 unknowns",
    """
error[AC201]: OneHereOneThere: plant states 1 equation for 2 unknowns
  at      test_unbalanced.py:N
              self.plant = Plant()
                           ^^^^^^^
  at      test_unbalanced.py:N
              self.controller = Controller()
                                ^^^^^^^^^^^^
          unknowns: plant.inner and plant.lost
          equations:
            plant.inner + plant.lost == plant.u   (Plant, test_unbalanced.py:N)
          while controller states 3 equations for 2 unknowns:
            der(controller.e) == -controller.e   (Controller, test_unbalanced.py:N)
            controller.y == 2 * controller.e   (Controller, test_unbalanced.py:N)
            controller.e == 0.5 * controller.y   (Controller, test_unbalanced.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors
  help    state 1 more equation in Plant.equations
""",
)
class OneHereOneThere(Component):
    """An equation too many in one part, one too few in another: the model as a whole is balanced."""

    controller: Controller = part()
    plant: Plant = part()

    def build(self) -> None:
        self.controller = Controller()
        self.plant = Plant()

    def equations(self) -> Equations:
        yield connect(self.controller.y, self.plant.u)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
