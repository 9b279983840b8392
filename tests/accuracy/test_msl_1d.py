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
from tests.accuracy.msl_reference import error_of, read_example


class Oscillator(Component):
    """Translational_Oscillator: two masses in resonance, the second one damped."""

    mass1: translational.Mass = part()
    mass2: translational.Mass = part()
    spring1: translational.Spring = part()
    spring2: translational.Spring = part()
    damper1: translational.Damper = part()
    fixed1: translational.Fixed = part()
    force1: translational.Force = part()
    force2: translational.Force = part()
    sine: Sine = part()

    def build(self) -> None:
        self.mass1, self.mass2 = (translational.Mass(m=1.0, L=1.0, s=-0.5, v=0.0) for _ in range(2))
        self.spring1, self.spring2 = (translational.Spring(c=1e4, s_rel0=1.0) for _ in range(2))
        self.damper1 = translational.Damper(d=10.0)
        self.fixed1 = translational.Fixed(s0=1.0)
        self.force1, self.force2 = translational.Force(), translational.Force()
        self.sine = Sine(amplitude=1.0, f=15.9155)

    def equations(self) -> Equations:
        yield connect(self.sine.y, self.force1.u, self.force2.u)
        yield connect(self.force1.flange, self.mass1.flange_a)
        yield connect(self.force2.flange, self.mass2.flange_a)
        yield connect(self.mass1.flange_b, self.spring1.flange_a)
        yield connect(self.mass2.flange_b, self.spring2.flange_a, self.damper1.flange_a)
        yield connect(self.spring1.flange_b, self.spring2.flange_b, self.damper1.flange_b, self.fixed1.flange)


class InitialConditions(Component):
    """Translational_InitialConditions: starts given on relative lengths, and an equilibrium that must stay."""

    wall_a: translational.Fixed = part()
    s1: translational.Spring = part()
    m1: translational.Mass = part()
    sd1: translational.SpringDamper = part()
    m2: translational.Mass = part()
    wall_b: translational.Fixed = part()
    s2: translational.Spring = part()
    m3: translational.Mass = part()
    sd2: translational.SpringDamper = part()
    m4: translational.Mass = part()

    def build(self) -> None:
        self.wall_a = translational.Fixed(s0=-1.0)
        self.s1 = translational.Spring(c=1000.0, s_rel0=1.0, s_rel=fixed(0.5))
        self.m1 = translational.Mass(m=1.0, L=1.0, v=fixed(0.0))
        self.sd1 = translational.SpringDamper(c=111.0, d=1.0, s_rel0=1.0, s_rel=fixed(1.0), v_rel=fixed(0.0))
        self.m2 = translational.Mass(m=1.0, L=2.0, s=guess(0.0), v=guess(0.0))
        self.wall_b = translational.Fixed(s0=1.0)
        self.s2 = translational.Spring(c=1000.0, s_rel0=2.0)
        self.m3 = translational.Mass(m=1.0, L=3.0, s=fixed(4.5), v=fixed(0.0))
        self.sd2 = translational.SpringDamper(c=111.0, d=1.0, s_rel0=4.0)
        self.m4 = translational.Mass(m=1.0, L=5.0, s=fixed(12.5), v=fixed(0.0))

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

    torque: rotational.Torque = part()
    sine: Sine = part()
    inertia1: rotational.Inertia = part()
    gear: rotational.IdealGear = part()
    inertia2: rotational.Inertia = part()
    spring: rotational.Spring = part()
    inertia3: rotational.Inertia = part()
    damper: rotational.Damper = part()
    ground: rotational.Fixed = part()

    def build(self) -> None:
        self.torque = rotational.Torque()
        self.sine = Sine(amplitude=10.0, f=5.0)
        self.inertia1 = rotational.Inertia(J=0.1)
        self.gear = rotational.IdealGear(ratio=10.0)
        self.inertia2 = rotational.Inertia(J=2.0, phi=0.0, w=0.0)
        self.spring = rotational.Spring(c=1e4)
        self.inertia3 = rotational.Inertia(J=2.0, phi=0.0, w=0.0)
        self.damper = rotational.Damper(d=10.0)
        self.ground = rotational.Fixed()

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

    torque: rotational.Torque = part()
    ramp: Ramp = part()
    shaft: rotational.Inertia = part()
    gear: rotational.IdealGearWithSupport = part()
    housing: rotational.Inertia = part()
    spring: rotational.Spring = part()
    load: rotational.Inertia = part()
    springDamper: rotational.SpringDamper = part()
    ground: rotational.Fixed = part()

    def build(self) -> None:
        self.torque = rotational.Torque()
        self.ramp = Ramp(height=100.0, duration=5.0)
        self.shaft = rotational.Inertia(J=1.0, phi=0.0, w=0.0)
        self.gear = rotational.IdealGearWithSupport(ratio=3.0)
        self.housing = rotational.Inertia(J=5.0, phi=0.0, w=0.0)
        self.spring = rotational.Spring(c=1e3)
        self.load = rotational.Inertia(J=50.0, phi=0.0, w=0.0)
        self.springDamper = rotational.SpringDamper(c=1e5, d=5.0)
        self.ground = rotational.Fixed()

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

    torque: rotational.Torque = part()
    step: Step = part()
    inertia: rotational.Inertia = part()
    wheel: rotational.IdealRollingWheel = part()
    mass: translational.Mass = part()
    drag: translational.QuadraticSpeedDependentForce = part()

    def build(self) -> None:
        self.torque = rotational.Torque()
        self.step = Step(height=10.0, start_time=0.1)
        self.inertia = rotational.Inertia(J=1.0, phi=0.0, w=0.0)
        self.wheel = rotational.IdealRollingWheel(radius=1.0)
        self.mass = translational.Mass(m=1.0)
        self.drag = translational.QuadraticSpeedDependentForce(f_nominal=-10.0, v_nominal=5.0, force_direction=False)

    def equations(self) -> Equations:
        yield connect(self.step.y, self.torque.u)
        yield connect(self.torque.flange, self.inertia.flange_a)
        yield connect(self.inertia.flange_b, self.wheel.flange_r)
        yield connect(self.wheel.flange_t, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.drag.flange)


class CauerLowPassAnalog(Component):
    """Electrical_CauerLowPassAnalog: two loops of capacitors, 7 energy stores and 5 states."""

    V: electrical.StepVoltage = part()
    G: electrical.Ground = part()
    R1: electrical.Resistor = part()
    R2: electrical.Resistor = part()
    C1: electrical.Capacitor = part()
    C2: electrical.Capacitor = part()
    C3: electrical.Capacitor = part()
    C4: electrical.Capacitor = part()
    C5: electrical.Capacitor = part()
    L1: electrical.Inductor = part()
    L2: electrical.Inductor = part()

    def build(self) -> None:
        l1, l2 = 1.304, 0.8586
        self.V = electrical.StepVoltage(V=1.0, start_time=1.0)
        self.G = electrical.Ground()
        self.R1, self.R2 = electrical.Resistor(R=1.0), electrical.Resistor(R=1.0)
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
    example = read_example(reference / "msl" / name)
    r = acausal.simulate(
        EXAMPLES[name](),
        stop_time=example.stop_time,
        tolerance=TOLERANCE.get(name, 1e-8),
        output_interval=example.interval,
    )
    errors = error_of(r, example)
    assert max(errors.values()) <= 1e-5, errors


@pytest.mark.parametrize("solver", ["cvodes", "rosenbrock", "erk"])
@pytest.mark.parametrize("name", ["Translational_InitialConditions", "Electrical_CauerLowPassAnalog"])
def test_other_solvers_meet_it_too(reference: Path, name: str, solver: str) -> None:
    example = read_example(reference / "msl" / name)
    r = acausal.simulate(
        EXAMPLES[name](),
        stop_time=example.stop_time,
        tolerance=1e-8,
        output_interval=example.interval,
        solver=solver,
    )
    errors = error_of(r, example)
    assert max(errors.values()) <= 1e-5, errors


@pytest.mark.parametrize("name", ["Translational_Oscillator", "Electrical_CauerLowPassAnalog"])
def test_the_error_follows_the_tolerance(reference: Path, name: str) -> None:
    example = read_example(reference / "msl" / name)
    model = acausal.compile(EXAMPLES[name]())
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        # with idas: at its outputs the default is as exact as the data at all of these tolerances
        r = acausal.simulate(
            model, stop_time=example.stop_time, tolerance=tolerance, output_interval=example.interval, solver="idas"
        )
        errors.append(max(error_of(r, example).values()))
    assert errors == sorted(errors, reverse=True)
    assert math.log10(errors[0] / errors[-1]) > 2.0, errors
