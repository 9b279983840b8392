"""Compliant one-sided contacts of the Modelica Standard Library against their converged reference solutions.

Every contact begins and ends with an event: 6 of them in the gap, 53 in the backlash as published.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from acausal import Component, Equations, connect, part
from acausal.library import rotational, translational
from tests.accuracy.msl_reference import met


class ElastoGapExample(Component):
    """Translational_ElastoGap: two masses between walls, one on spring-dampers, one between gaps."""

    fixed1: translational.Fixed = translational.Fixed(s0=-2.0)
    fixed2: translational.Fixed = translational.Fixed(s0=2.0)
    mass1: translational.Mass = part()
    mass2: translational.Mass = part()
    springDamper1: translational.SpringDamper = part()
    springDamper2: translational.SpringDamper = part()
    elastoGap1: translational.ElastoGap = part()
    elastoGap2: translational.ElastoGap = part()

    def build(self) -> None:
        self.mass1, self.mass2 = (translational.Mass(m=1.0, s=2.0, v=0.0) for _ in range(2))
        self.springDamper1, self.springDamper2 = (
            translational.SpringDamper(c=10.0, d=1.5, s_rel0=1.0) for _ in range(2)
        )
        self.elastoGap1, self.elastoGap2 = (translational.ElastoGap(c=10.0, d=1.5, s_rel0=1.5) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(self.fixed1.flange, self.springDamper1.flange_a, self.elastoGap1.flange_a)
        yield connect(self.springDamper1.flange_b, self.mass1.flange_a)
        yield connect(self.mass1.flange_b, self.springDamper2.flange_a)
        yield connect(self.elastoGap1.flange_b, self.mass2.flange_a)
        yield connect(self.mass2.flange_b, self.elastoGap2.flange_a)
        yield connect(self.springDamper2.flange_b, self.elastoGap2.flange_b, self.fixed2.flange)


class Backlash(Component):
    """Rotational_Backlash: an inertia on a spring-damper, and one on a spring-damper with play."""

    fixed1: rotational.Fixed = rotational.Fixed()
    springDamper: rotational.SpringDamper = rotational.SpringDamper(c=2e4, d=50.0)
    inertia1: rotational.Inertia = part()
    elastoBacklash: rotational.ElastoBacklash = rotational.ElastoBacklash(c=2e4, d=50.0, b=math.pi / 4.0)
    inertia2: rotational.Inertia = part()

    def build(self) -> None:
        self.inertia1, self.inertia2 = (rotational.Inertia(J=5.0, phi=math.pi / 2.0, w=0.0) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(self.fixed1.flange, self.springDamper.flange_a, self.elastoBacklash.flange_a)
        yield connect(self.springDamper.flange_b, self.inertia1.flange_a)
        yield connect(self.elastoBacklash.flange_b, self.inertia2.flange_a)


EXAMPLES: dict[str, type[Component]] = {"Translational_ElastoGap": ElastoGapExample, "Rotational_Backlash": Backlash}


@pytest.mark.parametrize("name", EXAMPLES)
def test_converged_solution_is_met(reference: Path, name: str) -> None:
    met(EXAMPLES[name](), reference / "msl" / name)
