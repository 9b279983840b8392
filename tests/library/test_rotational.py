"""One-dimensional rotation against closed forms of mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect
from acausal.library import translational
from acausal.library.blocks import Constant, Sine
from acausal.library.rotational import (
    Accelerate,
    AccSensor,
    AngleSensor,
    ConstantTorque,
    Damper,
    Fixed,
    IdealGear,
    IdealGearR2T,
    IdealGearWithSupport,
    IdealRollingWheel,
    Inertia,
    LinearSpeedDependentTorque,
    Position,
    PowerSensor,
    QuadraticSpeedDependentTorque,
    RelAngleSensor,
    RelSpeedSensor,
    Speed,
    SpeedSensor,
    Spring,
    SpringDamper,
    Torque,
    Torque2,
    TorqueSensor,
)


class TorsionPendulum(Component):
    """Inertia on a torsion spring and a damper."""

    wall: Fixed = Fixed(phi0=0.5)
    spring: Spring = Spring(c=20.0, phi_rel0=0.25)
    damper: Damper = Damper(d=0.6)
    inertia: Inertia = Inertia(J=0.2, phi=1.0, w=0.0)

    def equations(self) -> Equations:
        yield connect(self.wall.flange, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.spring.flange_b, self.damper.flange_b, self.inertia.flange_a)


def test_damped_torsion_pendulum() -> None:
    """Around the rest angle 0.75: z = d/2J = 1.5 1/s, w = sqrt(c/J - z^2)."""
    r = acausal.simulate(TorsionPendulum(), stop_time=3.0, tolerance=1e-9)
    z, t = 1.5, r.time
    w = math.sqrt(100.0 - z * z)
    expected = 0.75 + 0.25 * np.exp(-z * t) * (np.cos(w * t) + z / w * np.sin(w * t))
    assert r["inertia.phi"] == pytest.approx(expected, abs=1e-7)


class GearTrain(Component):
    """Constant torque on a motor shaft, a gear, a load; beside it the same gear on a housing that is held."""

    torque: ConstantTorque = ConstantTorque(tau_constant=3.0)
    motor: Inertia = Inertia(J=0.1, phi=0.0, w=0.0)
    gear: IdealGear = IdealGear(ratio=-5.0)
    load: Inertia = Inertia(J=5.0)
    torque2: ConstantTorque = ConstantTorque(tau_constant=3.0)
    motor2: Inertia = Inertia(J=0.1, phi=0.4, w=0.0)
    gear2: IdealGearWithSupport = IdealGearWithSupport(ratio=-5.0)
    load2: Inertia = Inertia(J=5.0)
    held: Fixed = Fixed(phi0=0.1)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.motor.flange_a)
        yield connect(self.motor.flange_b, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.load.flange_a)
        yield connect(self.torque2.flange, self.motor2.flange_a)
        yield connect(self.motor2.flange_b, self.gear2.flange_a)
        yield connect(self.gear2.flange_b, self.load2.flange_a)
        yield connect(self.gear2.support, self.held.flange)


def test_gear_reduces_inertia_by_the_square_of_its_ratio() -> None:
    """a = tau/(J1 + J2/i^2) = 3/(0.1 + 5/25) = 10 rad/s2 on the motor; the housing takes the rest of the torque."""
    r = acausal.simulate(GearTrain(), stop_time=1.0, tolerance=1e-9)
    assert r["motor.a"] == pytest.approx(10.0, rel=1e-9)
    assert r["load.phi"] == pytest.approx(-(r.time**2), abs=1e-8)
    # torque into the gear 3 - 0.1*10 = 2 N.m, out of it 5*(-2) = -10 N.m
    assert r["gear.flange_a.tau"] == pytest.approx(2.0, rel=1e-9)
    assert r["gear.flange_b.tau"] == pytest.approx(10.0, rel=1e-9)
    assert r["gear2.support.tau"] == pytest.approx(-12.0, rel=1e-9)
    # from phi_a - phi_h = i*(phi_b - phi_h): 0.3 = -5*(phi_b - 0.1)
    assert r["load2.phi"] == pytest.approx(0.1 - 0.06 - r.time**2, abs=1e-8)


class WheelAndRack(Component):
    """A driven wheel that moves a mass, and a rack-and-pinion with the reciprocal ratio."""

    torque: Torque = Torque()
    shaft: Inertia = Inertia(J=0.5, phi=0.0, w=0.0)
    wheel: IdealRollingWheel = IdealRollingWheel(radius=0.25)
    mass: translational.Mass = translational.Mass(m=8.0)
    torque2: Torque = Torque()
    shaft2: Inertia = Inertia(J=0.5, phi=0.0, w=0.0)
    rack: IdealGearR2T = IdealGearR2T(ratio=4.0)
    mass2: translational.Mass = translational.Mass(m=8.0)
    level: Constant = Constant(k=2.0)

    def equations(self) -> Equations:
        yield connect(self.level.y, self.torque.u, self.torque2.u)
        yield connect(self.torque.flange, self.shaft.flange_a)
        yield connect(self.shaft.flange_b, self.wheel.flange_r)
        yield connect(self.wheel.flange_t, self.mass.flange_a)
        yield connect(self.torque2.flange, self.shaft2.flange_a)
        yield connect(self.shaft2.flange_b, self.rack.flange_r)
        yield connect(self.rack.flange_t, self.mass2.flange_a)


def test_wheel_and_rack() -> None:
    """J + m*r^2 = 1 kg.m2: 2 rad/s2, s = r*phi."""
    r = acausal.simulate(WheelAndRack(), stop_time=1.0, tolerance=1e-9)
    for mass, shaft in (("mass", "shaft"), ("mass2", "shaft2")):
        assert r[f"{shaft}.a"] == pytest.approx(2.0, rel=1e-9)
        assert r[f"{mass}.s"] == pytest.approx(0.25 * r.time**2, abs=1e-8)


class Turned(Component):
    """Inertias under speed-dependent torques, and two with a torque between them."""

    slowed: Inertia = Inertia(J=2.0, phi=0.0, w=-3.0)
    dragged: Inertia = Inertia(J=2.0, phi=0.0, w=-3.0)
    left: Inertia = Inertia(J=2.0, phi=0.0, w=0.0)
    right: Inertia = Inertia(J=4.0, phi=0.0, w=0.0)
    linear: LinearSpeedDependentTorque = LinearSpeedDependentTorque(tau_nominal=-8.0, w_nominal=2.0)
    quadratic: QuadraticSpeedDependentTorque = QuadraticSpeedDependentTorque(
        tau_nominal=-8.0, w_nominal=2.0, tau_direction=False
    )
    twist: Torque2 = Torque2(u=6.0)

    def equations(self) -> Equations:
        yield connect(self.linear.flange, self.slowed.flange_a)
        yield connect(self.quadratic.flange, self.dragged.flange_b)
        yield connect(self.twist.flange_a, self.left.flange_b)
        yield connect(self.twist.flange_b, self.right.flange_a)


def test_inertias_under_torques() -> None:
    """dw/dt = -(4/2) w; dw/dt = -(2/2) w|w|; action and reaction."""
    r = acausal.simulate(Turned(), stop_time=2.0, tolerance=1e-9)
    t = r.time
    assert r["slowed.w"] == pytest.approx(-3.0 * np.exp(-2.0 * t), abs=1e-7)
    assert r["dragged.w"] == pytest.approx(-3.0 / (1.0 + 3.0 * t), abs=1e-7)
    assert r["right.phi"] == pytest.approx(1.5 * t**2 / 2.0, abs=1e-7)
    assert r["left.phi"] == pytest.approx(-3.0 * t**2 / 2.0, abs=1e-7)


class Driven(Component):
    """Inertia led along a sine by Position, with sensors; a spring-damper between prescribed speeds."""

    signal: Sine = Sine(amplitude=0.1, f=1.0)
    drive: Position = Position()
    torque: TorqueSensor = TorqueSensor()
    power: PowerSensor = PowerSensor()
    inertia: Inertia = Inertia(J=2.0)
    angle: AngleSensor = AngleSensor()
    speed: SpeedSensor = SpeedSensor()
    acceleration: AccSensor = AccSensor()
    slow: Speed = Speed(w_ref=0.5, phi=1.0)
    fast: Accelerate = Accelerate(a_ref=2.0, phi=3.0, w=-1.0)
    element: SpringDamper = SpringDamper(c=3.0, d=10.0, phi_rel0=1.0)
    twist: RelAngleSensor = RelAngleSensor()
    rate: RelSpeedSensor = RelSpeedSensor()

    def equations(self) -> Equations:
        yield connect(self.signal.y, self.drive.phi_ref)
        yield connect(self.drive.flange, self.torque.flange_a)
        yield connect(self.torque.flange_b, self.power.flange_a)
        yield connect(self.power.flange_b, self.inertia.flange_a)
        yield connect(self.inertia.flange_b, self.angle.flange, self.speed.flange, self.acceleration.flange)
        yield connect(self.slow.flange, self.element.flange_a, self.twist.flange_a, self.rate.flange_a)
        yield connect(self.fast.flange, self.element.flange_b, self.twist.flange_b, self.rate.flange_b)


def test_prescribed_rotations_and_sensors() -> None:
    r = acausal.simulate(Driven(), stop_time=1.0, tolerance=1e-9)
    t, omega = r.time, 2.0 * math.pi
    phi, w, a = 0.1 * np.sin(omega * t), 0.1 * omega * np.cos(omega * t), -0.1 * omega**2 * np.sin(omega * t)
    assert r["angle.phi"] == pytest.approx(phi, abs=1e-12)
    assert r["speed.w"] == pytest.approx(w, abs=1e-12)
    assert r["acceleration.a"] == pytest.approx(a, abs=1e-11)
    assert r["torque.tau"] == pytest.approx(2.0 * a, abs=1e-11)
    assert r["power.power"] == pytest.approx(2.0 * a * w, abs=1e-11)
    twist, rate = 2.0 - 1.5 * t + t**2, 2.0 * t - 1.5
    assert r["twist.phi_rel"] == pytest.approx(twist, abs=1e-8)
    assert r["rate.w_rel"] == pytest.approx(rate, abs=1e-8)
    assert r["element.tau"] == pytest.approx(3.0 * (twist - 1.0) + 10.0 * rate, abs=1e-7)
    assert r["element.loss_power"] == pytest.approx(10.0 * rate**2, abs=1e-7)
