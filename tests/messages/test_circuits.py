"""Circuits that cannot be: loops of sources and storages, cutsets of currents, islands, wrong domains."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, fixed, part
from acausal.library import blocks, electrical, rotational, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205",
    "first and second",
    """
error[AC205]: CurrentCutset: first and second both prescribe first.n.i
  at      test_circuits.py:N
              self.first = electrical.ConstantCurrent(I=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.second = electrical.ConstantCurrent(I=2.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            first.p.i + first.n.i == 0   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.I   (ConstantCurrent, electrical/sources.py:N)
            second.i == second.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            second.i == second.I   (ConstantCurrent, electrical/sources.py:N)
            the i of first.n, second.p sum to zero   (test_circuits.py:N)
          together they demand 0 == 1
          and leave open: first.v, first.n.v, second.v and second.p.v
  cause   what flows into a junction must flow out again; sources in series leave no choice
  help    remove one of them, or connect something that takes up the difference
""",
)
class CurrentCutset(Component):
    """Two sources of different current in series."""

    first: electrical.ConstantCurrent = part()
    second: electrical.ConstantCurrent = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.first = electrical.ConstantCurrent(I=1.0)
        self.second = electrical.ConstantCurrent(I=2.0)
        self.load = electrical.Resistor(R=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.first.n, self.second.p)
        yield connect(self.second.n, self.load.p)
        yield connect(self.load.n, self.first.p, self.ground.p)


@corpus.broken(
    "AC205",
    "one, two and three",
    """
error[AC205]: RingOfSources: one, two and three together prescribe one.p.v, one.n.v and two.n.v twice
  at      test_circuits.py:N
              self.one = electrical.ConstantVoltage(V=5.0)
                         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.two = electrical.ConstantVoltage(V=1.0)
                         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.three = electrical.ConstantVoltage(V=5.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            one.v == one.p.v - one.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            one.v == one.V   (ConstantVoltage, electrical/sources.py:N)
            two.v == two.p.v - two.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            two.v == two.V   (ConstantVoltage, electrical/sources.py:N)
            three.v == three.p.v - three.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            three.v == three.V   (ConstantVoltage, electrical/sources.py:N)
          together they demand 0 == 1
          and leave open: one.p.i, one.n.i, two.p.i, two.n.i and 2 more
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class RingOfSources(Component):
    """Three voltage sources in a ring."""

    one: electrical.ConstantVoltage = part()
    two: electrical.ConstantVoltage = part()
    three: electrical.ConstantVoltage = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.one = electrical.ConstantVoltage(V=5.0)
        self.two = electrical.ConstantVoltage(V=1.0)
        self.three = electrical.ConstantVoltage(V=5.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.one.p, self.two.p)
        yield connect(self.two.n, self.three.p)
        yield connect(self.three.n, self.one.n, self.ground.p)


@corpus.bad_start(
    "AC302",
    "right.v",
    """
error[AC302]: CapacitorLoop: the start value right.v = 2 contradicts the others, which make it 1
  at      test_circuits.py:N
              self.right = electrical.Capacitor(C=1e-6, v=fixed(2.0))
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          given too:
            left.v = 1   (test_circuits.py:N)
  cause   more is fixed at the start than the 1 state can follow: left.v
  help    remove one of them, or make it a guess: v=guess(2)
""",
)
class CapacitorLoop(Component):
    """Two capacitors side by side that start at different voltages."""

    left: electrical.Capacitor = part()
    right: electrical.Capacitor = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.left = electrical.Capacitor(C=1e-6, v=fixed(1.0))
        self.right = electrical.Capacitor(C=1e-6, v=fixed(2.0))
        self.load = electrical.Resistor(R=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.left.p, self.right.p, self.load.p)
        yield connect(self.left.n, self.right.n, self.load.n, self.ground.p)


@corpus.bad_start(
    "AC302",
    "coil.i",
    """
error[AC302]: InductorCutset: the start value coil.i = 0 contradicts the others, which make it 5
  at      test_circuits.py:N
              self.coil = electrical.Inductor(L=1e-3, i=fixed(0.0))
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  cause   the equations determine it at every time: no state is left to be chosen at the start
  help    remove one of them, or make it a guess: i=guess(0)
""",
)
class InductorCutset(Component):
    """A source of current through a coil that starts without any."""

    source: electrical.ConstantCurrent = part()
    coil: electrical.Inductor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.ConstantCurrent(I=5.0)
        self.coil = electrical.Inductor(L=1e-3, i=fixed(0.0))
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.n, self.coil.p)
        yield connect(self.source.p, self.coil.n, self.ground.p)


@corpus.broken(
    "AC205",
    "source and meter",
    """
error[AC205]: AmmeterAcross: source and meter both prescribe source.p.v - source.n.v
  at      test_circuits.py:N
              self.source = electrical.ConstantVoltage(V=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.meter = electrical.CurrentSensor()
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            source.v == source.p.v - source.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            source.v == source.V   (ConstantVoltage, electrical/sources.py:N)
            meter.p.v == meter.n.v   (CurrentSensor, electrical/sensors.py:N)
          together they demand 0 == 1
          and leave open: source.p.i, source.n.i, meter.p.i and meter.n.i
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class AmmeterAcross(Component):
    """An ammeter across a source of voltage."""

    source: electrical.ConstantVoltage = part()
    meter: electrical.CurrentSensor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.meter = electrical.CurrentSensor()
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.meter.p)
        yield connect(self.source.n, self.meter.n, self.ground.p)


@corpus.broken(
    "AC205",
    "source and load",
    """
error[AC205]: ZeroResistance: source and load both prescribe source.p.v - source.n.v
  at      test_circuits.py:N
              self.source = electrical.ConstantVoltage(V=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.load = electrical.Resistor(R=0.0)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            source.v == source.p.v - source.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            source.v == source.V   (ConstantVoltage, electrical/sources.py:N)
            load.v == load.p.v - load.n.v   (Resistor, electrical/interfaces.py:N)
            load.v == load.R * load.i   (Resistor, electrical/components.py:N)
          together they demand 0 == 1
          and leave open: source.p.i, source.n.i, load.p.i and load.n.i
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class ZeroResistance(Component):
    """A resistor of no resistance: a short circuit by a value."""

    source: electrical.ConstantVoltage = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.load = electrical.Resistor(R=0.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.load.p)
        yield connect(self.source.n, self.load.n, self.ground.p)


@corpus.broken(
    "AC204",
    "first and second",
    """
error[AC204]: GainsInACircle: equations of first and second say the same twice for first.k = 2 and second.k = 0.5
  at      test_circuits.py:N
              self.first = blocks.Gain(k=2.0)
                           ^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              self.second = blocks.Gain(k=0.5)
                            ^^^^^^^^^^^^^^^^^^
          their unknowns cancel:
            first.y == first.k * first.u   (Gain, blocks/math.py:N)
            second.y == second.k * second.u   (Gain, blocks/math.py:N)
          one of them follows from the others
          and leave open: first.u, first.y, second.u and second.y
  cause   with other values of these parameters the equations would determine their unknowns
  help    change first.k and second.k, or model what is idealised away
""",
)
class GainsInACircle(Component):
    """Gains whose product is one, each feeding the other."""

    first: blocks.Gain = part()
    second: blocks.Gain = part()

    def build(self) -> None:
        self.first = blocks.Gain(k=2.0)
        self.second = blocks.Gain(k=0.5)

    def equations(self) -> Equations:
        yield connect(self.first.y, self.second.u)
        yield connect(self.second.y, self.first.u)


@corpus.bad_start(
    "AC303",
    "ratio.y",
    """
error[AC303]: QuotientOfConstants: ratio.y has no finite value at the start (t = 0 s) for below.k = 0
  at      test_circuits.py:N
              self.below = blocks.Constant(k=0.0)
                           ^^^^^^^^^^^^^^^^^^^^^^
  at      blocks/math.py:N
              yield self.y == self.u1 / self.u2
          ratio.y == ratio.u1 / ratio.u2   (Division, blocks/math.py:N)
          with above.k = 1, below.k = 0
  cause   it divides by `below.k`, which is 0
  help    give below.k another value
""",
)
class QuotientOfConstants(Component):
    """A division by a constant that is zero; nothing depends on it and nothing moves."""

    above: blocks.Constant = part()
    below: blocks.Constant = part()
    ratio: blocks.Division = part()

    def build(self) -> None:
        self.above = blocks.Constant(k=1.0)
        self.below = blocks.Constant(k=0.0)
        self.ratio = blocks.Division()

    def equations(self) -> Equations:
        yield connect(self.above.y, self.ratio.u1)
        yield connect(self.below.y, self.ratio.u2)


@corpus.broken(
    "AC120",
    "load.p (Pin) and shaft.flange_a (Flange)",
    """
error[AC120]: cannot connect load.p (Pin) and shaft.flange_a (Flange)
  at      test_circuits.py:N
              yield connect(self.load.p, self.shaft.flange_a)
  cause   a connection joins connectors of one type
  help    look for a component that has both connectors and put it between
""",
)
class PinOnAShaft(Component):
    load: electrical.Resistor = part()
    shaft: rotational.Inertia = part()

    def build(self) -> None:
        self.load = electrical.Resistor(R=1.0)
        self.shaft = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield connect(self.load.p, self.shaft.flange_a)


@corpus.broken(
    "AC116",
    "'mass' is declared as Mass",
    """
error[AC116]: AnotherClass: part 'mass' is declared as Mass, Spring is none
  at      test_circuits.py:N
              self.mass = translational.Spring(c=1.0)  # type: ignore[assignment]
  at      test_circuits.py:N
              mass: translational.Mass = part()
  help    make translational.Mass(...), or declare a class that both derive from
""",
)
class AnotherClass(Component):
    """Declared as one class, made as another."""

    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Spring(c=1.0)  # type: ignore[assignment]


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
