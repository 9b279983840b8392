"""Nothing fixes a potential: circuits without ground, springs without a wall, frames without a world."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, fixed, part
from acausal.library import blocks, electrical, multibody, rotational, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC203",
    "R.p",
    """
error[AC203]: WithoutGround: nothing fixes the potential v of R.p, R.n, C.p and C.n
  at      test_references.py:N
              self.R = electrical.Resistor(R=1.0)
                       ^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              self.C = electrical.Capacitor(C=1.0, v=fixed(12.0))
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

    R: electrical.Resistor = part()
    C: electrical.Capacitor = part()

    def build(self) -> None:
        self.R = electrical.Resistor(R=1.0)
        self.C = electrical.Capacitor(C=1.0, v=fixed(12.0))

    def equations(self) -> Equations:
        yield connect(self.R.p, self.C.p)
        yield connect(self.C.n, self.R.n)


@corpus.broken(
    "AC203",
    "second",
    """
error[AC203]: SecondCircuit: nothing fixes the potential v of second, loads[0] and loads[1]
  at      test_references.py:N
              self.second = electrical.ConstantVoltage(V=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              self.loads = [electrical.Resistor(R=1.0), electrical.Resistor(R=2.0)]
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            second.v == second.p.v - second.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            loads[0].v == loads[0].p.v - loads[0].n.v   (Resistor, electrical/interfaces.py:N)
            loads[1].v == loads[1].p.v - loads[1].n.v   (Resistor, electrical/interfaces.py:N)
          while one of these follows from the others:
            the i of second.p, loads[0].p, loads[1].p sum to zero   (test_references.py:N)
            the i of second.n, loads[0].n, loads[1].n sum to zero   (test_references.py:N)
  cause   no component fixes a potential in this circuit
  help    add Ground and connect it to one pin
""",
)
class SecondCircuit(Component):
    """One circuit is grounded, the other is not; the currents have a junction of three."""

    first: electrical.ConstantVoltage = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()
    second: electrical.ConstantVoltage = part()
    loads: list[electrical.Resistor] = part()

    def build(self) -> None:
        self.first = electrical.ConstantVoltage(V=1.0)
        self.load = electrical.Resistor(R=1.0)
        self.ground = electrical.Ground()
        self.second = electrical.ConstantVoltage(V=1.0)
        self.loads = [electrical.Resistor(R=1.0), electrical.Resistor(R=2.0)]

    def equations(self) -> Equations:
        yield connect(self.first.p, self.load.p)
        yield connect(self.first.n, self.load.n, self.ground.p)
        yield connect(self.second.p, self.loads[0].p, self.loads[1].p)
        yield connect(self.second.n, self.loads[0].n, self.loads[1].n)


@corpus.broken(
    "AC203",
    "transformer.p2",
    """
error[AC203]: SecondarySide: nothing fixes the potential v of transformer.p2, transformer.n2, load.p and load.n
  at      test_references.py:N
              self.transformer = electrical.IdealTransformer(n=2.0)
                                 ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              self.load = electrical.Resistor(R=1.0)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            transformer.v2 == transformer.p2.v - transformer.n2.v   (IdealTransformer, electrical/interfaces.py:N)
            load.v == load.p.v - load.n.v   (Resistor, electrical/interfaces.py:N)
          while one of these follows from the others:
            the i of transformer.p2, load.p sum to zero   (test_references.py:N)
            the i of transformer.n2, load.n sum to zero   (test_references.py:N)
  cause   no component fixes a potential in this circuit
  help    add Ground and connect it to one pin
""",
)
class SecondarySide(Component):
    """A transformer separates the potentials of its sides: each needs a ground of its own."""

    source: electrical.SineVoltage = part()
    transformer: electrical.IdealTransformer = part()
    load: electrical.Resistor = part()
    ground: electrical.Ground = part()

    def build(self) -> None:
        self.source = electrical.SineVoltage(V=1.0, f=50.0)
        self.transformer = electrical.IdealTransformer(n=2.0)
        self.load = electrical.Resistor(R=1.0)
        self.ground = electrical.Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.transformer.p1)
        yield connect(self.source.n, self.transformer.n1, self.ground.p)
        yield connect(self.transformer.p2, self.load.p)
        yield connect(self.transformer.n2, self.load.n)


@corpus.broken(
    "AC203",
    "diode",
    """
error[AC203]: NonlinearWithoutGround: nothing fixes the potential v of source, resistor and diode
  at      test_references.py:N
              self.source = electrical.ConstantVoltage(V=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              self.resistor = electrical.Resistor(R=1.0)
                              ^^^^^^^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            source.v == source.p.v - source.n.v   (ConstantVoltage, electrical/interfaces.py:N)
            resistor.v == resistor.p.v - resistor.n.v   (Resistor, electrical/interfaces.py:N)
            diode.v == diode.p.v - diode.n.v   (Diode, electrical/interfaces.py:N)
          while one of these follows from the others:
            the i of source.p, resistor.p sum to zero   (test_references.py:N)
            the i of source.n, diode.n sum to zero   (test_references.py:N)
            the i of resistor.n, diode.p sum to zero   (test_references.py:N)
  cause   no component fixes a potential in this circuit
  help    add Ground and connect it to one pin
""",
)
class NonlinearWithoutGround(Component):
    """The same with a nonlinear characteristic, whose block of equations is torn."""

    source: electrical.ConstantVoltage = part()
    resistor: electrical.Resistor = part()
    diode: electrical.Diode = part()

    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.resistor = electrical.Resistor(R=1.0)
        self.diode = electrical.Diode()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.resistor.p)
        yield connect(self.resistor.n, self.diode.p)
        yield connect(self.diode.n, self.source.n)


@corpus.broken(
    "AC203",
    "spring.flange_a",
    """
error[AC203]: LoneSpring: nothing fixes the position s of spring.flange_a and spring.flange_b
  at      test_references.py:N
              self.spring = translational.Spring(c=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            spring.s_rel == spring.flange_b.s - spring.flange_a.s   (Spring, translational/interfaces.py:N)
          while one of these follows from the others:
            the f of spring.flange_a is zero: not connected   (test_references.py:N)
            the f of spring.flange_b is zero: not connected   (test_references.py:N)
  cause   is this flange connected to something with mass, to Fixed or to a Position source?
  help    connect spring.flange_a and spring.flange_b
""",
)
class LoneSpring(Component):
    """Both ends of a spring hang in the air."""

    spring: translational.Spring = part()

    def build(self) -> None:
        self.spring = translational.Spring(c=1.0)


@corpus.broken(
    "AC203",
    "damper and torque",
    """
error[AC203]: RotationWithoutInertia: nothing fixes the angle phi of damper and torque
  at      test_references.py:N
              self.damper = rotational.SpringDamper(c=1.0, d=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_references.py:N
              self.torque = rotational.Torque2()
                            ^^^^^^^^^^^^^^^^^^^^
          they occur only as differences:
            damper.phi_rel == damper.flange_b.phi - damper.flange_a.phi   (SpringDamper, rotational/interfaces.py:N)
          while one of these follows from the others:
            the tau of damper.flange_a, torque.flange_a sum to zero   (test_references.py:N)
            the tau of damper.flange_b, torque.flange_b sum to zero   (test_references.py:N)
  cause   is this flange connected to an inertia, to Fixed or to a Position source?
  help    connect one of them to a component that fixes it (a ground, a fixed point, a source)
""",
)
class RotationWithoutInertia(Component):
    """A torque twists a spring-damper, and nothing holds the pair."""

    damper: rotational.SpringDamper = part()
    torque: rotational.Torque2 = part()
    signal: blocks.Constant = part()

    def build(self) -> None:
        self.damper = rotational.SpringDamper(c=1.0, d=1.0)
        self.torque = rotational.Torque2()
        self.signal = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.torque.u)
        yield connect(self.damper.flange_a, self.torque.flange_a)
        yield connect(self.damper.flange_b, self.torque.flange_b)


@corpus.broken(
    "AC203",
    "joint.frame_a",
    """
error[AC203]: WithoutWorld: nothing fixes the orientation of joint.frame_a
  at      test_references.py:N
              self.joint = multibody.Revolute()
                           ^^^^^^^^^^^^^^^^^^^^
          not connected: joint.frame_a, bar.frame_b
  cause   no World, Fixed or Body is in this island of frames
  help    connect joint.frame_a or bar.frame_b to World.frame_b, Fixed.frame_b or a Body
""",
)
class WithoutWorld(Component):
    """Frames that are tied to each other, but neither to the world nor to a body."""

    joint: multibody.Revolute = part()
    bar: multibody.FixedTranslation = part()

    def build(self) -> None:
        self.joint = multibody.Revolute()
        self.bar = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.joint.frame_b, self.bar.frame_a)


@corpus.broken(
    "AC201",
    "joint.phi",
    """
error[AC201]: WithoutMass: nothing determines joint.phi
  at      test_references.py:N
              self.joint = multibody.Revolute()
                           ^^^^^^^^^^^^^^^^^^^^
          free with it: joint.w and joint.a
          because these do not hold it:
            joint.tau == -((0, 0, 1) @ joint.frame_b.t)   (Revolute, joints/revolute.py:N)
            joint.axis.tau == joint.tau   (Revolute, joints/revolute.py:N)
            bar.frame_a.t + bar.frame_b.t + cross(bar.r, bar.frame_b.f) == 0   (FixedTranslation, multibody/parts.py:N)
            the t of joint.frame_b, bar.frame_a sum to zero   (test_references.py:N)
            and 3 more equations
  cause   the angle of the joint cannot be determined: does a body with inertia about the axis turn with frame_b?
  help    connect joint to what determines it
""",
)
class WithoutMass(Component):
    """A joint that moves nothing: its angle follows from no equation."""

    world: multibody.World = part()
    joint: multibody.Revolute = part()
    bar: multibody.FixedTranslation = part()

    def build(self) -> None:
        self.world = multibody.World()
        self.joint = multibody.Revolute()
        self.bar = multibody.FixedTranslation(r=(1.0, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.bar.frame_a)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
