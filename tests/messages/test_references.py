"""Potentials that nothing fixes or two components fix, flows that go nowhere or are driven twice."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, fixed
from acausal.library import electrical
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC203",
    "R.p",
    "electrical.Resistor(R=1.0)",
    "electrical.Capacitor(C=1.0, v=fixed(12.0))",
    text="""
error[AC203]: WithoutGround: nothing fixes the potential v of R.p, R.n, C.p and C.n
  at      test_references.py:N
              R: electrical.Resistor = electrical.Resistor(R=1.0)
                                       ^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              C: electrical.Capacitor = electrical.Capacitor(C=1.0, v=fixed(12.0))
                                        ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            R.v == R.p.v - R.n.v   (Resistor, electrical/interfaces.py:N)
            C.v == C.p.v - C.n.v   (Capacitor, electrical/interfaces.py:N)
          while one of these follows from the others:
            the i of R.p, C.p sum to zero   (test_references.py:N)
            the i of R.n, C.n sum to zero   (test_references.py:N)
  cause   no component fixes a potential in this circuit
  help    add Ground and connect it to one pin
""",
)
class WithoutGround(Component):
    """OpenModelica issue 9944, "underdetermined equation system not detected properly": an internal error there."""

    R: electrical.Resistor = electrical.Resistor(R=1.0)
    C: electrical.Capacitor = electrical.Capacitor(C=1.0, v=fixed(12.0))

    def equations(self) -> Equations:
        yield connect(self.R.p, self.C.p)
        yield connect(self.C.n, self.R.n)


@corpus.broken(
    "AC205",
    "low and high",
    "electrical.ConstantVoltage(V=1.0)",
    "electrical.ConstantVoltage(V=2.0)",
    text="""
error[AC205]: ParallelSources: low and high both prescribe low.p.v - low.n.v
  at      test_references.py:N
              low: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
                                                ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
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
SecondCircuit AC203 second
# One circuit is grounded, the other is not; the currents have a junction of three.
first: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
load: electrical.Resistor = <<electrical.Resistor(R=1.0)>>
ground: electrical.Ground = electrical.Ground()
second: electrical.ConstantVoltage = electrical.ConstantVoltage(V=1.0)
loads: list[electrical.Resistor] = part()
build: self.loads = [electrical.Resistor(R=1.0), electrical.Resistor(R=2.0)]
yield connect(self.first.p, self.load.p)
yield connect(self.first.n, self.load.n, self.ground.p)
yield connect(self.second.p, self.loads[0].p, self.loads[1].p)
yield connect(self.second.n, self.loads[0].n, self.loads[1].n)

SecondarySide AC203 transformer.p2
# A transformer separates the potentials of its sides: each needs a ground of its own.
source: electrical.SineVoltage = electrical.SineVoltage(V=1.0, f=50.0)
transformer: electrical.IdealTransformer = <<electrical.IdealTransformer(n=2.0)>>
load: electrical.Resistor = <<electrical.Resistor(R=1.0)>>
ground: electrical.Ground = electrical.Ground()
yield connect(self.source.p, self.transformer.p1)
yield connect(self.source.n, self.transformer.n1, self.ground.p)
yield connect(self.transformer.p2, self.load.p)
yield connect(self.transformer.n2, self.load.n)

NonlinearWithoutGround AC203 diode
# The same with a nonlinear characteristic, whose block of equations is torn.
source: electrical.ConstantVoltage = <<electrical.ConstantVoltage(V=1.0)>>
resistor: electrical.Resistor = <<electrical.Resistor(R=1.0)>>
diode: electrical.Diode = electrical.Diode()
yield connect(self.source.p, self.resistor.p)
yield connect(self.resistor.n, self.diode.p)
yield connect(self.diode.n, self.source.n)

LoneSpring AC203 spring.flange_a
# Both ends of a spring hang in the air.
spring: translational.Spring = <<translational.Spring(c=1.0)>>

RotationWithoutInertia AC203 damper and torque
# A torque twists a spring-damper, and nothing holds the pair.
damper: rotational.SpringDamper = <<rotational.SpringDamper(c=1.0, d=1.0)>>
torque: rotational.Torque2 = <<rotational.Torque2()>>
signal: blocks.Constant = blocks.Constant(k=1.0)
yield connect(self.signal.y, self.torque.u)
yield connect(self.damper.flange_a, self.torque.flange_a)
yield connect(self.damper.flange_b, self.torque.flange_b)

WithoutWorld AC203 joint.frame_a
# Frames that are tied to each other, but neither to the world nor to a body.
joint: multibody.Revolute = <<multibody.Revolute()>>
bar: multibody.FixedTranslation = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))
yield connect(self.joint.frame_b, self.bar.frame_a)

WithoutMass AC201 joint.phi
# A joint that moves nothing: its angle follows from no equation.
world: multibody.World = multibody.World()
joint: multibody.Revolute = <<multibody.Revolute()>>
bar: multibody.FixedTranslation = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))
yield connect(self.world.frame_b, self.joint.frame_a)
yield connect(self.joint.frame_b, self.bar.frame_a)

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

ForceOnLooseSpring AC205 force and spring
# The force has to go through a spring whose other end holds on to nothing.
force: translational.ConstantForce = <<translational.ConstantForce(f_constant=1.0)>>
spring: translational.Spring = <<translational.Spring(c=1.0)>>
yield connect(self.force.flange, self.spring.flange_b)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
