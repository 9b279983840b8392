"""Scenes beyond the paper that only tests need: balances of the paper's scenes, sliding, a compliant machine."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Expr,
    Real,
    connect,
    dot,
    fixed,
    parameter,
    part,
    quantity,
)
from acausal.library.drilling import EnergyBalance, FullDrillingForce, Spindle, Workpiece
from acausal.library.multibody import Body, FixedRotation, Prismatic, Revolute, World, axis_rotation
from acausal.library.rotational import Fixed as FixedAngle
from acausal.library.rotational import Speed as RotationalSpeed
from acausal.library.rotational import SpringDamper as TorsionSpring
from acausal.library.translational import Fixed, Force, SpringDamper
from acausal.library.translational import Speed as TranslationalSpeed
from acausal.models.drilling_dynamic import ThickBlock
from acausal.models.drilling_kinematic import ThinPlate

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def kinetic_energy(body: Body) -> Expr:
    """Of a body whose centre of mass is the origin of its frame and whose axes are principal ones."""
    w = body.w_a
    inertia = (body.I_11 * w[0] ** 2 + body.I_22 * w[1] ** 2 + body.I_33 * w[2] ** 2) / 2
    return body.m / 2 * dot(body.v_0, body.v_0) + inertia


class BalancedThickBlock(ThickBlock):
    """The paper's dynamic scene with its energy balance."""

    balance: EnergyBalance = part()

    def build(self) -> None:
        super().build()
        self.balance = EnergyBalance(
            P_source=self.force.u * self.slide.v - self.speed.flange.tau * self.speed.w,
            P_cutting=self.drill.power_cutting,
            P_damping=self.drill.power_damping,
            E=self.drill.energy + kinetic_energy(self.body),
        )


class BalancedThinPlate(ThinPlate):
    """The paper's kinematic scene with its energy balance."""

    balance: EnergyBalance = part()

    def build(self) -> None:
        super().build()
        self.balance = EnergyBalance(
            P_source=-self.feed.flange.f * self.feed.v - self.speed.flange.tau * self.speed.w,
            P_cutting=self.drill.power_cutting,
        )


class DrivenDrill(Component):
    """A drill that is moved along its axis and turned at given rates through a plate of 20 mm, with margin friction."""

    v: Real = parameter(default=1e-3, unit="m/s")
    n: Real = parameter(default=9.28, unit="1/s")
    s_start: Real = parameter(default=-1e-3, unit="m")
    hole: Real = parameter(default=0.0, unit="m")

    world: World = World(g=0.0)
    slide: Prismatic = part()
    joint: Revolute = Revolute(n=Z, phi=fixed(0.0))
    drill: FullDrillingForce = part()
    workpiece: Workpiece = part()
    feed: TranslationalSpeed = part()
    speed: RotationalSpeed = part()

    def build(self) -> None:
        self.slide = Prismatic(n=Z, s=fixed(self.s_start))
        self.workpiece = Workpiece(t=0.02)
        self.drill = FullDrillingForce(
            t=self.workpiece.t, s_start=self.hole, k=1e8, d_c=2e4, mu_margin=0.2, line_load=1e4
        )
        self.feed = TranslationalSpeed(v_ref=self.v)
        self.speed = RotationalSpeed(w_ref=2 * math.pi * self.n)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.workpiece.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.joint.axis)


class SlidingDrill(Component):
    """A drill pressed on a plate with a force, sliding across it: friction brakes it."""

    F: Real = parameter(default=500.0, unit="N")
    n: Real = parameter(default=0.0, unit="1/s")
    v_start: Real = parameter(default=0.1, unit="m/s")
    push: Real = parameter(default=0.0, unit="N")

    world: World = part()
    across: Prismatic = part()
    slide: Prismatic = part()
    joint: Revolute = part()
    body: Body = part()
    drill: FullDrillingForce = part()
    workpiece: Workpiece = part()
    force: Force = part()
    side_force: Force = part()
    speed: RotationalSpeed = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.01, tolerance=1e-8)

    def build(self) -> None:
        self.world = World(g=0.0)
        self.across = Prismatic(n=X, s=fixed(0.0), v=fixed(self.v_start))
        # Resting on its contact from the start: F = k s.
        self.slide = Prismatic(n=Z, s=fixed(self.F / quantity(1e8, "N/m")), v=fixed(0.0))
        self.joint = Revolute(n=Z, phi=fixed(0.0))
        self.body = Body(m=5.0)
        self.workpiece = Workpiece(t=0.02)
        self.drill = FullDrillingForce(t=self.workpiece.t, k=1e8, d_c=2e4, mu_tip=0.2)
        self.force = Force(u=self.F)
        self.side_force = Force(u=self.push)
        self.speed = RotationalSpeed(w_ref=2 * math.pi * self.n)
        self.balance = EnergyBalance(
            P_source=self.force.u * self.slide.v + self.push * self.across.v - self.speed.flange.tau * self.speed.w,
            P_cutting=self.drill.power_cutting,
            P_friction=self.drill.power_friction,
            P_compliant=self.drill.power_normal,
            E_compliant=self.drill.energy,
            E=self.drill.energy + kinetic_energy(self.body),
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.across.frame_a, self.workpiece.frame_a)
        yield connect(self.across.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.side_force.flange, self.across.axis)
        yield connect(self.speed.flange, self.joint.axis)


class SoftMachine(Component):
    """A drill on a machine that yields sideways and tilts, over a plate on a spring: every option at once.

    The mounting is tilted by 5 degrees; feed force and spindle act through it. The frame of the drilling force is
    behind four joints, that of the plate behind one.
    """

    F: Real = parameter(default=1500.0, unit="N")

    world: World = World(g=0.0)
    mount: FixedRotation = FixedRotation(r=(0.0, 0.0, -0.2), R_rel=axis_rotation(Y, math.radians(5.0)))
    sideways: Prismatic = Prismatic(n=X, s=fixed(0.0), v=fixed(0.05))
    tilting: Revolute = Revolute(n=Y, phi=fixed(0.0), w=fixed(0.2))
    carriage: Body = part()
    slide: Prismatic = part()
    joint: Revolute = Revolute(n=Z, phi=fixed(0.0), w=fixed(58.0))
    body: Body = part()
    table: Prismatic = Prismatic(n=Z, s=fixed(0.0), v=fixed(0.0))
    block: Body = part()
    workpiece: Workpiece = part()
    drill: FullDrillingForce = part()
    spindle: Spindle = part()
    force: Force = part()
    wall: Fixed = Fixed()
    post: FixedAngle = FixedAngle()
    floor: Fixed = Fixed()
    side_spring: SpringDamper = part()
    tilt_spring: TorsionSpring = part()
    bed: SpringDamper = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=10.0, tolerance=1e-8)

    def build(self) -> None:
        self.carriage = Body(m=10.0, I_22=0.1)
        self.slide = Prismatic(n=Z, s=fixed(0.15), v=fixed(0.0))
        self.body = Body(m=5.0, I_11=0.02, I_22=0.02, I_33=0.001)
        self.block = Body(m=20.0)
        self.workpiece = Workpiece(t=0.01)
        self.drill = FullDrillingForce(
            t=self.workpiece.t,
            length=0.049,
            k=1e8,
            d_c=2e4,
            chisel=True,
            p_indent=2e9,
            d_indent=5e-4,
            mu_margin=0.15,
            line_load=2e4,
            mu_tip=0.2,
        )
        self.spindle = Spindle(tau_max=40.0, w_ref=58.0)
        self.force = Force(u=self.F)
        self.side_spring = SpringDamper(c=1e6, d=2e3)
        self.tilt_spring = TorsionSpring(c=1e5, d=100.0)
        self.bed = SpringDamper(c=5e6, d=5e3)
        bodies = (self.carriage, self.body, self.block)
        springs = (self.side_spring, self.tilt_spring, self.bed)
        self.balance = EnergyBalance(
            P_source=self.spindle.power + self.force.u * self.slide.v,
            P_cutting=self.drill.power_cutting,
            P_friction=self.drill.power_friction,
            P_damping=sum((s.loss_power for s in springs), self.drill.power_damping),
            E=self.drill.energy
            + self.spindle.energy
            + self.side_spring.c / 2 * self.side_spring.s_rel**2
            + self.tilt_spring.c / 2 * self.tilt_spring.phi_rel**2
            + self.bed.c / 2 * self.bed.s_rel**2
            + sum((kinetic_energy(b) for b in bodies[1:]), kinetic_energy(bodies[0])),
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.mount.frame_a, self.table.frame_a)
        yield connect(self.mount.frame_b, self.sideways.frame_a)
        yield connect(self.sideways.frame_b, self.tilting.frame_a)
        yield connect(self.tilting.frame_b, self.carriage.frame_a, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.table.frame_b, self.block.frame_a, self.workpiece.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.spindle.flange, self.joint.axis)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.wall.flange, self.side_spring.flange_a)
        yield connect(self.side_spring.flange_b, self.sideways.axis)
        yield connect(self.post.flange, self.tilt_spring.flange_a)
        yield connect(self.tilt_spring.flange_b, self.tilting.axis)
        yield connect(self.floor.flange, self.bed.flange_a)
        yield connect(self.bed.flange_b, self.table.axis)
