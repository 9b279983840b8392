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
    """
error[AC120]: cannot connect left.flange_a (Flange) and ground.p (Pin)
  at      test_connection_messages.py:N
              yield join(self.left.flange_a, self.ground.p)
  cause   a connection joins connectors of one type
  help    look for a component that has both connectors and put it between
""",
)
class DifferentConnectors(Two):
    ground: electrical.Ground = part()

    def build(self) -> None:
        super().build()
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield join(self.left.flange_a, self.ground.p)


@corpus.broken(
    "AC120",
    "rotational.Flange",
    """
error[AC120]: cannot connect left.flange_a (translational.Flange) and shaft.flange_a (rotational.Flange)
  at      test_connection_messages.py:N
              yield join(self.left.flange_a, self.shaft.flange_a)
  cause   a connection joins connectors of one type
  help    look for a component that has both connectors and put it between
""",
)
class FlangesOfTwoLibraries(Two):
    shaft: rotational.Inertia = part()

    def build(self) -> None:
        super().build()
        self.shaft = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield join(self.left.flange_a, self.shaft.flange_a)


@corpus.broken(
    "AC121",
    "left (Mass)",
    """
error[AC121]: left (Mass) is neither a connector nor a signal
  at      test_connection_messages.py:N
              yield join(self.left, self.right)
  help    connect one of its connectors: flange_a, flange_b
""",
)
class ConnectedComponents(Two):
    def equations(self) -> Equations:
        yield join(self.left, self.right)


@corpus.broken(
    "AC121",
    "left.s",
    """
error[AC121]: `left.s` is a variable, not a signal
  at      test_connection_messages.py:N
              yield join(self.left.s, self.right.s)
  help    only signal_input and signal_output are connected; write an equation for anything else
""",
)
class ConnectedVariables(Two):
    def equations(self) -> Equations:
        yield join(self.left.s, self.right.s)


class Signals(Component):
    """An output and two inputs that do not fit it."""

    x: Real = signal_output(unit="m")
    f: Real = signal_input(unit="N")
    r: Real = signal_input(unit="m", shape=3)


@corpus.broken(
    "AC105",
    "b.r",
    """
error[AC105]: `a.x` (scalar) and `b.r` (vector of 3) cannot be connected
  at      test_connection_messages.py:N
              yield connect(self.a.x, self.b.r)
  help    signals that are connected have one shape
""",
)
class SignalsOfDifferentShape(Component):
    a: Signals = part()
    b: Signals = part()

    def build(self) -> None:
        self.a = Signals()
        self.b = Signals()

    def equations(self) -> Equations:
        yield connect(self.a.x, self.b.r)


@corpus.broken(
    "AC154",
    "b.f",
    """
error[AC154]: `a.x` [m] and `b.f` [N] cannot be connected: their dimensions differ
  at      test_connection_messages.py:N
              yield connect(self.a.x, self.b.f)
  help    put a Gain that states the conversion between them
""",
)
class SignalsOfDifferentUnit(Component):
    a: Signals = part()
    b: Signals = part()

    def build(self) -> None:
        self.a = Signals()
        self.b = Signals()

    def equations(self) -> Equations:
        yield connect(self.a.x, self.b.f)


@corpus.broken(
    "AC128",
    "floor(x) < x",
    """
error[AC128]: the time derivative of floor(x) < x is needed and does not exist
  at      test_connection_messages.py:N
              yield self.y == der(floor(self.x) < self.x)
          y == der(floor(x) < x)
  help    it jumps, or is true or false: keep it out of der(...) and of prescribed positions
""",
)
class DerivativeOfARelation(Component):
    x: Real = variable()
    y: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == 1.0
        yield self.y == der(floor(self.x) < self.x)


@corpus.broken(
    "AC129",
    "Silent.equations",
    """
error[AC129]: Silent.equations yields nothing
  at      test_connection_messages.py:N
              def equations(self) -> Any:
  help    every equation needs a `yield`: yield left == right
""",
)
class Silent(Component):
    x: Real = variable()

    def equations(self) -> Any:
        self.x == 1.0  # noqa: B015


@corpus.broken(
    "AC130",
    "Half.equations",
    """
error[AC130]: Half.equations yields `x` (Symbol)
  at      test_connection_messages.py:N
              yield self.x
  help    yield an equation `left == right`, connect(a, b), when(...) or assert_(...)
""",
)
class Half(Component):
    x: Real = variable()

    def equations(self) -> Equations:
        yield self.x


@corpus.broken(
    "AC130",
    "Numbers.equations",
    """
error[AC130]: Numbers.equations yields `False` (bool)
  at      test_connection_messages.py:N
              yield 1.0 == 2.0
  cause   two plain numbers, or two connectors, were compared: Python decided it at once
  help    yield an equation `left == right`, connect(a, b), when(...) or assert_(...)
""",
)
class Numbers(Component):
    x: Real = variable()

    def equations(self) -> Equations:
        yield 1.0 == 2.0


@corpus.broken(
    "AC131",
    "Fixed",
    """
error[AC131]: flange of a Fixed is connected, but that Fixed is no part of the model
  at      test_connection_messages.py:N
              yield connect(self.left.flange_a, translational.Fixed().flange)
  help    declare it with part(), set it in `build`, and write self.<part>
""",
)
class ConnectedToAStranger(Two):
    def equations(self) -> Equations:
        yield connect(self.left.flange_a, translational.Fixed().flange)


stranger = Mass(m=1.0)


@corpus.broken(
    "AC131",
    "`s`",
    """
error[AC131]: `s` belongs to a Mass that is not part of the model
  at      test_connection_messages.py:N
              yield self.x == stranger.s
  at      test_connection_messages.py:N
              stranger = Mass(m=1.0)
                         ^^^^^^^^^^^
          x == s
  help    declare it with part(), set it in `build`, and write self.<part>
""",
)
class EquationWithAStranger(Component):
    x: Real = variable(unit="m")

    def equations(self) -> Equations:
        yield self.x == stranger.s


@corpus.broken(
    "AC132",
    "one.y and two.y",
    """
error[AC132]: two sources drive one signal: one.y and two.y
  at      test_connection_messages.py:N
              yield connect(self.one.y, self.gain.u)
  at      test_connection_messages.py:N
              yield connect(self.two.y, self.gain.u)
  help    connect each input to one output
""",
)
class TwoSources(Component):
    one: blocks.Constant = part()
    two: blocks.Constant = part()
    gain: blocks.Gain = part()

    def build(self) -> None:
        self.one = blocks.Constant(k=1.0)
        self.two = blocks.Constant(k=2.0)
        self.gain = blocks.Gain(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.one.y, self.gain.u)
        yield connect(self.two.y, self.gain.u)


@corpus.broken(
    "AC137",
    "force.u",
    """
error[AC137]: input force.u is both bound to `1` and connected
  at      test_connection_messages.py:N
              self.force = translational.Force(u=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^
  help    remove one of the two
""",
)
class BoundAndConnected(Component):
    signal: blocks.Constant = part()
    force: translational.Force = part()

    def build(self) -> None:
        self.signal = blocks.Constant(k=1.0)
        self.force = translational.Force(u=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.force.u)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
