"""A controller with a clock on a plant that is stiff between the ticks."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, parameter, part
from acausal.library.blocks import DiscretePID, Step
from acausal.library.rotational import Inertia, LinearSpeedDependentTorque, SpeedSensor, SpringDamper, Torque


class SampledSpeedControl(Component):
    """A PI controller sampled at 1 kHz holds the speed of a motor and a load on a stiff shaft.

    The shaft oscillates at 14 kHz, which decays within microseconds after each step of the torque: the clock, not the
    shaft, should determine the number of steps that a solver takes.
    """

    c: Real = parameter(default=1e7, unit="N.m/rad", min=0.0, doc="Stiffness of the shaft")
    d: Real = parameter(default=1e3, unit="N.m.s/rad", min=0.0, doc="Damping of the shaft")
    speed: Real = parameter(default=100.0, unit="rad/s", doc="Set speed")
    sample_period: Real = parameter(default=1e-3, unit="s", doc="Time between the ticks of the controller")
    motor: Inertia = part()
    shaft: SpringDamper = part()
    load: Inertia = part()
    drag: LinearSpeedDependentTorque = part()
    torque: Torque = part()
    sensor: SpeedSensor = part()
    set_speed: Step = part()
    controller: DiscretePID = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.3, tolerance=1e-8, output_interval=0.3e-3)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("load.w",), title="Speed"),
        Panel(("controller.y",), title="Torque of the controller in N.m"),
    )

    def build(self) -> None:
        self.motor = Inertia(J=2e-3, phi=0.0, w=0.0)
        self.load = Inertia(J=5e-3, phi=0.0, w=0.0)
        self.shaft = SpringDamper(c=self.c, d=self.d)
        self.drag = LinearSpeedDependentTorque(tau_nominal=-1.0, w_nominal=100.0)
        self.torque = Torque()
        self.sensor = SpeedSensor()
        self.set_speed = Step(height=self.speed, start_time=0.02)
        self.controller = DiscretePID(k=0.5, Ti=0.02, y_max=20.0, sample_period=self.sample_period)

    def equations(self) -> Equations:
        yield connect(self.torque.flange, self.motor.flange_a)
        yield connect(self.motor.flange_b, self.shaft.flange_a)
        yield connect(self.shaft.flange_b, self.load.flange_a)
        yield connect(self.load.flange_b, self.drag.flange, self.sensor.flange)
        yield connect(self.set_speed.y, self.controller.u_s)
        yield connect(self.sensor.w, self.controller.u_m)
        yield connect(self.controller.y, self.torque.u)
