"""Two components drive one flow, or one drives a flow that can go nowhere."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, connect
from acausal.library import translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC205", "force and spring", "translational.ConstantForce(f_constant=1.0)", "translational.Spring(c=1.0)"
)
class ForceOnLooseSpring(Component):
    """The force has to go through a spring whose other end holds on to nothing."""

    force: translational.ConstantForce = translational.ConstantForce(f_constant=1.0)
    spring: translational.Spring = translational.Spring(c=1.0)

    def equations(self) -> Equations:
        yield connect(self.force.flange, self.spring.flange_b)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
