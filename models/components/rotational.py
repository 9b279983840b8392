"""Shafts that are braked, geared and measured: components of `acausal.library.rotational`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed
from acausal.library.blocks import Constant, Pulse, Ramp, Sine
from acausal.library.rotational import (
    Accelerate,
    AccSensor,
    AngleSensor,
    BearingFriction,
    Brake,
    ConstantTorque,
    Damper,
    EddyCurrentTorque,
    ElastoBacklash,
    Fixed,
    IdealGear,
    IdealGearR2T,
    IdealGearWithSupport,
    IdealRollingWheel,
    Inertia,
    LossyGear,
    OneWayClutch,
    Position,
    PowerSensor,
    QuadraticSpeedDependentTorque,
    RelAngleSensor,
    RelSpeedSensor,
    Spring,
    Torque,
    Torque2,
    TorqueSensor,
)
from acausal.library.thermal import HeatCapacitor
from acausal.library.translational import Mass


class BrakedShaft(Component):
    """A brake stops a shaft under constant torque twice; sensors for angle, acceleration, torque and power."""

    drive: ConstantTorque = ConstantTorque(tau_constant=2.0)
    rotor: Inertia = Inertia(J=0.1, phi=fixed(0.0), w=fixed(0.0))
    acceleration: AccSensor = AccSensor()
    torque: TorqueSensor = TorqueSensor()
    power: PowerSensor = PowerSensor()
    brake: Brake = Brake(fn_max=20.0)
    angle: AngleSensor = AngleSensor()
    press: Pulse = Pulse(period=2.0, start_time=0.5)

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("rotor.w", "angle.phi"), title="Speed and angle"),
        Panel(("torque.tau",), title="Torque between rotor and brake"),
        Panel(("power.power",), title="Power into the brake"),
    )

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.rotor.flange_a, self.acceleration.flange)
        yield connect(self.rotor.flange_b, self.torque.flange_a)
        yield connect(self.torque.flange_b, self.power.flange_a)
        yield connect(self.power.flange_b, self.brake.flange_a)
        yield connect(self.brake.flange_b, self.angle.flange)
        yield connect(self.press.y, self.brake.f_normalized)


class StickingBearing(Component):
    """A sinusoidal torque turns a shaft against bearing friction; the shaft sticks at each reversal."""

    control: Sine = Sine(amplitude=5.0, f=0.5)
    torque: Torque = Torque()
    rotor: Inertia = Inertia(J=0.2, phi=fixed(0.0), w=fixed(0.0))
    bearing: BearingFriction = BearingFriction(tau_pos=((0.0, 2.0), (10.0, 3.0)), peak=1.2)
    spring: Spring = Spring(c=1.0)
    wall: Fixed = Fixed()

    experiment: ClassVar[Experiment] = Experiment(stop_time=6.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("rotor.w",), title="Speed"),
        Panel(("control.y", "bearing.tau", "spring.tau"), title="Torques"),
    )

    def equations(self) -> Equations:
        yield connect(self.control.y, self.torque.u)
        yield connect(self.torque.flange, self.rotor.flange_a)
        yield connect(self.rotor.flange_b, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.wall.flange)


class GearTrain(Component):
    """A motor drives a lossless gear, a lossy gear, and a gear with its housing on a spring."""

    drive: ConstantTorque = ConstantTorque(tau_constant=1.0)
    motor: Inertia = Inertia(J=0.01, phi=fixed(0.0), w=fixed(0.0))
    ideal: IdealGear = IdealGear(ratio=2.0)
    lossy: LossyGear = LossyGear(ratio=3.0, lossTable=((0.0, 0.8, 0.8, 0.0, 0.0),))
    on_spring: IdealGearWithSupport = IdealGearWithSupport(ratio=2.0)
    housing: Inertia = Inertia(J=0.05, phi=fixed(0.0), w=fixed(0.0))
    spring: Spring = Spring(c=50.0)
    damper: Damper = Damper(d=0.5)
    wall: Fixed = Fixed()
    load: Inertia = Inertia(J=1.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("motor.w", "lossy.flange_a.phi"), title="Speed of the motor, angle behind the ideal gear"),
        Panel(("lossy.loss_power",), title="Losses"),
        Panel(("housing.phi",), title="Angle of the housing on its spring"),
    )

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.motor.flange_a)
        yield connect(self.motor.flange_b, self.ideal.flange_a)
        yield connect(self.ideal.flange_b, self.lossy.flange_a)
        yield connect(self.lossy.flange_b, self.on_spring.flange_a)
        yield connect(self.on_spring.flange_b, self.load.flange_a)
        yield connect(self.on_spring.support, self.housing.flange_a)
        yield connect(self.housing.flange_b, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.spring.flange_b, self.damper.flange_b, self.wall.flange)


class WheelAndRack(Component):
    """A rolling wheel and a rack and pinion pull one mass each; a fan on the shaft limits the speed."""

    drive: ConstantTorque = ConstantTorque(tau_constant=20.0)
    rotor: Inertia = Inertia(J=0.5, phi=fixed(0.0), w=fixed(0.0))
    fan: QuadraticSpeedDependentTorque = QuadraticSpeedDependentTorque(tau_nominal=-20.0, w_nominal=30.0)
    wheel: IdealRollingWheel = IdealRollingWheel(radius=0.3)
    rack: IdealGearR2T = IdealGearR2T(ratio=10.0)
    cart: Mass = Mass(m=5.0)
    slide: Mass = Mass(m=20.0)

    experiment: ClassVar[Experiment] = Experiment(stop_time=6.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("rotor.w",), title="Speed of the shaft", unit="rpm"),
        Panel(("cart.v", "slide.v"), title="Speeds of cart and slide"),
    )

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.rotor.flange_a, self.fan.flange)
        yield connect(self.rotor.flange_b, self.wheel.flange_r, self.rack.flange_r)
        yield connect(self.wheel.flange_t, self.cart.flange_a)
        yield connect(self.rack.flange_t, self.slide.flange_a)


class Freewheel(Component):
    """A sinusoidal torque drives a shaft through a freewheel, in one direction only."""

    control: Sine = Sine(amplitude=10.0, f=1.0)
    torque: Torque = Torque()
    driving: Inertia = Inertia(J=0.5, phi=fixed(0.0), w=fixed(0.0))
    clutch: OneWayClutch = OneWayClutch(fn_max=10.0, w_rel=fixed(0.0), phi_rel=fixed(0.0))
    open: Constant = Constant(k=0.0)
    driven: Inertia = Inertia(J=1.0)
    drag: Damper = Damper(d=0.5)
    wall: Fixed = Fixed()

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("driving.w", "driven.w"), title="Speeds"),
        Panel(("clutch.tau",), title="Torque of the freewheel"),
    )

    def equations(self) -> Equations:
        yield connect(self.control.y, self.torque.u)
        yield connect(self.torque.flange, self.driving.flange_a)
        yield connect(self.driving.flange_b, self.clutch.flange_a)
        yield connect(self.open.y, self.clutch.f_normalized)
        yield connect(self.clutch.flange_b, self.driven.flange_a)
        yield connect(self.driven.flange_b, self.drag.flange_a)
        yield connect(self.drag.flange_b, self.wall.flange)


class Backlash(Component):
    """A shaft with prescribed angle moves another one through a backlash of 0.1 rad."""

    angle: Sine = Sine(amplitude=0.2, f=1.0)
    prescribed: Position = Position()
    play: ElastoBacklash = ElastoBacklash(c=500.0, d=5.0, b=0.1)
    twist: RelAngleSensor = RelAngleSensor()
    load: Inertia = Inertia(J=0.05, phi=fixed(0.0), w=fixed(0.0))
    drag: Damper = Damper(d=0.2)
    wall: Fixed = Fixed()

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("prescribed.flange.phi", "load.phi"), title="Angles"),
        Panel(("twist.phi_rel",), title="Twist; the play is 0.1 rad wide"),
        Panel(("play.tau",), title="Torque"),
    )

    def equations(self) -> Equations:
        yield connect(self.angle.y, self.prescribed.phi_ref)
        yield connect(self.prescribed.flange, self.play.flange_a, self.twist.flange_a)
        yield connect(self.play.flange_b, self.twist.flange_b, self.load.flange_a)
        yield connect(self.load.flange_b, self.drag.flange_a)
        yield connect(self.drag.flange_b, self.wall.flange)


class EddyBrake(Component):
    """A spinning disk in front of a magnet, which brakes and heats it."""

    drive: ConstantTorque = ConstantTorque(tau_constant=0.5)
    disk: Inertia = Inertia(J=0.2, phi=fixed(0.0), w=fixed(50.0))
    magnet: EddyCurrentTorque = EddyCurrentTorque(tau_nominal=5.0, w_nominal=20.0, alpha20=3.9e-3)
    excitation: Ramp = Ramp(height=1.0, start_time=1.0, duration=0.5)
    metal: HeatCapacitor = HeatCapacitor(C=20.0, T=fixed(293.15))

    experiment: ClassVar[Experiment] = Experiment(stop_time=8.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("disk.w",), title="Speed"),
        Panel(("magnet.tau",), title="Torque of the magnet"),
        Panel(("metal.T",), title="Temperature of the metal", unit="degC"),
    )

    def equations(self) -> Equations:
        yield connect(self.drive.flange, self.disk.flange_a)
        yield connect(self.disk.flange_b, self.magnet.flange)
        yield connect(self.excitation.y, self.magnet.exc)
        yield connect(self.magnet.heatPort, self.metal.port)


class ReactingTorque(Component):
    """A torque between two shafts; a signal prescribes the acceleration of one of them."""

    acceleration: Sine = Sine(amplitude=10.0, f=0.5)
    prescribed: Accelerate = Accelerate(phi=fixed(0.0), w=fixed(0.0))
    push: Pulse = Pulse(period=2.0, amplitude=3.0, width=0.25)
    between: Torque2 = Torque2()
    speed: RelSpeedSensor = RelSpeedSensor()
    driven: Inertia = Inertia(J=0.5, phi=fixed(0.0), w=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("prescribed.w", "driven.w", "speed.w_rel"), title="Speeds"),
        Panel(("between.flange_b.tau",), title="Torque"),
    )

    def equations(self) -> Equations:
        yield connect(self.acceleration.y, self.prescribed.a_ref)
        yield connect(self.push.y, self.between.u)
        yield connect(self.prescribed.flange, self.between.flange_a, self.speed.flange_a)
        yield connect(self.between.flange_b, self.driven.flange_a, self.speed.flange_b)
