"""Two components drive one flow, or one drives a flow that can go nowhere."""

from __future__ import annotations

import pytest

from tests.messages.cases import Case, Corpus

corpus = Corpus()


corpus.table(
    """
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
