"""Masses that stop, stick, bounce and are measured: components of `acausal.library.translational`."""

from __future__ import annotations

from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, connect, fixed
from acausal.library.blocks import Pulse, Sine
from acausal.library.translational import (
    Accelerate,
    AccSensor,
    Backlash,
    BouncingMass,
    Brake,
    ConstantForce,
    Damper,
    ElastoGap,
    Fixed,
    Force,
    Force2,
    LinearSpeedDependentForce,
    Mass,
    MassWithStopAndFriction,
    PositionSensor,
    PowerSensor,
    QuadraticSpeedDependentForce,
    RelPositionSensor,
    RelSpeedSensor,
    Rod,
    SpeedSensor,
    Spring,
    SupportFriction,
)


class CoastDown(Component):
    """Two carts coast to rest: one against quadratic air drag, one against linear drag in oil."""

    in_air: Mass = Mass(m=10.0, s=fixed(0.0), v=fixed(20.0))
    air: QuadraticSpeedDependentForce = QuadraticSpeedDependentForce(f_nominal=-40.0, v_nominal=20.0)
    speed: SpeedSensor = SpeedSensor()
    position: PositionSensor = PositionSensor()
    in_oil: Mass = Mass(m=10.0, s=fixed(0.0), v=fixed(20.0))
    oil: LinearSpeedDependentForce = LinearSpeedDependentForce(f_nominal=-40.0, v_nominal=20.0)
    acceleration: AccSensor = AccSensor()

    experiment: ClassVar[Experiment] = Experiment(stop_time=20.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("speed.v", "in_oil.v"), title="Speeds in air and oil"),
        Panel(("position.s", "in_oil.s"), title="Ways in air and oil"),
        Panel(("acceleration.a",), title="Acceleration in oil"),
    )

    def equations(self) -> Equations:
        yield connect(self.in_air.flange_b, self.air.flange, self.speed.flange, self.position.flange)
        yield connect(self.in_oil.flange_b, self.oil.flange, self.acceleration.flange)


class StopsAndFriction(Component):
    """Masses pushed back and forth: one between hard stops, one in a guide with friction, one with a brake."""

    push: Sine = Sine(amplitude=25.0, f=0.5)
    force1: Force = Force()
    between_stops: MassWithStopAndFriction = MassWithStopAndFriction(
        m=1.0, L=0.2, smin=-1.0, smax=1.0, s=fixed(0.0), v=fixed(0.0)
    )
    force2: Force = Force()
    rubbing: Mass = Mass(m=5.0, s=fixed(0.0), v=fixed(0.0))
    guide: SupportFriction = SupportFriction(f_pos=((0.0, 10.0), (1.0, 12.0)), peak=1.2)
    force3: Force = Force()
    braked: Mass = Mass(m=5.0, s=fixed(0.0), v=fixed(0.0))
    brake: Brake = Brake(fn_max=100.0)
    press: Pulse = Pulse(period=2.0, start_time=0.5, width=0.5)

    experiment: ClassVar[Experiment] = Experiment(stop_time=5.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("between_stops.s", "rubbing.s", "braked.s"), title="Positions"),
        Panel(("guide.f", "brake.f"), title="Friction in guide and brake"),
    )

    def equations(self) -> Equations:
        yield connect(self.push.y, self.force1.u, self.force2.u, self.force3.u)
        yield connect(self.force1.flange, self.between_stops.flange_a)
        yield connect(self.force2.flange, self.rubbing.flange_a)
        yield connect(self.rubbing.flange_b, self.guide.flange_a)
        yield connect(self.force3.flange, self.braked.flange_a)
        yield connect(self.braked.flange_b, self.brake.flange_a)
        yield connect(self.press.y, self.brake.f_normalized)


class BufferAndPlay(Component):
    """A mass runs against a buffer; shaking ground pulls another one through a backlash."""

    thrown: Mass = Mass(m=1.0, L=0.1, s=fixed(0.0), v=fixed(1.0))
    rod: Rod = Rod(L=0.2)
    buffer: ElastoGap = ElastoGap(c=500.0, d=5.0)
    gap: RelPositionSensor = RelPositionSensor()
    wall: Fixed = Fixed(s0=0.5)
    shaking: Sine = Sine(amplitude=2.0, f=1.0)
    ground: Accelerate = Accelerate(s=fixed(0.0), v=fixed(0.0))
    play: Backlash = Backlash(c=1000.0, d=10.0, b=0.02)
    dragged: Mass = Mass(m=1.0, s=fixed(0.0), v=fixed(0.0))
    speed: RelSpeedSensor = RelSpeedSensor()

    experiment: ClassVar[Experiment] = Experiment(stop_time=2.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("gap.s_rel",), title="Way left to the wall"),
        Panel(("buffer.f", "play.f"), title="Forces of buffer and play"),
        Panel(("ground.v", "dragged.v", "speed.v_rel"), title="Speeds of ground and mass"),
    )

    def equations(self) -> Equations:
        yield connect(self.thrown.flange_b, self.rod.flange_a)
        yield connect(self.rod.flange_b, self.buffer.flange_a, self.gap.flange_a)
        yield connect(self.buffer.flange_b, self.gap.flange_b, self.wall.flange)
        yield connect(self.shaking.y, self.ground.a_ref)
        yield connect(self.ground.flange, self.play.flange_a, self.speed.flange_a)
        yield connect(self.play.flange_b, self.speed.flange_b, self.dragged.flange_a)


class BallOnFloor(Component):
    """A spring and its weight pull a mass against an obstacle, off which it bounces."""

    floor: Fixed = Fixed()
    spring: Spring = Spring(c=20.0, s_rel0=-0.2)
    weight: ConstantForce = ConstantForce(f_constant=-9.81)
    ball: BouncingMass = BouncingMass(m=1.0, e=0.7, s=fixed(0.5), v=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("ball.s",), title="Position"),
        Panel(("ball.v",), title="Speed"),
    )

    def equations(self) -> Equations:
        yield connect(self.floor.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.ball.flange_b, self.weight.flange)


class PushedApart(Component):
    """A force pushes two masses apart, a spring and a damper pull them back; a sensor measures the power."""

    push: Pulse = Pulse(period=2.0, amplitude=10.0, width=0.25)
    left: Mass = Mass(m=1.0, s=fixed(0.0), v=fixed(0.0))
    between: Force2 = Force2()
    power: PowerSensor = PowerSensor()
    spring: Spring = Spring(c=50.0, s_rel0=0.5)
    damper: Damper = Damper(d=2.0)
    right: Mass = Mass(m=2.0, s=fixed(0.5), v=fixed(0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("left.s", "right.s"), title="Positions"),
        Panel(("power.power",), title="Power into the right mass by the force"),
    )

    def equations(self) -> Equations:
        yield connect(self.push.y, self.between.u)
        yield connect(self.left.flange_b, self.between.flange_a, self.spring.flange_a, self.damper.flange_a)
        yield connect(self.between.flange_b, self.power.flange_a)
        yield connect(self.power.flange_b, self.right.flange_a, self.spring.flange_b, self.damper.flange_b)
