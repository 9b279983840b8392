"""Inputs that nothing drives, and inputs whose derivative would be needed."""

from __future__ import annotations

import pytest

from acausal import Component, Equations, Real, connect, part, signal_input
from acausal.library import blocks, rotational, translational
from tests.messages.cases import Case, Corpus

corpus = Corpus()


@corpus.broken(
    "AC209",
    "integrator.u",
    """
error[AC209]: OpenInput: input integrator.u is not connected
  at      test_signals.py:N
              self.integrator = blocks.Integrator()
                                ^^^^^^^^^^^^^^^^^^^
          integrator.u   Input signal   (Integrator, blocks/continuous.py:N)
  cause   an input gets its value from outside the component; nothing gives it one
  help    connect it to an output, or bind it where it is made: Integrator(u=...)
""",
)
class OpenInput(Component):
    """OpenModelica issue 12979, "Improve error message for open input connectors": integrator.y is blamed there."""

    integrator: blocks.Integrator = part()
    controller: blocks.PI = part()

    def build(self) -> None:
        self.integrator = blocks.Integrator()
        self.controller = blocks.PI(T=1.0)

    def equations(self) -> Equations:
        yield connect(self.integrator.y, self.controller.u)


@corpus.broken(
    "AC209",
    "force.u",
    """
error[AC209]: OpenForce: input force.u is not connected
  at      test_signals.py:N
              self.force = translational.Force()
                           ^^^^^^^^^^^^^^^^^^^^^
          force.u [N]   Driving force   (Force, translational/sources.py:N)
          not connected either: sum.u2
  cause   an input gets its value from outside the component; nothing gives it one
  help    connect it to an output, or bind it where it is made: Force(u=...)
""",
)
class OpenForce(Component):
    """An input with a unit, and a second one."""

    force: translational.Force = part()
    mass: translational.Mass = part()
    sum: blocks.Add = part()
    constant: blocks.Constant = part()

    def build(self) -> None:
        self.force = translational.Force()
        self.mass = translational.Mass(m=1.0)
        self.sum = blocks.Add()
        self.constant = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.force.flange, self.mass.flange_a)
        yield connect(self.constant.y, self.sum.u1)


class Servo(Component):
    """A drive inside a composite that forgets to hand its own input down."""

    w_set: Real = signal_input(unit="rad/s")
    drive: rotational.Speed = part()
    inertia: rotational.Inertia = part()

    def build(self) -> None:
        self.drive = rotational.Speed()
        self.inertia = rotational.Inertia(J=1.0)

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.inertia.flange_a)


@corpus.broken(
    "AC209",
    "axis.drive.w_ref",
    """
error[AC209]: OpenInside: input axis.drive.w_ref is not connected
  at      test_signals.py:N
              self.drive = rotational.Speed()
                           ^^^^^^^^^^^^^^^^^^
          axis.drive.w_ref [rad/s]   Angular velocity   (Speed, rotational/sources.py:N)
  cause   an input gets its value from outside the component; nothing gives it one
  help    connect it to an output, or bind it where it is made: Speed(w_ref=...)
""",
)
class OpenInside(Component):
    """The open input lies one level down."""

    axis: Servo = part()
    speed: blocks.Constant = part()

    def build(self) -> None:
        self.axis = Servo()
        self.speed = blocks.Constant(k=1.0)

    def equations(self) -> Equations:
        yield connect(self.speed.y, self.axis.w_set)


@corpus.broken(
    "AC209",
    "forces[0].u",
    """
error[AC209]: OpenInputsOfList: input forces[0].u is not connected
  at      test_signals.py:N
              self.forces = [translational.Force() for _ in range(3)]
                             ^^^^^^^^^^^^^^^^^^^^^
          forces[0].u [N]   Driving force   (Force, translational/sources.py:N)
          not connected either: forces[1].u and forces[2].u
  cause   an input gets its value from outside the component; nothing gives it one
  help    connect it to an output, or bind it where it is made: Force(u=...)
""",
)
class OpenInputsOfList(Component):
    """Three inputs of equal components: the first is named, the others are listed."""

    forces: list[translational.Force] = part()
    masses: list[translational.Mass] = part()

    def build(self) -> None:
        self.forces = [translational.Force() for _ in range(3)]
        self.masses = [translational.Mass(m=1.0) for _ in range(3)]

    def equations(self) -> Equations:
        for force, mass in zip(self.forces, self.masses, strict=True):
            yield connect(force.flange, mass.flange_a)


@corpus.broken(
    "AC207",
    "input s_set",
    """
error[AC207]: PrescribedPosition: the time derivative of input s_set is needed, which drive prescribes as a motion
  at      test_signals.py:N
              self.drive = translational.Position()
                           ^^^^^^^^^^^^^^^^^^^^^^^^
          the signal reaches: s_set and drive.s_ref
            drive.flange.s == drive.s_ref   (Position, translational/sources.py:N)
  cause   the values of an input are known only while the model runs, its derivative is not
  help    prescribe its highest derivative (Speed or Accelerate instead of Position), or filter it in the model
""",
)
class PrescribedPosition(Component):
    """A free input of the model moves a mass: its second derivative would be the acceleration."""

    s_set: Real = signal_input(unit="m")
    drive: translational.Position = part()
    mass: translational.Mass = part()

    def build(self) -> None:
        self.drive = translational.Position()
        self.mass = translational.Mass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.s_set, self.drive.s_ref)
        yield connect(self.drive.flange, self.mass.flange_a)


@pytest.mark.parametrize("case", corpus.cases, ids=str)
def test_message(case: Case) -> None:
    case.check()
