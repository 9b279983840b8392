"""Mechanisms that cannot be: loops of rods, frames that hang in the air, two drives on one axis, deep hierarchies."""

from __future__ import annotations

from typing import Any

import pytest

from acausal import Component, Equations, Real, connect, fixed, part, structural, variable
from acausal.library import blocks, electrical, rotational, translational
from acausal.library.multibody import Body, BodyShape, FixedTranslation, Revolute, Spherical, World
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC206",
    "world, a, b and c",
    """
error[AC206]: RodTriangle: the closed loop of world, a, b and c is overconstrained
  at      test_mechanisms.py:N
              yield connect(self.c.frame_b, self.world.frame_b)
          the loop: world - a - b - c
          closed between c.frame_b and world.frame_b
          not determined: world.frame_b.t[0], world.frame_b.t[1], world.frame_b.t[2], a.frame_a.f[0] and 35 more
  cause   nothing in this loop can move: its parts hold each other twice, and how they share a load is open
  help    remove one of the connections, or put a joint or something compliant between two of the parts
""",
)
class RodTriangle(Component):
    """Three rigid rods between three points of the world."""

    world: World = part()
    a: FixedTranslation = part()
    b: FixedTranslation = part()
    c: FixedTranslation = part()

    def build(self) -> None:
        self.world = World()
        self.a = FixedTranslation(r=(1.0, 0.0, 0.0))
        self.b = FixedTranslation(r=(-1.0, 1.0, 0.0))
        self.c = FixedTranslation(r=(0.0, -1.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.a.frame_a)
        yield connect(self.a.frame_b, self.b.frame_a)
        yield connect(self.b.frame_b, self.c.frame_a)
        yield connect(self.c.frame_b, self.world.frame_b)


@corpus.broken(
    "AC206",
    "joint, link and ball",
    """
error[AC206]: TooFewFreedoms: the closed loop of world, base, joint, link and ball is overconstrained
  at      test_mechanisms.py:N
              self.joint = Revolute()
                           ^^^^^^^^^^
  at      test_mechanisms.py:N
              self.link = BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0))
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_mechanisms.py:N
              self.ball = Spherical()
                          ^^^^^^^^^^^
          not determined: world.frame_b.f[0], world.frame_b.f[1], world.frame_b.f[2], world.frame_b.t[0] and 28 more
          constrained by:
            world.frame_b.R == ((1, 0, 0), (0, 1, 0), (0, 0, 1))   (World, multibody/world.py:N)
            base.frame_b.r_0 == base.frame_a.r_0 + base.frame_a.R @ base.r   (FixedTranslation, multibody/parts.py:N)
            joint.frame_b.r_0 == joint.frame_a.r_0   (Revolute, joints/revolute.py:N)
            joint.frame_b.R == joint.frame_a.R @ ((cos(joint.phi), -sin(joint.phi), 0), (sin(joint.phi), cos(joint.phi ...   (Revolute, joints/revolute.py:N)
            link.frame_b.r_0 == link.frame_a.r_0 + link.frame_a.R @ link.r   (BodyShape, multibody/bodies.py:N)
            ball.frame_b.r_0 == ball.frame_a.r_0   (Spherical, joints/spherical.py:N)
  cause   its joints leave fewer motions than it takes to close the loop: in space these are six
  help    replace one of its joints by one with more freedom, or remove a rigid connection
""",  # noqa: E501
)
class TooFewFreedoms(Component):
    """A hinge and a ball joint between two fixed points: one rotation too few to close the loop."""

    world: World = part()
    base: FixedTranslation = part()
    joint: Revolute = part()
    link: BodyShape = part()
    ball: Spherical = part()

    def build(self) -> None:
        self.world = World()
        self.base = FixedTranslation(r=(1.0, 0.0, 0.0))
        self.joint = Revolute()
        self.link = BodyShape(m=1.0, r=(1.0, 0.0, 0.0), r_CM=(0.5, 0.0, 0.0))
        self.ball = Spherical()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a, self.base.frame_a)
        yield connect(self.joint.frame_b, self.link.frame_a)
        yield connect(self.link.frame_b, self.ball.frame_a)
        yield connect(self.ball.frame_b, self.base.frame_b)


@corpus.broken(
    "AC201",
    "joint.frame_a is not connected",
    """
error[AC201]: JointInTheAir: nothing determines joint.phi: joint.frame_a is not connected
  at      test_mechanisms.py:N
              self.joint = Revolute(phi=fixed(0.0))
                           ^^^^^^^^^^^^^^^^^^^^^^^^
          free with it: joint.w, joint.a, body.r_0[0], body.r_0[1] and 7 more
          because these do not hold it:
            joint.frame_b.t == -(((cos(joint.phi), -sin(joint.phi), 0), (sin(joint.phi), cos(joint.phi), 0), (0, 0, 1) ...   (Revolute, joints/revolute.py:N)
            joint.tau == -((0, 0, 1) @ joint.frame_b.t)   (Revolute, joints/revolute.py:N)
            joint.axis.tau == joint.tau   (Revolute, joints/revolute.py:N)
            the t of joint.frame_a is zero: not connected   (test_mechanisms.py:N)
            and 1 more equation
  cause   joint.frame_a is not connected, so it carries neither force nor torque
  help    connect joint.frame_a, for example to a World or a body
""",  # noqa: E501
)
class JointInTheAir(Component):
    """Nobody has hung the joint on anything: no World."""

    joint: Revolute = part()
    body: Body = part()

    def build(self) -> None:
        self.joint = Revolute(phi=fixed(0.0))
        self.body = Body(m=1.0, r_CM=(1.0, 0.0, 0.0))

    def equations(self) -> Equations:
        yield connect(self.joint.frame_b, self.body.frame_a)


@corpus.broken(
    "AC205",
    "speed and brake",
    """
error[AC205]: TwoDrives: speed and brake both prescribe speed.flange.phi
  at      test_mechanisms.py:N
              self.speed = rotational.Speed()
                           ^^^^^^^^^^^^^^^^^^
  at      test_mechanisms.py:N
              self.brake = rotational.Fixed()
                           ^^^^^^^^^^^^^^^^^^
          these do:
            speed.phi == speed.flange.phi   (Speed, rotational/sources.py:N)
            speed.w == der(speed.phi)   (Speed, rotational/sources.py:N)
            speed.w == speed.w_ref   (Speed, rotational/sources.py:N)
            brake.flange.phi == brake.phi0   (Fixed, rotational/components.py:N)
            constant.y == constant.k   (Constant, blocks/sources.py:N)
          together they demand 0 == 0.769231
          and leave open: speed.flange.tau and brake.flange.tau
  cause   is the angle of this flange fixed twice, by two components such as Fixed or Position?
  help    remove one of them, or put something compliant between them
""",
)
class TwoDrives(Component):
    """The axis of a joint that is driven and held."""

    world: World = part()
    joint: Revolute = part()
    body: Body = part()
    speed: rotational.Speed = part()
    brake: rotational.Fixed = part()
    constant: blocks.Constant = part()

    def build(self) -> None:
        self.world = World()
        self.joint = Revolute()
        self.body = Body(m=1.0, r_CM=(1.0, 0.0, 0.0))
        self.speed = rotational.Speed()
        self.brake = rotational.Fixed()
        self.constant = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a)
        yield connect(self.constant.y, self.speed.w_ref)
        yield connect(self.joint.axis, self.speed.flange, self.brake.flange)


@corpus.broken(
    "AC205",
    "mass",
    """
error[AC205]: BothEnds: mass prescribes a difference between mass.flange_a and mass.flange_b, which are one point
  at      test_mechanisms.py:N
              self.mass = translational.Mass(m=1.0, L=1.0)
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            mass.flange_a.s == mass.s - mass.L / 2   (Mass, translational/interfaces.py:N)
            mass.flange_b.s == mass.s + mass.L / 2   (Mass, translational/interfaces.py:N)
          together they demand 0 == 1
          and leave open: mass.flange_a.f and mass.flange_b.f
  cause   mass.flange_a and mass.flange_b are connected with each other
  help    remove that connection, or put something between them
""",
)
class BothEnds(Component):
    """A long mass whose ends are one point."""

    mass: translational.Mass = part()

    def build(self) -> None:
        self.mass = translational.Mass(m=1.0, L=1.0)

    def equations(self) -> Equations:
        yield connect(self.mass.flange_a, self.mass.flange_b)


@corpus.bad_start(
    "AC302",
    "rear.w",
    """
error[AC302]: TwoSpeedsAtTheStart: the start value rear.w = 1 contradicts the others, which make it 0
  at      test_mechanisms.py:N
              self.rear = rotational.Inertia(J=1.0, w=fixed(1.0))
                          ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          given too:
            front.w = 0   (test_mechanisms.py:N)
  cause   more is fixed at the start than the 2 states can follow: front.phi and front.w
  help    remove one of them, or make it a guess: w=guess(1)
""",
)
class TwoSpeedsAtTheStart(Component):
    """Two inertias on one shaft that start at different speeds."""

    front: rotational.Inertia = part()
    rear: rotational.Inertia = part()

    def build(self) -> None:
        self.front = rotational.Inertia(J=1.0, phi=fixed(0.0), w=fixed(0.0))
        self.rear = rotational.Inertia(J=1.0, w=fixed(1.0))

    def equations(self) -> Equations:
        yield connect(self.front.flange_b, self.rear.flange_a)


@corpus.wrong(
    "AC130",
    "Revolute",
    """
error[AC130]: Revolute: n = (0.0, 0.0, 0.0) gives no direction
  at      test_mechanisms.py:N
              Revolute(n=(0.0, 0.0, 0.0))
  help    give three numbers that are not all zero: n=(0, 0, 1)
""",
)
def axis_without_direction() -> None:
    Revolute(n=(0.0, 0.0, 0.0))


class Twig(Component):
    """One equation too few: nobody says what its resistance is."""

    p: electrical.Pin = electrical.Pin()
    n: electrical.Pin = electrical.Pin()
    v: Real = variable(unit="V")

    def equations(self) -> Equations:
        yield self.v == self.p.v - self.n.v
        yield self.p.i + self.n.i == 0


class Knot(electrical.PartialOnePort):
    """One equation too many: Ohm's law twice."""

    def equations(self) -> Equations:
        yield self.v == 1.0 * self.i
        yield self.p.v == self.n.v + 1.0 * self.p.i


class Branch(Component):
    """Something between two pins, at any depth."""

    p: electrical.Pin = electrical.Pin()
    n: electrical.Pin = electrical.Pin()
    depth: int = structural(default=0)
    leaf: Any = structural(default=Twig)
    on: Component = part()

    def build(self) -> None:
        self.on = Branch(depth=self.depth - 1, leaf=self.leaf) if self.depth else self.leaf()

    def equations(self) -> Equations:
        on: Any = self.on
        yield connect(self.p, on.p)
        yield connect(on.n, self.n)


class Tree(Component):
    """A source on three levels of components."""

    source: electrical.ConstantVoltage = part()
    stem: Branch = part()
    ground: electrical.Ground = part()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.stem.p)
        yield connect(self.source.n, self.stem.n, self.ground.p)


@corpus.broken(
    "AC201",
    "stem.on.on.on",
    """
error[AC201]: TooFewThreeDeep: stem.on.on.on states 2 equations for 3 unknowns
  at      test_mechanisms.py:N
              self.on = Branch(depth=self.depth - 1, leaf=self.leaf) if self.depth else self.leaf()
                                                                                        ^^^^^^^^^^^
  at      test_mechanisms.py:N
              def equations(self) -> Equations:
          unknowns: stem.on.on.on.v, stem.on.on.on.p.i and stem.on.on.on.n.i
          equations:
            stem.on.on.on.v == stem.on.on.on.p.v - stem.on.on.on.n.v   (Twig, test_mechanisms.py:N)
            stem.on.on.on.p.i + stem.on.on.on.n.i == 0   (Twig, test_mechanisms.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors
  help    state 1 more equation in Twig.equations
""",
)
class TooFewThreeDeep(Tree):
    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.stem = Branch(depth=2)
        self.ground = electrical.Ground()


@corpus.broken(
    "AC202",
    "stem.on.on.on",
    """
error[AC202]: TooManyThreeDeep: stem.on.on.on states 5 equations for 4 unknowns
  at      test_mechanisms.py:N
              self.on = Branch(depth=self.depth - 1, leaf=self.leaf) if self.depth else self.leaf()
                                                                                        ^^^^^^^^^^^
  at      test_mechanisms.py:N
              def equations(self) -> Equations:
          equations:
            stem.on.on.on.v == stem.on.on.on.p.v - stem.on.on.on.n.v   (Knot, electrical/interfaces.py:N)
            stem.on.on.on.p.i + stem.on.on.on.n.i == 0   (Knot, electrical/interfaces.py:N)
            stem.on.on.on.i == stem.on.on.on.p.i   (Knot, electrical/interfaces.py:N)
            stem.on.on.on.v == 1 * stem.on.on.on.i   (Knot, test_mechanisms.py:N)
            stem.on.on.on.p.v == stem.on.on.on.n.v + 1 * stem.on.on.on.p.i   (Knot, test_mechanisms.py:N)
  cause   a component needs one equation for each own variable and one for each flow of its connectors, no more
  help    remove 1 equation from Knot
""",
)
class TooManyThreeDeep(Tree):
    def build(self) -> None:
        self.source = electrical.ConstantVoltage(V=1.0)
        self.stem = Branch(depth=2, leaf=Knot)
        self.ground = electrical.Ground()


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
