"""Inputs that nothing drives, and inputs whose derivative would be needed."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, connect, signal_input
from acausal.library import blocks, rotational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


class Servo(Component):
    """A drive inside a composite that forgets to hand its own input down."""

    w_set: Real = signal_input(unit="rad/s")
    drive: rotational.Speed = rotational.Speed()
    inertia: rotational.Inertia = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.inertia.flange_a)


@corpus.broken("AC209", "axis.drive.w_ref", "rotational.Speed()")
class OpenInside(Component):
    """The open input lies one level down."""

    axis: Servo = Servo()
    speed: blocks.Constant = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.speed.y, self.axis.w_set)


corpus.table(
    """
OpenInput AC209 integrator.u
# OpenModelica issue 12979, "Improve error message for open input connectors": integrator.y is blamed there.
integrator: blocks.Integrator = <<blocks.Integrator()>>
controller: blocks.PI = blocks.PI(T=1.0)
yield connect(self.integrator.y, self.controller.u)

OpenForce AC209 force.u
# An input with a unit, and a second one.
force: translational.Force = <<translational.Force()>>
mass: translational.Mass = translational.Mass(m=1.0)
sum: blocks.Add = blocks.Add()
constant: blocks.Constant = blocks.Constant(k=1.0)
yield connect(self.force.flange, self.mass.flange_a)
yield connect(self.constant.y, self.sum.u1)

PrescribedPosition AC207 input s_set
# A free input of the model moves a mass: its second derivative would be the acceleration.
s_set: Real = signal_input(unit="m")
drive: translational.Position = <<translational.Position()>>
mass: translational.Mass = translational.Mass(m=1.0)
yield connect(self.s_set, self.drive.s_ref)
yield connect(self.drive.flange, self.mass.flange_a)

OpenInputsOfList AC209 forces[0].u
# Three inputs of equal components: the first is named, the others are listed.
forces: list[translational.Force] = part()
masses: list[translational.Mass] = part()
build: self.forces = [<<translational.Force()>> for _ in range(3)]
build: self.masses = [translational.Mass(m=1.0) for _ in range(3)]
eq: for force, mass in zip(self.forces, self.masses, strict=True):
eq:     yield connect(force.flange, mass.flange_a)
""",
    globals(),
)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
