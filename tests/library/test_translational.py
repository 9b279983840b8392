"""One-dimensional translation against closed forms of mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, guess
from acausal.library.blocks import Constant, Sine
from acausal.library.translational import (
    Accelerate,
    AccSensor,
    ConstantForce,
    Damper,
    Fixed,
    Force,
    Force2,
    ForceSensor,
    LinearSpeedDependentForce,
    Mass,
    Position,
    PositionSensor,
    PowerSensor,
    QuadraticSpeedDependentForce,
    RelPositionSensor,
    RelSpeedSensor,
    Rod,
    Speed,
    SpeedSensor,
    Spring,
    SpringDamper,
)
from acausal.models.mass_chain import MassSpringDamperChain
from acausal.models.oscillator import Oscillator


def test_damped_oscillator() -> None:
    """s0*exp(-z t)*(cos w t + z/w sin w t), z = d/2m, w = sqrt(c/m - z^2)."""
    r = acausal.simulate(Oscillator(m=2.0, c=80.0, d=3.0, s0=0.2), stop_time=5.0, tolerance=1e-9)
    z = 3.0 / 4.0
    w = math.sqrt(80.0 / 2.0 - z * z)
    expected = 0.2 * np.exp(-z * r.time) * (np.cos(w * r.time) + z / w * np.sin(w * r.time))
    assert r["mass.s"] == pytest.approx(expected, abs=1e-7)
    assert r["damper.loss_power"] == pytest.approx(3.0 * r["mass.v"] ** 2, abs=1e-9)


class TwoBodies(Component):
    """Two free masses on a spring, the spring unstretched at its natural length."""

    a: Mass = Mass(m=1.0, L=0.2, s=0.0, v=0.0)
    b: Mass = Mass(m=3.0, L=0.4, s=1.3, v=0.8)
    spring: Spring = Spring(c=48.0, s_rel0=1.0)

    def equations(self) -> Equations:
        yield connect(self.a.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.b.flange_a)


def test_two_bodies_swing_with_the_reduced_mass() -> None:
    """Reduced mass 3/4 kg: w = sqrt(48/0.75) = 8 rad/s; the centre of mass moves on straight."""
    r = acausal.simulate(TwoBodies(), stop_time=3.0, tolerance=1e-9)
    t = r.time
    assert r["spring.s_rel"] == pytest.approx(1.0 + 0.1 * np.sin(8.0 * t), abs=1e-7)
    assert (r["a.s"] + 3.0 * r["b.s"]) / 4.0 == pytest.approx(0.975 + 0.6 * t, abs=1e-7)


class Pushed(Component):
    """Masses under a constant, a linear, a quadratic force, and two under a force between them."""

    falling: Mass = Mass(m=2.0, s=1.0, v=0.5)
    slowed: Mass = Mass(m=2.0, s=0.0, v=-3.0)
    dragged: Mass = Mass(m=2.0, s=0.0, v=-3.0)
    left: Mass = Mass(m=2.0, s=0.0, v=0.0)
    right: Mass = Mass(m=4.0, s=0.0, v=0.0)
    weight: ConstantForce = ConstantForce(f_constant=-19.6133)
    linear: LinearSpeedDependentForce = LinearSpeedDependentForce(f_nominal=-8.0, v_nominal=2.0)
    quadratic: QuadraticSpeedDependentForce = QuadraticSpeedDependentForce(
        f_nominal=-8.0, v_nominal=2.0, force_direction=False
    )
    push: Force2 = Force2()
    level: Constant = Constant(k=6.0)

    def equations(self) -> Equations:
        yield connect(self.weight.flange, self.falling.flange_a)
        yield connect(self.linear.flange, self.slowed.flange_a)
        yield connect(self.quadratic.flange, self.dragged.flange_b)
        yield connect(self.level.y, self.push.u)
        yield connect(self.push.flange_a, self.left.flange_b)
        yield connect(self.push.flange_b, self.right.flange_a)


def test_masses_under_forces() -> None:
    """Free fall; dv/dt = -(4/2) v; dv/dt = -(2/2) v|v|; action and reaction."""
    r = acausal.simulate(Pushed(), stop_time=2.0, tolerance=1e-9)
    t = r.time
    assert r["falling.s"] == pytest.approx(1.0 + 0.5 * t - 9.80665 / 2.0 * t**2, abs=1e-7)
    assert r["slowed.v"] == pytest.approx(-3.0 * np.exp(-2.0 * t), abs=1e-7)
    assert r["dragged.v"] == pytest.approx(-3.0 / (1.0 + 3.0 * t), abs=1e-7)
    assert r["right.s"] == pytest.approx(1.5 * t**2 / 2.0, abs=1e-7)
    assert r["left.s"] == pytest.approx(-3.0 * t**2 / 2.0, abs=1e-7)


class Driven(Component):
    """A mass led along a sine by Position; sensors on the way from the drive to the mass."""

    signal: Sine = Sine(amplitude=0.1, f=1.0)
    drive: Position = Position()
    rod: Rod = Rod(L=0.5)
    force: ForceSensor = ForceSensor()
    power: PowerSensor = PowerSensor()
    mass: Mass = Mass(m=2.0)
    position: PositionSensor = PositionSensor()
    speed: SpeedSensor = SpeedSensor()
    acceleration: AccSensor = AccSensor()

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.drive.s_ref)
        yield connect(self.drive.flange, self.rod.flange_a)
        yield connect(self.rod.flange_b, self.force.flange_a)
        yield connect(self.force.flange_b, self.power.flange_a)
        yield connect(self.power.flange_b, self.mass.flange_a)
        yield connect(self.mass.flange_b, self.position.flange, self.speed.flange, self.acceleration.flange)


def test_prescribed_motion_takes_the_force_it_needs() -> None:
    """The source is differentiated twice: no state remains, F = m*a exactly."""
    r = acausal.simulate(Driven(), stop_time=1.0, tolerance=1e-9)
    w = 2.0 * math.pi
    s, v, a = (0.1 * np.sin(w * r.time), 0.1 * w * np.cos(w * r.time), -0.1 * w**2 * np.sin(w * r.time))
    assert r["position.s"] == pytest.approx(0.5 + s, abs=1e-12)
    assert r["speed.v"] == pytest.approx(v, abs=1e-12)
    assert r["acceleration.a"] == pytest.approx(a, abs=1e-11)
    assert r["force.f"] == pytest.approx(2.0 * a, abs=1e-11)
    assert r["power.power"] == pytest.approx(2.0 * a * v, abs=1e-11)


class Moved(Component):
    """A damper between a flange of given speed and one of given acceleration, with sensors across it."""

    speed: Speed = Speed(v_ref=0.5, s=1.0)
    acceleration: Accelerate = Accelerate(a_ref=2.0, s=3.0, v=-1.0)
    damper: Damper = Damper(d=10.0)
    distance: RelPositionSensor = RelPositionSensor()
    rate: RelSpeedSensor = RelSpeedSensor()

    def equations(self) -> Equations:
        yield connect(self.speed.flange, self.damper.flange_a, self.distance.flange_a, self.rate.flange_a)
        yield connect(self.acceleration.flange, self.damper.flange_b, self.distance.flange_b, self.rate.flange_b)


def test_prescribed_speed_and_acceleration() -> None:
    r = acausal.simulate(Moved(), stop_time=2.0, tolerance=1e-9)
    t = r.time
    assert r["distance.s_rel"] == pytest.approx(2.0 - 1.5 * t + t**2, abs=1e-8)
    assert r["rate.v_rel"] == pytest.approx(2.0 * t - 1.5, abs=1e-8)
    assert r["damper.f"] == pytest.approx(10.0 * (2.0 * t - 1.5), abs=1e-7)


class Hanging(Component):
    """A spring-damper with a force on its end and no mass: first order."""

    wall: Fixed = Fixed(s0=0.2)
    element: SpringDamper = SpringDamper(c=20.0, d=4.0, s_rel0=0.5, s_rel=0.5, v_rel=guess(0.0))
    force: Force = Force(u=6.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.element.flange_a)
        yield connect(self.element.flange_b, self.force.flange)


def test_creep_of_a_massless_spring_damper() -> None:
    """d*s' + c*(s - 0.5) = 6 N from rest: 0.5 + 0.3*(1 - exp(-5 t))."""
    r = acausal.simulate(Hanging(), stop_time=1.0, tolerance=1e-9)
    assert r["element.s_rel"] == pytest.approx(0.5 + 0.3 * (1.0 - np.exp(-5.0 * r.time)), abs=1e-7)
    assert r["element.f"] == pytest.approx(6.0, abs=1e-9)
    assert r["wall.flange.f"] == pytest.approx(6.0, abs=1e-9)


def test_chain_has_the_modes_of_the_text_book() -> None:
    """Undamped modes of a chain tied at one end: w_k = 2 sqrt(c/m) sin((2k-1) pi/(2(2n+1))); Rayleigh damping d/c."""
    n, c, d = 5, 100.0, 0.4
    r = acausal.simulate(MassSpringDamperChain(n=n, c=c, d=d, s0=0.1), stop_time=4.0, tolerance=1e-9)
    k = np.arange(1, n + 1)
    angle = (2 * k - 1) * math.pi / (2 * n + 1)
    shapes = np.sin(np.outer(np.arange(1, n + 1), angle)) * (2.0 / math.sqrt(2 * n + 1))
    w = 2.0 * math.sqrt(c) * np.sin(angle / 2.0)
    z = w**2 * d / c / 2.0
    wd = np.sqrt(w**2 - z**2)
    t = r.time[:, None]
    modal = shapes[0] * 0.1 * np.exp(-z * t) * (np.cos(wd * t) + z / wd * np.sin(wd * t))
    for i in range(n):
        assert r[f"masses[{i}].s"] == pytest.approx(modal @ shapes[i], abs=1e-7)
