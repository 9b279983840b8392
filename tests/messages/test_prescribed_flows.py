"""Two components drive one flow, or one drives a flow that can go nowhere."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


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
