"""Two components drive one flow, or one drives a flow that can go nowhere."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import electrical, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205",
    "first and second",
    """
error[AC205]: SourcesInSeries: first and second both prescribe first.n.i
  at      test_prescribed_flows.py:N
              self.first = electrical.ConstantCurrent(I=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_flows.py:N
              self.second = electrical.ConstantCurrent(I=2.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            first.p.i + first.n.i == 0   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            first.i == first.I   (ConstantCurrent, electrical/sources.py:N)
            second.i == second.p.i   (ConstantCurrent, electrical/interfaces.py:N)
            second.i == second.I   (ConstantCurrent, electrical/sources.py:N)
            the i of first.n, second.p sum to zero   (test_prescribed_flows.py:N)
          together they demand 0 == 1
          and leave open: first.v, first.n.v, second.v and second.p.v
  cause   what flows into a junction must flow out again; sources in series leave no choice
  help    remove one of them, or connect something that takes up the difference
""",
)
class SourcesInSeries(Component):
    """Two current sources in series."""

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
    "force and spring",
    """
error[AC205]: ForceOnLooseSpring: force and spring both prescribe force.flange.f
  at      test_prescribed_flows.py:N
              self.force = translational.ConstantForce(f_constant=1.0)
                           ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  at      test_prescribed_flows.py:N
              self.spring = translational.Spring(c=1.0)
                            ^^^^^^^^^^^^^^^^^^^^^^^^^^^
          these do:
            force.flange.f == -force.f_constant   (ConstantForce, translational/sources.py:N)
            spring.flange_b.f == spring.f   (Spring, translational/interfaces.py:N)
            spring.flange_a.f == -spring.f   (Spring, translational/interfaces.py:N)
            the f of force.flange, spring.flange_b sum to zero   (test_prescribed_flows.py:N)
            the f of spring.flange_a is zero: not connected   (test_prescribed_flows.py:N)
          together they demand 0 == 1
          and leave open: force.flange.s, spring.flange_a.s and spring.flange_b.s
  cause   spring.flange_a is not connected, so the flow there is zero
  help    connect spring.flange_a
""",
)
class ForceOnLooseSpring(Component):
    """The force has to go through a spring whose other end holds on to nothing."""

    force: translational.ConstantForce = part()
    spring: translational.Spring = part()

    def build(self) -> None:
        self.force = translational.ConstantForce(f_constant=1.0)
        self.spring = translational.Spring(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.force.flange, self.spring.flange_b)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
