"""Worked examples of the Modelica Standard Library in one dimension, against their converged reference solutions.

The equations are those of Modelica 4.1.0 (Modelica Association, 3-Clause BSD).
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, guess, part
from acausal.library import electrical, rotational, translational
from acausal.library.blocks import Ramp, Sine, Step
from tests.accuracy.msl_reference import errors, met


class Oscillator(Component):
    """Translational_Oscillator: two masses in resonance, the second one damped."""

    mass1: translational.Mass = part()
    mass2: translational.Mass = part()
    spring1: translational.Spring = part()
    spring2: translational.Spring = part()
    damper1: translational.Damper = translational.Damper(d=10.0)
    fixed1: translational.Fixed = translational.Fixed(s0=1.0)
    force1: translational.Force = translational.Force()
    force2: translational.Force = translational.Force()
    sine: Sine = Sine(amplitude=1.0, f=15.9155)

    def build(self) -> None:
        self.mass1, self.mass2 = (translational.Mass(m=1.0, L=1.0, s=-0.5, v=0.0) for _ in range(2))
        self.spring1, self.spring2 = (translational.Spring(c=1e4, s_rel0=1.0) for _ in range(2))

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.force1.u, self.force2.u)
        yield connect(self.force1.flange, self.mass1.flange_a)
        yield connect(self.force2.flange, self.mass2.flange_a)
        yield connect(self.mass1.flange_b, self.spring1.flange_a)
        yield connect(self.mass2.flange_b, self.spring2.flange_a, self.damper1.flange_a)
        yield connect(self.spring1.flange_b, self.spring2.flange_b, self.damper1.flange_b, self.fixed1.flange)


class InitialConditions(Component):
    """Translational_InitialConditions: starts given on relative lengths, and an equilibrium that must stay."""

    wall_a: translational.Fixed = translational.Fixed(s0=-1.0)
    s1: translational.Spring = translational.Spring(c=1000.0, s_rel0=1.0, s_rel=fixed(0.5))
    m1: translational.Mass = translational.Mass(m=1.0, L=1.0, v=fixed(0.0))
    sd1: translational.SpringDamper = translational.SpringDamper(
        c=111.0, d=1.0, s_rel0=1.0, s_rel=fixed(1.0), v_rel=fixed(0.0)
    )
    m2: translational.Mass = translational.Mass(m=1.0, L=2.0, s=guess(0.0), v=guess(0.0))
    wall_b: translational.Fixed = translational.Fixed(s0=1.0)
    s2: translational.Spring = translational.Spring(c=1000.0, s_rel0=2.0)
    m3: translational.Mass = translational.Mass(m=1.0, L=3.0, s=fixed(4.5), v=fixed(0.0))
    sd2: translational.SpringDamper = translational.SpringDamper(c=111.0, d=1.0, s_rel0=4.0)
    m4: translational.Mass = translational.Mass(m=1.0, L=5.0, s=fixed(12.5), v=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.wall_a.flange, self.s1.flange_a)
        yield connect(self.s1.flange_b, self.m1.flange_a)
        yield connect(self.m1.flange_b, self.sd1.flange_a)
        yield connect(self.sd1.flange_b, self.m2.flange_a)
        yield connect(self.wall_b.flange, self.s2.flange_a)
        yield connect(self.s2.flange_b, self.m3.flange_a)
        yield connect(self.m3.flange_b, self.sd2.flange_a)
        yield connect(self.sd2.flange_b, self.m4.flange_a)


class First(Component):
    """Rotational_First: drive train with a rigid gear and an elastic shaft."""

    torque: rotational.Torque = rotational.Torque()
    sine: Sine = Sine(amplitude=10.0, f=5.0)
    inertia1: rotational.Inertia = rotational.Inertia(J=0.1)
    gear: rotational.IdealGear = rotational.IdealGear(ratio=10.0)
    inertia2: rotational.Inertia = rotational.Inertia(J=2.0, phi=0.0, w=0.0)
    spring: rotational.Spring = rotational.Spring(c=1e4)
    inertia3: rotational.Inertia = rotational.Inertia(J=2.0, phi=0.0, w=0.0)
    damper: rotational.Damper = rotational.Damper(d=10.0)
    ground: rotational.Fixed = rotational.Fixed()

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.torque.u)
        yield connect(self.torque.flange, self.inertia1.flange_a)
        yield connect(self.inertia1.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.inertia2.flange_a)
        yield connect(self.inertia2.flange_b, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.spring.flange_b, self.inertia3.flange_a)
        yield connect(self.damper.flange_b, self.ground.flange)


class ElasticBearing(Component):
    """Rotational_ElasticBearing: a gear whose housing hangs on a spring-damper."""

    torque: rotational.Torque = rotational.Torque()
    ramp: Ramp = Ramp(height=100.0, duration=5.0)
    shaft: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=0.0)
    gear: rotational.IdealGearWithSupport = rotational.IdealGearWithSupport(ratio=3.0)
    housing: rotational.Inertia = rotational.Inertia(J=5.0, phi=0.0, w=0.0)
    spring: rotational.Spring = rotational.Spring(c=1e3)
    load: rotational.Inertia = rotational.Inertia(J=50.0, phi=0.0, w=0.0)
    springDamper: rotational.SpringDamper = rotational.SpringDamper(c=1e5, d=5.0)
    ground: rotational.Fixed = rotational.Fixed()

    def equations(self) -> Equations:
        yield connect(self.ramp.y, self.torque.u)
        yield connect(self.torque.flange, self.shaft.flange_a)
        yield connect(self.shaft.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.load.flange_a)
        yield connect(self.gear.support, self.housing.flange_b)
        yield connect(self.housing.flange_a, self.springDamper.flange_b)
        yield connect(self.springDamper.flange_a, self.ground.flange)


class RollingWheel(Component):
    """Rotational_RollingWheel: a wheel that moves a mass against air drag."""

    torque: rotational.Torque = rotational.Torque()
    step: Step = Step(height=10.0, start_time=0.1)
    inertia: rotational.Inertia = rotational.Inertia(J=1.0, phi=0.0, w=0.0)
    wheel: rotational.IdealRollingWheel = rotational.IdealRollingWheel(radius=1.0)
    mass: translational.Mass = translational.Mass(m=1.0)
    drag: translational.QuadraticSpeedDependentForce = translational.QuadraticSpeedDependentForce(
        f_nominal=-10.0, v_nominal=5.0, force_direction=False
    )

    def equations(self) -> Equations:
        yield connect(self.step.y, self.torque.u)
        yield connect(self.torque.flange, self.inertia.flange_a)
        yield connect(self.inertia.flange_b, self.wheel.flange_r)
        yield connect(self.wheel.flange_t, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.drag.flange)


class CauerLowPassAnalog(Component):
    """Electrical_CauerLowPassAnalog: two loops of capacitors, 7 energy stores and 5 states."""

    V: electrical.StepVoltage = electrical.StepVoltage(V=1.0, start_time=1.0)
    G: electrical.Ground = electrical.Ground()
    R1: electrical.Resistor = electrical.Resistor(R=1.0)
    R2: electrical.Resistor = electrical.Resistor(R=1.0)
    C1: electrical.Capacitor = part()
    C2: electrical.Capacitor = part()
    C3: electrical.Capacitor = part()
    C4: electrical.Capacitor = part()
    C5: electrical.Capacitor = part()
    L1: electrical.Inductor = part()
    L2: electrical.Inductor = part()

    def build(self) -> None:
        l1, l2 = 1.304, 0.8586
        self.C1, self.C3, self.C5 = (electrical.Capacitor(C=c, v=0.0) for c in (1.072, 1.682, 0.7262))
        self.C2 = electrical.Capacitor(C=1.0 / (1.704992**2 * l1))
        self.C4 = electrical.Capacitor(C=1.0 / (1.179945**2 * l2))
        self.L1, self.L2 = electrical.Inductor(L=l1, i=0.0), electrical.Inductor(L=l2, i=0.0)

    def equations(self) -> Equations:
        yield connect(self.V.p, self.R1.p)
        yield connect(self.R1.n, self.C1.p, self.L1.p, self.C2.p)
        yield connect(self.L1.n, self.C2.n, self.C3.p, self.L2.p, self.C4.p)
        yield connect(self.L2.n, self.C4.n, self.C5.p, self.R2.p)
        yield connect(self.V.n, self.C1.n, self.C3.n, self.C5.n, self.R2.n, self.G.p)


EXAMPLES: dict[str, type[Component]] = {
    "Translational_Oscillator": Oscillator,
    "Translational_InitialConditions": InitialConditions,
    "Rotational_First": First,
    "Rotational_ElasticBearing": ElasticBearing,
    "Rotational_RollingWheel": RollingWheel,
    "Electrical_CauerLowPassAnalog": CauerLowPassAnalog,
}


TOLERANCE = {
    # The housing swings lightly damped, a thousandth of the range of its speed counts: idas at 1e-8 gives 2.3e-5.
    "Rotational_ElasticBearing": 1e-9,
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_converged_solution_is_met(reference: Path, name: str) -> None:
    met(EXAMPLES[name](), reference / "msl" / name, tolerance=TOLERANCE.get(name, 1e-8))


@pytest.mark.parametrize("solver", ["cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("name", ["Translational_InitialConditions", "Electrical_CauerLowPassAnalog"])
def test_other_solvers_meet_it_too(reference: Path, name: str, solver: str) -> None:
    met(EXAMPLES[name](), reference / "msl" / name, solver=solver)


@pytest.mark.parametrize("name", ["Translational_Oscillator", "Electrical_CauerLowPassAnalog"])
def test_the_error_follows_the_tolerance(reference: Path, name: str) -> None:
    model, worst = acausal.compile(EXAMPLES[name]()), []
    for tolerance in (1e-4, 1e-6, 1e-8):
        # with idas: at its outputs the default is as exact as the data at all of these tolerances
        found = errors(model, reference / "msl" / name, tolerance=tolerance, solver="idas")[1]
        worst.append(max(found.values()))
    assert worst == sorted(worst, reverse=True)
    assert math.log10(worst[0] / worst[-1]) > 2.0, worst
