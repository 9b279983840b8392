"""The controller example of the Modelica Standard Library against its converged reference solution."""

from __future__ import annotations

import math
from pathlib import Path

from acausal import Component, Equations, connect, der, fixed, guess, part
from acausal.library.blocks import Integrator, LimPID, TimeTable
from acausal.library.rotational import ConstantTorque, Inertia, SpeedSensor, SpringDamper, Torque
from tests.accuracy.msl_reference import met

MOVE = math.pi / 2.0
"""Time from the start of the acceleration to that of the braking: angle pi/2 at 1 rad/s and 1 rad/s2."""


class PIDController(Component):
    """Blocks_PID_Controller: speed control of two inertias by a limited PI controller, started in steady state."""

    acceleration: TimeTable = part()
    integrator: Integrator = Integrator(y=0.0)
    PI: LimPID = LimPID(with_D=False, k=100.0, Ti=0.1, y_max=12.0, Ni=0.1, I=guess(0.0))
    torque: Torque = Torque()
    inertia1: Inertia = Inertia(J=1.0, phi=fixed(0.0))
    spring: SpringDamper = SpringDamper(c=1e4, d=100.0, w_rel=fixed(0.0))
    inertia2: Inertia = Inertia(J=2.0)
    loadTorque: ConstantTorque = ConstantTorque(tau_constant=10.0)
    speedSensor: SpeedSensor = SpeedSensor()

    def build(self) -> None:
        pulse = ((0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (1.5, 1.0), (1.5, 0.0))
        brake = tuple((t + MOVE, -a) for t, a in pulse[1:])
        self.acceleration = TimeTable(table=(*pulse, *brake, (9.0, 0.0)))

    def equations(self) -> Equations:
        yield connect(self.acceleration.y, self.integrator.u)
        yield connect(self.integrator.y, self.PI.u_s)
        yield connect(self.PI.y, self.torque.u)
        yield connect(self.torque.flange, self.inertia1.flange_a)
        yield connect(self.inertia1.flange_b, self.spring.flange_a, self.speedSensor.flange)
        yield connect(self.speedSensor.w, self.PI.u_m)
        yield connect(self.spring.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia2.flange_b, self.loadTorque.flange)

    def initial_equations(self) -> Equations:
        yield der(self.PI.I) == 0.0
        yield self.inertia1.a == 0.0
        yield der(self.spring.w_rel) == 0.0


def test_converged_solution_is_met(reference: Path) -> None:
    met(PIDController(), reference / "msl" / "Blocks_PID_Controller", renamed={"PI.I.y": "PI.I"})
