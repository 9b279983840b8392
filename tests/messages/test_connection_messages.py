"""AC120, AC121, AC128 to AC132, AC137, AC154: connections and equations of a whole model."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    floor,
    part,
    signal_input,
    signal_output,
    variable,
)
from acausal.library import blocks, electrical, rotational, translational
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


@corpus.broken("AC120", "rotational.Flange", "yield join(self.left.flange_a, self.shaft.flange_a)")
class FlangesOfTwoLibraries(Two):
    shaft: rotational.Inertia = part()

    def build(self) -> None:
        super().build()
        self.shaft = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield join(self.left.flange_a, self.shaft.flange_a)


@corpus.broken("AC121", "left (Mass)", "yield join(self.left, self.right)")
class ConnectedComponents(Two):
    def equations(self) -> Equations:
        yield join(self.left, self.right)


@corpus.broken("AC121", "left.s", "yield join(self.left.s, self.right.s)")
class ConnectedVariables(Two):
    def equations(self) -> Equations:
        yield join(self.left.s, self.right.s)


class Signals(Component):
    """An output and two inputs that do not fit it."""

    x: Real = signal_output(unit="m")
    f: Real = signal_input(unit="N")
    r: Real = signal_input(unit="m", shape=3)


@corpus.broken("AC105", "b.r", "yield connect(self.a.x, self.b.r)")
class SignalsOfDifferentShape(Component):
    a: Signals = Signals()
    b: Signals = Signals()

    def equations(self) -> Equations:
        yield connect(self.a.x, self.b.r)


@corpus.broken("AC154", "b.f", "yield connect(self.a.x, self.b.f)")
class SignalsOfDifferentUnit(Component):
    a: Signals = Signals()
    b: Signals = Signals()

    def equations(self) -> Equations:
        yield connect(self.a.x, self.b.f)


@corpus.broken("AC128", "floor(x) < x", "yield self.y == der(floor(self.x) < self.x)")
class DerivativeOfARelation(Component):
    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == der(floor(self.x) < self.x)


@corpus.broken("AC129", "Silent.equations", "def equations(self) -> Any:")
class Silent(Component):
    x: Real = variable()

    def equations(self) -> Any:
        self.x == 1.0  # noqa: B015


@corpus.broken("AC130", "Half.equations", "yield self.x")
class Half(Component):
    x: Real = variable()

    def equations(self) -> Any:
        yield self.x


@corpus.broken("AC130", "Numbers.equations", "yield 1.0 == 2.0")
class Numbers(Component):
    x: Real = variable()

    def equations(self) -> Any:
        yield 1.0 == 2.0


@corpus.broken("AC131", "Fixed", "yield connect(self.left.flange_a, translational.Fixed().flange)")
class ConnectedToAStranger(Two):
    def equations(self) -> Equations:
        yield connect(self.left.flange_a, translational.Fixed().flange)


stranger = Mass(m=1.0)


@corpus.broken("AC131", "`s`", "yield self.x == stranger.s", "Mass(m=1.0)")
class EquationWithAStranger(Component):
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == stranger.s


@corpus.broken(
    "AC132", "one.y and two.y", "yield connect(self.one.y, self.gain.u)", "yield connect(self.two.y, self.gain.u)"
)
class TwoSources(Component):
    one: blocks.Constant = blocks.Constant(k=1.0)
    two: blocks.Constant = blocks.Constant(k=2.0)
    gain: blocks.Gain = blocks.Gain(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.one.y, self.gain.u)
        yield connect(self.two.y, self.gain.u)


@corpus.broken("AC137", "force.u", "translational.Force(u=1.0)")
class BoundAndConnected(Component):
    signal: blocks.Constant = blocks.Constant(k=1.0)
    force: translational.Force = translational.Force(u=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.force.u)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
