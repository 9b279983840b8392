"""Two components fix one potential or one difference of potentials."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect
from acausal.library import electrical
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205",
    "low and high",
    "electrical.ConstantVoltage(V=1.0)",
    "electrical.ConstantVoltage(V=2.0)",
    text="""
error[AC205]: ParallelSources: low and high both prescribe low.p.v - low.n.v
  at      test_prescribed_twice.py:N
              low: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
                                                ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_twice.py:N
              high: electrical.ConstantVoltage = electrical.ConstantVoltage(V=2.0)
                                                 ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            low.v == low.p.v - low.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            low.v == low.V   (ConstantVoltage, electrical/sources.py:N)
            high.v == high.p.v - high.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            high.v == high.V   (ConstantVoltage, electrical/sources.py:N)
          together they demand 0 == 1
          and leave undetermined: low.p.i, low.n.i, high.p.i and high.n.i
  cause   is the voltage here fixed twice: two voltage sources in parallel, or a second Ground?
  help    remove one of them, or put something compliant between them
""",
)
class ParallelSources(Component):
    """Two voltage sources of different voltage in parallel."""

    low: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
    high: electrical.ConstantVoltage = electrical.ConstantVoltage(V=2.0)
    load: electrical.Resistor = electrical.Resistor(R=1.0)
    ground: electrical.Ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.low.p, self.high.p, self.load.p)
        yield connect(self.low.n, self.high.n, self.load.n, self.ground.p)


corpus.table(
    """
TwoGrounds AC205 here and there
# The potential is the same; how the current divides is not known.
source: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
load: electrical.Resistor = electrical.Resistor(R=1.0)
here: electrical.Ground = <<electrical.Ground()>>
there: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.load.p)
yield connect(self.source.n, self.load.n, self.here.p, self.there.p)

ShortCircuit AC205 source
# A voltage source whose pins are one point.
source: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.source.n, self.ground.p)

RodBetweenWalls AC205 left, rod and right
# The rod is 1 m long, the walls are 2 m apart.
left: translational.Fixed = <<translational.Fixed()>>
rod: translational.Rod = <<translational.Rod(L=1.0)>>
right: translational.Fixed = <<translational.Fixed(s0=2.0)>>
yield connect(self.left.flange, self.rod.flange_a)
yield connect(self.rod.flange_b, self.right.flange)

ParallelRods AC205 upper and lower
# Two equal rods side by side: who bears which part of the load is not known.
wall: translational.Fixed = translational.Fixed()
spring: translational.Spring = translational.Spring(c=1.0)
upper: translational.Rod = <<translational.Rod(L=1.0)>>
lower: translational.Rod = translational.Rod(L=1.0)
mass: translational.Mass = translational.Mass(m=1.0)
yield connect(self.wall.flange, self.spring.flange_a)
yield connect(self.spring.flange_b, self.upper.flange_a, self.lower.flange_a)
yield connect(self.upper.flange_b, self.lower.flange_b, self.mass.flange_a)

TwoSpeeds AC205 drive, brake
# Two speed sources on one shaft.
drive: rotational.Speed = <<rotational.Speed()>>
brake: rotational.Speed = rotational.Speed()
inertia: rotational.Inertia = <<rotational.Inertia(J=1.0)>>
signal: blocks.Constant = blocks.Constant(k=1.0)
yield connect(self.signal.y, self.drive.w_ref, self.brake.w_ref)
yield connect(self.drive.flange, self.inertia.flange_a)
yield connect(self.brake.flange, self.inertia.flange_b)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
