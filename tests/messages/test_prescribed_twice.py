"""Two components fix one potential or one difference of potentials."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import blocks, electrical, rotational, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205",
    "low and high",
    """
error[AC205]: ParallelSources: low and high both prescribe low.p.v - low.n.v
  at      test_prescribed_twice.py:N
              self.low = electrical.ConstantVoltage(V=1.0)
                         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.high = electrical.ConstantVoltage(V=2.0)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            low.v == low.p.v - low.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            low.v == low.V   (ConstantVoltage, electrical/sources.py:N)
            high.v == high.p.v - high.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            high.v == high.V   (ConstantVoltage, electrical/sources.py:N)
          together they demand 0 == 1
          and leave open: low.p.i, low.n.i, high.p.i and high.n.i
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class ParallelSources(Component):
    """Two voltage sources of different voltage in parallel."""

    low: electrical.ConstantVoltage = part()
    high: electrical.ConstantVoltage = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.low = electrical.ConstantVoltage(V=1.0)
        self.high = electrical.ConstantVoltage(V=2.0)
        self.load = electrical.Resistor(R=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.low.p, self.high.p, self.load.p)
        yield connect(self.low.n, self.high.n, self.load.n, self.ground.p)


@corpus.broken(
    "AC205",
    "here and there",
    """
error[AC205]: TwoGrounds: here and there both prescribe here.p.v
  at      test_prescribed_twice.py:N
              self.here = electrical.Ground()
                          ^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.there = electrical.Ground()
                           ^^^^^^^^^^^^^^^^^^^
          these do:
            here.p.v == 0   (Ground, electrical/components.py:N)
            there.p.v == 0   (Ground, electrical/components.py:N)
          one of them follows from the others
          and leave open: here.p.i and there.p.i
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class TwoGrounds(Component):
    """The potential is the same; how the current divides is not known."""

    source: electrical.ConstantVoltage = part()
    load: electrical.Resistor = part()
    here: electrical.Ground = part()
    there: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.load = electrical.Resistor(R=1.0)
        self.here = electrical.Ground()
        self.there = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.load.p)
        yield connect(self.source.n, self.load.n, self.here.p, self.there.p)


@corpus.broken(
    "AC205",
    "source",
    """
error[AC205]: ShortCircuit: source prescribes a difference between source.p and source.n, which are one point
  at      test_prescribed_twice.py:N
              self.source = electrical.ConstantVoltage(V=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            source.v == source.p.v - source.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            source.v == source.V   (ConstantVoltage, electrical/sources.py:N)
          together they demand 0 == 1
          and leave open: source.p.i and source.n.i
  cause   source.p and source.n are connected with each other
  help    remove that connection, or put something between them
""",
)
class ShortCircuit(Component):
    """A voltage source whose pins are one point."""

    source: electrical.ConstantVoltage = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.source.n, self.ground.p)


@corpus.broken(
    "AC205",
    "left, rod and right",
    """
error[AC205]: RodBetweenWalls: left, rod and right together prescribe left.flange.s - rod.flange_b.s twice
  at      test_prescribed_twice.py:N
              self.left = translational.Fixed()
                          ^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.rod = translational.Rod(L=1.0)
                         ^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.right = translational.Fixed(s0=2.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            left.flange.s == left.s0   (Fixed, translational/components.py:N)
            rod.flange_a.s == rod.s - rod.L / 2   (Rod, translational/interfaces.py:N)
            rod.flange_b.s == rod.s + rod.L / 2   (Rod, translational/interfaces.py:N)
            right.flange.s == right.s0   (Fixed, translational/components.py:N)
          together they demand 0 == 1
          and leave open: left.flange.f, rod.flange_a.f, rod.flange_b.f and right.flange.f
  cause   is the position of this flange fixed twice, by two components such as Fixed or Position?
  help    remove one of them, or put something compliant between them
""",
)
class RodBetweenWalls(Component):
    """The rod is 1 m long, the walls are 2 m apart."""

    left: translational.Fixed = part()
    rod: translational.Rod = part()
    right: translational.Fixed = part()

    def build(self) -> None:
        self.left = translational.Fixed()
        self.rod = translational.Rod(L=1.0)
        self.right = translational.Fixed(s0=2.0)

    def equations(self) -> Equations:
        yield connect(self.left.flange, self.rod.flange_a)
        yield connect(self.rod.flange_b, self.right.flange)


@corpus.broken(
    "AC205",
    "upper and lower",
    """
error[AC205]: ParallelRods: upper and lower both prescribe upper.flange_a.s - upper.flange_b.s
  at      test_prescribed_twice.py:N
              self.upper = translational.Rod(L=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.lower = translational.Rod(L=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            upper.flange_a.s == upper.s - upper.L / 2   (Rod, translational/interfaces.py:N)
            upper.flange_b.s == upper.s + upper.L / 2   (Rod, translational/interfaces.py:N)
            lower.flange_a.s == lower.s - lower.L / 2   (Rod, translational/interfaces.py:N)
            lower.flange_b.s == lower.s + lower.L / 2   (Rod, translational/interfaces.py:N)
          one of them follows from the others
          and leave open: upper.flange_a.f, upper.flange_b.f, lower.flange_a.f and lower.flange_b.f
  cause   is the position of this flange fixed twice, by two components such as Fixed or Position?
  help    remove one of them, or put something compliant between them
""",
)
class ParallelRods(Component):
    """Two equal rods side by side: who bears which part of the load is not known."""

    wall: translational.Fixed = part()
    spring: translational.Spring = part()
    upper: translational.Rod = part()
    lower: translational.Rod = part()
    mass: translational.Mass = part()

    def build(self) -> None:
        self.wall = translational.Fixed()
        self.spring = translational.Spring(c=1.0)
        self.upper = translational.Rod(L=1.0)
        self.lower = translational.Rod(L=1.0)
        self.mass = translational.Mass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.upper.flange_a, self.lower.flange_a)
        yield connect(self.upper.flange_b, self.lower.flange_b, self.mass.flange_a)


@corpus.broken(
    "AC205",
    "drive, brake",
    """
error[AC205]: TwoSpeeds: drive, brake and inertia together prescribe drive.flange.phi - brake.flange.phi twice
  at      test_prescribed_twice.py:N
              self.drive = rotational.Speed()
                           ^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.brake = rotational.Speed()
                           ^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              self.inertia = rotational.Inertia(J=1.0)
                             ^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            drive.phi == drive.flange.phi   (Speed, rotational/sources.py:N)
            drive.w == der(drive.phi)   (Speed, rotational/sources.py:N)
            drive.w == drive.w_ref   (Speed, rotational/sources.py:N)
            brake.phi == brake.flange.phi   (Speed, rotational/sources.py:N)
            brake.w == der(brake.phi)   (Speed, rotational/sources.py:N)
            brake.w == brake.w_ref   (Speed, rotational/sources.py:N)
            inertia.phi == inertia.flange_a.phi   (Inertia, rotational/components.py:N)
            inertia.phi == inertia.flange_b.phi   (Inertia, rotational/components.py:N)
          one of them follows from the others
          and leave open: drive.flange.tau, brake.flange.tau, inertia.flange_a.tau and inertia.flange_b.tau
  cause   is the angle of this flange fixed twice, by two components such as Fixed or Position?
  help    remove one of them, or put something compliant between them
""",
)
class TwoSpeeds(Component):
    """Two speed sources on one shaft."""

    drive: rotational.Speed = part()
    brake: rotational.Speed = part()
    inertia: rotational.Inertia = part()
    signal: blocks.Constant = part()

    def build(self) -> None:
        self.drive = rotational.Speed()
        self.brake = rotational.Speed()
        self.inertia = rotational.Inertia(J=1.0)
        self.signal = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.drive.w_ref, self.brake.w_ref)
        yield connect(self.drive.flange, self.inertia.flange_a)
        yield connect(self.brake.flange, self.inertia.flange_b)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
