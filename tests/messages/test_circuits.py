"""Circuits that cannot be: loops of sources and storages, cutsets of currents, islands, wrong domains."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import blocks, electrical, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205",
    "first and second",
    "electrical.ConstantCurrent(I=1.0)",
    "electrical.ConstantCurrent(I=2.0)",
    text="""
error[AC205]: CurrentCutset: first and second both prescribe first.n.i
  at      test_circuits.py:N
              first: electrical.ConstantCurrent = electrical.ConstantCurrent(I=1.0)
                                                  ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_circuits.py:N
              second: electrical.ConstantCurrent = electrical.ConstantCurrent(I=2.0)
                                                   ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            first.p.i + first.n.i == 0   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.I   (ConstantCurrent, electrical/sources.py:N)
            second.i == second.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            second.i == second.I   (ConstantCurrent, electrical/sources.py:N)
            the i of first.n, second.p sum to zero   (test_circuits.py:N)
          together they demand 0 == 1
          and leave undetermined: first.v, first.n.v, second.v and second.p.v
  cause   the flows into a junction sum to zero, so that sources in series must agree
  help    remove one of them, or connect something that takes up the difference
""",
)
class CurrentCutset(Component):
    """Two sources of different current in series."""

    first: electrical.ConstantCurrent = electrical.ConstantCurrent(I=1.0)
    second: electrical.ConstantCurrent = electrical.ConstantCurrent(I=2.0)
    load: electrical.Resistor = electrical.Resistor(R=1.0)
    ground: electrical.Ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.first.n, self.second.p)
        yield connect(self.second.n, self.load.p)
        yield connect(self.load.n, self.first.p, self.ground.p)


@corpus.broken("AC303", "ratio.y", "blocks.Constant(k=0.0)", "yield self.y == self.u1 / self.u2")
class QuotientOfConstants(Component):
    """A division by a constant that is zero; nothing depends on it and nothing moves."""

    above: blocks.Constant = blocks.Constant(k=1.0)
    below: blocks.Constant = blocks.Constant(k=0.0)
    ratio: blocks.Division = blocks.Division()

    def equations(self) -> Equations:
        yield connect(self.above.y, self.ratio.u1)
        yield connect(self.below.y, self.ratio.u2)


@corpus.broken(
    "AC116",
    "'mass' is declared as Mass",
    "self.mass = translational.Spring(c=1.0)  # type: ignore[assignment]",
    "mass: translational.Mass = part()",
)
class AnotherClass(Component):
    """Declared as one class, made as another."""

    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Spring(c=1.0)  # type: ignore[assignment]


corpus.table(
    """
RingOfSources AC205 one, two and three
# Three voltage sources in a ring.
one: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=5.0)>>
two: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
three: electrical.ConstantVoltage = electrical.ConstantVoltage(V=5.0)
ground: electrical.Ground = electrical.Ground()
yield connect(self.one.p, self.two.p)
yield connect(self.two.n, self.three.p)
yield connect(self.three.n, self.one.n, self.ground.p)

CapacitorLoop AC302 right.v
# Two capacitors side by side that start at different voltages.
left: electrical.Capacitor = electrical.Capacitor(C=1e-6, v=fixed(1.0))
right: electrical.Capacitor = <<electrical.Capacitor(C=1e-6, v=fixed(2.0))>>
load: electrical.Resistor = electrical.Resistor(R=1.0)
ground: electrical.Ground = electrical.Ground()
yield connect(self.left.p, self.right.p, self.load.p)
yield connect(self.left.n, self.right.n, self.load.n, self.ground.p)

InductorCutset AC302 coil.i
# A source of current through a coil that starts without any.
source: electrical.ConstantCurrent = electrical.ConstantCurrent(I=5.0)
coil: electrical.Inductor = <<electrical.Inductor(L=1e-3, i=fixed(0.0))>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.n, self.coil.p)
yield connect(self.source.p, self.coil.n, self.ground.p)

AmmeterAcross AC205 source and meter
# An ammeter across a source of voltage.
source: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
meter: electrical.CurrentSensor = <<electrical.CurrentSensor()>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.meter.p)
yield connect(self.source.n, self.meter.n, self.ground.p)

ZeroResistance AC205 source and load
# A resistor of no resistance: a short circuit by a value.
source: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
load: electrical.Resistor = <<electrical.Resistor(R=0.0)>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.load.p)
yield connect(self.source.n, self.load.n, self.ground.p)

GainsInACircle AC204 first and second
# Gains whose product is one, each feeding the other.
first: blocks.Gain = <<blocks.Gain(k=2.0)>>
second: blocks.Gain = <<blocks.Gain(k=0.5)>>
yield connect(self.first.y, self.second.u)
yield connect(self.second.y, self.first.u)

PinOnAShaft AC120 load.p (Pin) and shaft.flange_a (Flange)
load: electrical.Resistor = electrical.Resistor(R=1.0)
shaft: rotational.Inertia = rotational.Inertia(J=1.0)
> yield connect(self.load.p, self.shaft.flange_a)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
