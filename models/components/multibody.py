"""Springs in space, loads, sensors, joints and constraints: components of `acausal.library.multibody`."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import Component, Equations, Experiment, Panel, Real, connect, fixed, guess, sin, time, variable
from acausal.library.multibody import (
    AbsoluteSensor,
    Body,
    BodyBox,
    BodyCylinder,
    CutForce,
    CutTorque,
    Damper,
    Fixed,
    FixedRotation,
    Force,
    FrameForce,
    FrameTorque,
    FreeMotion,
    GearConstraint,
    PointMass,
    Prismatic,
    PrismaticConstraint,
    RelativeSensor,
    Revolute,
    RevoluteConstraint,
    RevolutePlanarLoopConstraint,
    RollingWheel,
    Spherical,
    Spring,
    SpringDamperParallel,
    SpringWithMass,
    Torque,
    Universal,
    World,
    WorldForce,
    WorldTorque,
    axis_rotation,
)

_UPRIGHT = fixed((0.0, 0.0, 0.0, 1.0))
_NEARLY = guess((0.0, 0.0, 0.0, 1.0))
_REST = fixed((0.0, 0.0, 0.0))
_TURNING = fixed((1.0, 2.0, 3.0))


class MassesOnSprings(Component):
    """Three point masses on springs: with a damper in parallel, with internal damping, and on a heavy spring."""

    world: World = World()
    spring: Spring = Spring(c=100.0, s_unstretched=0.3)
    damper: Damper = Damper(d=1.0)
    mass1: PointMass = PointMass(m=1.0, r_0=fixed((0.1, -0.5, 0.0)), v_0=_REST)
    left: Fixed = Fixed(r=(-0.5, 0.0, 0.0))
    parallel: SpringDamperParallel = SpringDamperParallel(c=100.0, s_unstretched=0.3, d=4.0)
    mass2: PointMass = PointMass(m=1.0, r_0=fixed((-0.4, -0.5, 0.0)), v_0=_REST)
    right: Fixed = Fixed(r=(0.5, 0.0, 0.0))
    heavy: SpringWithMass = SpringWithMass(c=100.0, s_unstretched=0.3, m=0.5)
    mass3: PointMass = PointMass(m=1.0, r_0=fixed((0.6, -0.5, 0.0)), v_0=_REST)

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("mass1.r_0[1]", "mass2.r_0[1]", "mass3.r_0[1]"), title="Heights"),
        Panel(("spring.f", "parallel.f", "heavy.f"), title="Forces of the springs"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.spring.frame_a, self.damper.frame_a)
        yield connect(self.spring.frame_b, self.damper.frame_b, self.mass1.frame_a)
        yield connect(self.left.frame_b, self.parallel.frame_a)
        yield connect(self.parallel.frame_b, self.mass2.frame_a)
        yield connect(self.right.frame_b, self.heavy.frame_a)
        yield connect(self.heavy.frame_b, self.mass3.frame_a)


class TurnedByThrusters(Component):
    """A cylinder in free space under a body-fixed force and torque, and under space-fixed ones."""

    world: World = World(g=0.0)
    motion: FreeMotion = FreeMotion(r_rel_a=_REST, v_rel_a=_REST, w_rel_b=_REST, Q=_UPRIGHT)
    body: BodyCylinder = BodyCylinder(r=(0.6, 0.0, 0.0), diameter=0.1)
    thruster: FrameForce = FrameForce(force=(0.0, 5.0, 0.0))
    spin: FrameTorque = FrameTorque(torque=(0.2, 0.0, 0.0))
    tow: WorldForce = WorldForce(force=(0.0, 0.0, 4.0))
    twist: WorldTorque = WorldTorque(torque=(0.0, 0.5, 0.0))
    sensor: AbsoluteSensor = AbsoluteSensor()

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sensor.r[0]", "sensor.r[1]", "sensor.r[2]"), title="Position"),
        Panel(("sensor.w[0]", "sensor.w[1]", "sensor.w[2]"), title="Angular velocity in axes of the body"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.motion.frame_a)
        yield connect(self.motion.frame_b, self.body.frame_a)
        yield connect(self.body.frame_b, self.thruster.frame_b, self.spin.frame_b, self.tow.frame_b)
        yield connect(self.body.frame_b, self.twist.frame_b, self.sensor.frame_a)


class MeasuredPendulum(Component):
    """A pendulum on a slanted bracket, with sensors for the load of its joint and the position of its end."""

    world: World = World()
    bracket: FixedRotation = FixedRotation(r=(0.2, 0.0, 0.0), R_rel=axis_rotation((1.0, 0.0, 0.0), math.radians(20.0)))
    joint: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    force: CutForce = CutForce()
    torque: CutTorque = CutTorque()
    bar: BodyBox = BodyBox(r=(0.5, 0.0, 0.0), width=0.04, width_direction=(0.0, 1.0, 0.0))
    sensor: RelativeSensor = RelativeSensor()

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("sensor.r_rel[0]", "sensor.r_rel[1]", "sensor.r_rel[2]"), title="End of the bar, seen from the bracket"),
        Panel(("force.force[0]", "force.force[1]", "force.force[2]"), title="Force at the joint"),
        Panel(("torque.torque[0]", "torque.torque[1]"), title="Torque at the joint"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.bracket.frame_a)
        yield connect(self.bracket.frame_b, self.joint.frame_a, self.sensor.frame_a)
        yield connect(self.joint.frame_b, self.force.frame_a)
        yield connect(self.force.frame_b, self.torque.frame_a)
        yield connect(self.torque.frame_b, self.bar.frame_a)
        yield connect(self.bar.frame_b, self.sensor.frame_b)


class BallAndCardan(Component):
    """Two bars swing in space: one on a ball joint, one on a universal joint, which prevents its spin."""

    world: World = World()
    ball: Spherical = Spherical()
    bar1: Body = Body(
        m=1.0, r_CM=(0.0, -0.3, 0.0), I_11=0.02, I_22=0.01, I_33=0.02, Q=_UPRIGHT, w_a=fixed((1.0, 2.0, 3.0))
    )
    place: Fixed = Fixed(r=(1.0, 0.0, 0.0))
    cardan: Universal = Universal(
        n_a=(1.0, 0.0, 0.0), n_b=(0.0, 0.0, 1.0), phi_a=fixed(0.0), phi_b=fixed(0.0), w_a=fixed(1.0), w_b=fixed(3.0)
    )
    bar2: Body = Body(m=1.0, r_CM=(0.0, -0.3, 0.0), I_11=0.02, I_22=0.01, I_33=0.02)

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("cardan.phi_a", "cardan.phi_b"), title="Angles of the universal joint", unit="deg"),
        Panel(("bar1.w_a[1]", "bar2.w_a[1]"), title="Spin of the bars about their own axes"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.ball.frame_a)
        yield connect(self.ball.frame_b, self.bar1.frame_a)
        yield connect(self.place.frame_b, self.cardan.frame_a)
        yield connect(self.cardan.frame_b, self.bar2.frame_a)


class FourBar(Component):
    """A planar four-bar linkage of revolute joints, one of them a planar loop constraint."""

    world: World = World()
    pivot: Fixed = Fixed(r=(0.4, 0.0, 0.0))
    motor: Revolute = Revolute(phi=fixed(math.pi / 2), w=fixed(6.0))
    crank: BodyBox = BodyBox(r=(0.15, 0.0, 0.0), width=0.03, width_direction=(0.0, 1.0, 0.0))
    elbow: Revolute = Revolute(phi=guess(-1.2))
    coupler: BodyBox = BodyBox(r=(0.4, 0.0, 0.0), width=0.03, width_direction=(0.0, 1.0, 0.0))
    closing: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint()
    rocker: BodyBox = BodyBox(r=(0.3, 0.0, 0.0), width=0.03, width_direction=(0.0, 1.0, 0.0))
    bearing: Revolute = Revolute(phi=guess(1.5))

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("motor.w", "bearing.w"), title="Speeds of crank and rocker"),
        Panel(("closing.f_c[0]", "closing.f_c[1]"), title="Force in the closing joint"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.motor.frame_a)
        yield connect(self.motor.frame_b, self.crank.frame_a)
        yield connect(self.crank.frame_b, self.elbow.frame_a)
        yield connect(self.elbow.frame_b, self.coupler.frame_a)
        yield connect(self.coupler.frame_b, self.closing.frame_a)
        yield connect(self.closing.frame_b, self.rocker.frame_b)
        yield connect(self.pivot.frame_b, self.bearing.frame_a)
        yield connect(self.bearing.frame_b, self.rocker.frame_a)


class ConstrainedBodies(Component):
    """Free bodies under constraints: one on an axis, a reference with a joint instead, and one on a straight line."""

    world: World = World()
    hinge: RevoluteConstraint = RevoluteConstraint()
    held: Body = Body(
        m=1.0, r_CM=(0.3, 0.0, 0.0), I_11=0.01, I_22=0.02, I_33=0.02, r_0=guess((0.0, 0.0, 0.0)), Q=_UPRIGHT, w_a=_REST
    )
    joint: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    jointed: Body = Body(m=1.0, r_CM=(0.3, 0.0, 0.0), I_11=0.01, I_22=0.02, I_33=0.02)
    rail: Fixed = Fixed(r=(1.0, 0.0, 0.0))
    guide: PrismaticConstraint = PrismaticConstraint(locked=(True, False, True))
    sliding: Body = Body(
        m=1.0, I_11=0.01, I_22=0.02, I_33=0.02, r_0=fixed((1.0, 0.0, 0.0)), v_0=_REST, Q=guess((0, 0, 0, 1))
    )
    hanger: SpringDamperParallel = SpringDamperParallel(c=40.0, s_unstretched=0.1, d=0.5)
    above: Fixed = Fixed(r=(1.0, 0.5, 0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("held.w_a[2]", "jointed.w_a[2]"), title="Angular velocities, by the constraint and by the joint"),
        Panel(("sliding.r_0[1]",), title="Height on the rail"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.hinge.frame_a, self.joint.frame_a)
        yield connect(self.hinge.frame_b, self.held.frame_a)
        yield connect(self.joint.frame_b, self.jointed.frame_a)
        yield connect(self.rail.frame_b, self.guide.frame_a)
        yield connect(self.guide.frame_b, self.sliding.frame_a, self.hanger.frame_a)
        yield connect(self.hanger.frame_b, self.above.frame_b)

    def initial_equations(self) -> Equations:
        # The guide determines the rest of the quaternion.
        yield self.sliding.Q[3] == 1


class GearInSpace(Component):
    """Two shafts in a common bearing, geared 10 to 1; a sinusoidal torque drives the fast one."""

    world: World = World()
    gear: GearConstraint = GearConstraint(ratio=10.0, r_a=(0.0, 0.2, 0.0))
    shaft_a: BodyCylinder = BodyCylinder(r=(0.4, 0.0, 0.0), diameter=0.1)
    shaft_b: BodyCylinder = BodyCylinder(r=(0.4, 0.0, 0.0), diameter=0.2)
    drive: WorldTorque = WorldTorque(torque=(2.0 * sin(2.0 * math.pi * time), 0.0, 0.0))
    phi: Real = variable(unit="rad", default=fixed(0.0), doc="Angle of the slow shaft")
    w: Real = variable(unit="rad/s", default=fixed(0.0), doc="Speed of the slow shaft")

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("gear.revolute_a.w", "w"), title="Speeds of both shafts"),
        Panel(("gear.bearing.t[0]",), title="Torque in the bearing"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.gear.bearing)
        yield connect(self.gear.frame_a, self.shaft_a.frame_a, self.drive.frame_b)
        yield connect(self.gear.frame_b, self.shaft_b.frame_a)
        yield self.phi == self.gear.revolute_b.phi
        yield self.w == self.gear.revolute_b.w


class RollingDisk(Component):
    """A leaning disk rolls on the ground along a curve."""

    world: World = World(n=(0.0, 0.0, -1.0))
    wheel: RollingWheel = RollingWheel(radius=0.3, n=(0.0, 0.0, 1.0))
    disk: Body = Body(
        m=2.0,
        I_11=0.12,
        I_22=0.06,
        I_33=0.12,
        r_0=guess((0.2, 0.2, 0.3)),
        Q=_UPRIGHT,
        w_a=fixed((1.0, 5.0, 0.0)),
    )

    experiment: ClassVar[Experiment] = Experiment(stop_time=4.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("disk.r_0[1]",), against="disk.r_0[0]", title="Path of the centre, from above"),
        Panel(("wheel.f_n", "wheel.f_lat"), title="Forces of the ground, normal and sideways"),
    )

    def equations(self) -> Equations:
        yield connect(self.wheel.frame_a, self.disk.frame_a)

    def initial_equations(self) -> Equations:
        yield self.disk.r_0[0] == 0.2
        yield self.disk.r_0[1] == 0.2


class PushingBodies(Component):
    """Two bodies on one rail with a force and a torque between them; their total momentum stays zero."""

    world: World = World()
    rail1: Prismatic = Prismatic(s=fixed(0.0), v=fixed(0.0))
    spindle1: Revolute = Revolute(n=(1.0, 0.0, 0.0), phi=fixed(0.0), w=fixed(0.0))
    body1: Body = Body(m=1.0, I_11=0.1, I_22=0.1, I_33=0.1)
    rail2: Prismatic = Prismatic(s=fixed(1.0), v=fixed(0.0))
    spindle2: Revolute = Revolute(n=(1.0, 0.0, 0.0), phi=fixed(0.0), w=fixed(0.0))
    body2: Body = Body(m=2.0, I_11=0.2, I_22=0.2, I_33=0.2)
    push: Force = Force(force=(sin(2.0 * math.pi * time), 0.0, 0.0))
    twist: Torque = Torque(torque=(0.5, 0.0, 0.0))

    experiment: ClassVar[Experiment] = Experiment(stop_time=3.0)
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("rail1.v", "rail2.v"), title="Velocities"),
        Panel(("spindle1.w", "spindle2.w"), title="Angular velocities"),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.rail1.frame_a, self.rail2.frame_a)
        yield connect(self.rail1.frame_b, self.spindle1.frame_a)
        yield connect(self.rail2.frame_b, self.spindle2.frame_a)
        yield connect(self.spindle1.frame_b, self.body1.frame_a, self.push.frame_a, self.twist.frame_a)
        yield connect(self.spindle2.frame_b, self.body2.frame_a, self.push.frame_b, self.twist.frame_b)
