"""Connections, inputs that nothing drives, equations of a whole model: AC105, AC120, AC121, AC128 to AC154, AC207."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    connect,
    part,
    signal_input,
    signal_output,
    variable,
)
from acausal.library import blocks, electrical, rotational
from acausal.library.translational import Mass
from tests.messages.cases import Case, Corpus

corpus = Corpus()


join: Any = connect


class Two(Component):
    """Two masses and what subclasses do with them."""

    left: Mass = part()
    right: Mass = part()

    def build(self) -> None:
        self.left = Mass(m=1.0)
        self.right = Mass(m=1.0)


@corpus.broken(
    "AC120",
    "left.flange_a",
    "yield join(self.left.flange_a, self.ground.p)",
    text="""
error[AC120]: cannot connect left.flange_a (Flange) and ground.p (Pin)
  at      test_connection_messages.py:N
              yield join(self.left.flange_a, self.ground.p)
  cause   a connection joins connectors of one type
  help    put a component that has both connectors between them
""",
)
class DifferentConnectors(Two):
    ground: electrical.Ground = part()

    def build(self) -> None:
        super().build()
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield join(self.left.flange_a, self.ground.p)


class Signals(Component):
    """An output and two inputs that do not fit it."""

    x: Real = signal_output(unit="m")
    f: Real = signal_input(unit="N")
    r: Real = signal_input(unit="m", shape=3)


@corpus.broken("AC129", "Silent.equations", "def equations(self) -> Any:")
class Silent(Component):
    x: Real = variable()

    def equations(self) -> Any:
        self.x == 1.0  # noqa: B015


stranger = Mass(m=1.0)


@corpus.broken("AC131", "`s`", "yield self.x == stranger.s", "Mass(m=1.0)")
class EquationWithAStranger(Component):
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == stranger.s


class Servo(Component):
    """A drive inside a composite that forgets to hand its own input down."""

    w_set: Real = signal_input(unit="rad/s")
    drive: rotational.Speed = rotational.Speed()
    inertia: rotational.Inertia = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.inertia.flange_a)


@corpus.broken("AC209", "axis.drive.w_ref", "rotational.Speed()")
class OpenInside(Component):
    """The open input lies one level down."""

    axis: Servo = Servo()
    speed: blocks.Constant = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.speed.y, self.axis.w_set)


corpus.table(
    """
FlangesOfTwoLibraries(Two) AC120 rotational.Flange
shaft: rotational.Inertia = part()
build: super().build()
build: self.shaft = rotational.Inertia(J=1.0)
> yield join(self.left.flange_a, self.shaft.flange_a)

ConnectedComponents(Two) AC121 left (Mass)
> yield join(self.left, self.right)

ConnectedVariables(Two) AC121 left.s
> yield join(self.left.s, self.right.s)

SignalsOfDifferentShape AC105 b.r
a: Signals = Signals()
b: Signals = Signals()
> yield connect(self.a.x, self.b.r)

SignalsOfDifferentUnit AC154 b.f
a: Signals = Signals()
b: Signals = Signals()
> yield connect(self.a.x, self.b.f)

DerivativeOfARelation AC128 floor(x) < x
x: Real = variable()
y: Real = variable()
yield der(self.x) == 1.0
> yield self.y == der(floor(self.x) < self.x)

Half AC130 Half.equations
x: Real = variable()
> yield self.x

Numbers AC130 Numbers.equations
x: Real = variable()
> yield 1.0 == 2.0

ConnectedToAStranger(Two) AC131 Fixed
> yield connect(self.left.flange_a, translational.Fixed().flange)

TwoSources AC132 one.y and two.y
one: blocks.Constant = blocks.Constant(k=1.0)
two: blocks.Constant = blocks.Constant(k=2.0)
gain: blocks.Gain = blocks.Gain(k=1.0)
> yield connect(self.one.y, self.gain.u)
> yield connect(self.two.y, self.gain.u)

BoundAndConnected AC137 force.u
signal: blocks.Constant = blocks.Constant(k=1.0)
force: translational.Force = <<translational.Force(u=1.0)>>
yield connect(self.signal.y, self.force.u)

OpenInput AC209 integrator.u
# OpenModelica issue 12979, "Improve error message for open input connectors": integrator.y is blamed there.
integrator: blocks.Integrator = <<blocks.Integrator()>>
controller: blocks.PI = blocks.PI(T=1.0)
yield connect(self.integrator.y, self.controller.u)

OpenForce AC209 force.u
# An input with a unit, and a second one.
force: translational.Force = <<translational.Force()>>
mass: translational.Mass = translational.Mass(m=1.0)
sum: blocks.Add = blocks.Add()
constant: blocks.Constant = blocks.Constant(k=1.0)
yield connect(self.force.flange, self.mass.flange_a)
yield connect(self.constant.y, self.sum.u1)

PrescribedPosition AC207 input s_set
# A free input of the model moves a mass: its second derivative would be the acceleration.
s_set: Real = signal_input(unit="m")
drive: translational.Position = <<translational.Position()>>
mass: translational.Mass = translational.Mass(m=1.0)
yield connect(self.s_set, self.drive.s_ref)
yield connect(self.drive.flange, self.mass.flange_a)

OpenInputsOfList AC209 forces[0].u
# Three inputs of equal components: the first is named, the others are listed.
forces: list[translational.Force] = part()
masses: list[translational.Mass] = part()
build: self.forces = [<<translational.Force()>> for _ in range(3)]
build: self.masses = [translational.Mass(m=1.0) for _ in range(3)]
eq: for force, mass in zip(self.forces, self.masses, strict=True):
eq:     yield connect(force.flange, mass.flange_a)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
