"""Scenes of bodies that touch: a stack of boxes, drilling through stacked plates, holes side by side."""

from __future__ import annotations

import math
from typing import ClassVar

from acausal import (
    Component,
    Equations,
    Experiment,
    Expr,
    Panel,
    Real,
    connect,
    fixed,
    parameter,
    part,
    quantity,
    structural,
)
from acausal.library.blocks import TimeTable
from acausal.library.contact import Box, ContactBody, ContactScene, Coulomb, HalfSpace, HuntCrossley, Surfaces
from acausal.library.drilling import DrillBody, EnergyBalance, WorkpieceBody
from acausal.library.multibody import Body, Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import ConstantForce, Position, SpringDamper

DOWN = (0.0, 0.0, -1.0)
UP = (0.0, 0.0, 1.0)


class BoxStack(Component):
    """A stack of slightly rotated and shifted boxes, released 1 mm above one another.

    The scene finds the contacts by itself. The boxes settle within half a second and stay in place.
    """

    n: int = structural(default=5, doc="Number of boxes")
    m: Real = parameter(default=1.0, unit="kg", doc="Mass of a box of 0.1 m")

    world: World = part()
    boxes: list[Body] = part()
    scene: ContactScene = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=0.6, tolerance=1e-6, solver="cvodes")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("boxes[0].r_0[2]", "boxes[2].r_0[2]", "boxes[4].r_0[2]"), title="Height of three boxes", unit="mm"),
        Panel(
            ("scene.contacts[ground,box0].F_N", "scene.contacts[box1,box2].F_N", "scene.contacts[box3,box4].F_N"),
            title="Normal force",
            unit="N",
        ),
        Panel(
            ("balance.W_source", "balance.W_damping", "balance.W_friction"),
            title="Work of gravity, and where it goes",
            unit="mJ",
        ),
    )

    def build(self) -> None:
        size, gap = 0.1, 1e-3
        inertia = self.m * quantity(size**2 / 6, "m2")
        self.world = World(n=DOWN)
        self.boxes = [
            Body(
                m=self.m,
                I_11=inertia,
                I_22=inertia,
                I_33=inertia,
                r_0=fixed((2e-3 * (k % 2), 0.0, size / 2 + k * size + (k + 1) * gap)),
                v_0=fixed((0.0, 0.0, 0.0)),
                Q=fixed((0.0, 0.0, math.sin(0.05 * k), math.cos(0.05 * k))),
                w_a=fixed((0.0, 0.0, 0.0)),
            )
            for k in range(self.n)
        ]
        ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
        boxes = [ContactBody(name=f"box{k}", shape=Box((size, size, size))) for k in range(self.n)]
        surfaces = Surfaces(law=HuntCrossley(k=1e5, n=1.0, e=0.5, v_0=0.01), friction=Coulomb(mu=0.5))
        self.scene = ContactScene(bodies=(ground, *boxes), surfaces=surfaces, keep=2, skin=0.02)
        moving = [b.v_0 @ b.v_0 + b.w_a @ b.w_a * inertia / self.m for b in self.boxes]
        self.balance = EnergyBalance(
            P_source=self.m * _total([self.world.g_0 @ b.v_0 for b in self.boxes]),
            P_cutting=0.0,
            P_friction=self.scene.power_friction,
            P_compliant=self.scene.power_normal,
            E_compliant=self.scene.energy,
            E=self.m / 2 * _total(moving) + self.scene.energy,
        )

    def equations(self) -> Equations:
        for k, box in enumerate(self.boxes):
            yield connect(box.frame_a, self.scene.frame(f"box{k}"))


def _total(terms: list[Expr]) -> Expr:
    return sum(terms[1:], terms[0])


class StackedPlates(Component):
    """A drill goes through two plates with a gap between them, the lower one on a spring.

    The feed is a constant force against a damper, which limits the surge when the drill breaks through. All work of the
    sources is spent on cutting, damped or stored; `balance.residual` checks this. The bench is part of the scene, but
    out of reach.
    """

    F: Real = parameter(default=1500.0, unit="N", doc="Feed force")
    c: Real = parameter(default=2e6, unit="N/m", doc="Stiffness of the spring below the lower plate")

    world: World = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: Body = part()
    guide: Prismatic = part()
    plate: Body = part()
    scene: ContactScene = part()
    force: ConstantForce = part()
    cap: SpringDamper = part()
    speed: Speed = part()
    spring: SpringDamper = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=35.2, tolerance=1e-8, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("scene.contacts[0].s", "scene.contacts[1].s"), title="Depth behind the two entry faces", unit="mm"),
        Panel(("scene.contacts[0].thrust", "scene.contacts[1].thrust"), title="Thrust", unit="N"),
        Panel(("scene.contacts[0].torque", "scene.contacts[1].torque"), title="Torque", unit="N.m"),
        Panel(("guide.s",), title="Lower plate on its spring", unit="mm"),
        Panel(
            ("balance.W_source", "balance.W_cutting", "balance.W_damping"),
            title="Work: what the sources give, and where it goes",
            unit="J",
        ),
    )

    def build(self) -> None:
        first, gap, second = 0.006, 0.004, 0.008
        self.world = World(g=0.0)
        self.slide = Prismatic(n=UP, s=fixed(-1e-3), v=fixed(0.0))
        self.spindle = Revolute(n=UP, phi=fixed(0.0))
        self.drill = Body(m=5.0)
        self.guide = Prismatic(n=UP, s=fixed(0.0), v=fixed(0.0))
        self.plate = Body(m=2.0)
        self.scene = ContactScene(
            bodies=(
                DrillBody(name="drill", wanders=False, reach=((0.0, 0.0, -0.01), (0.0, 0.0, 0.05))),
                WorkpieceBody(
                    name="upper",
                    shape=Box((0.1, 0.1, first)),
                    pose=((0.0, 0.0, first / 2), IDENTITY),
                    at_rest=True,
                    group="fixture",
                ),
                WorkpieceBody(
                    name="lower",
                    shape=Box((0.1, 0.1, second)),
                    pose=((0.0, 0.0, first + gap + second / 2), IDENTITY),
                    reach=((0.0, 0.0, -2e-3), (0.0, 0.0, 2e-3)),
                    group="fixture",
                ),
                ContactBody(name="bench", shape=Box((0.3, 0.3, 0.02)), pose=((0.0, 0.0, 0.2), IDENTITY), at_rest=True),
            )
        )
        self.force = ConstantForce(f_constant=self.F)
        self.cap = SpringDamper(c=0.0, d=1e5)
        self.speed = Speed(w_ref=2 * math.pi * 9.28)
        self.spring = SpringDamper(c=self.c, d=2e3)
        self.balance = EnergyBalance(
            P_source=self.F * self.slide.v + self.spindle.tau * self.spindle.w,
            P_cutting=self.scene.power_cutting,
            P_damping=self.scene.power_damping + self.cap.d * self.slide.v**2 + self.spring.d * self.guide.v**2,
            E=self.scene.energy
            + self.drill.m / 2 * self.slide.v**2
            + self.plate.m / 2 * self.guide.v**2
            + self.c / 2 * self.guide.s**2,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.guide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.guide.frame_b, self.plate.frame_a)
        yield connect(self.drill.frame_a, self.scene.frame("drill"))
        yield connect(self.plate.frame_a, self.scene.frame("lower"))
        yield connect(self.force.flange, self.slide.axis, self.cap.flange_b)
        yield connect(self.slide.support, self.cap.flange_a)
        yield connect(self.speed.flange, self.spindle.axis)
        yield connect(self.spring.flange_a, self.guide.support)
        yield connect(self.spring.flange_b, self.guide.axis)


class HolesSideBySide(Component):
    """A drill on a gantry drills a hole, a second one beside it, and then deepens the first.

    The motion is prescribed, and the force follows. The scene finds the plate that is drilled, and where: of the `n`
    plates, only those near the drill are in the equations. The balance leaves out the kinetic energy, which the drives
    exchange in impulses where the prescribed motion has a corner.
    """

    n: int = structural(default=100, doc="Number of plates in a row")
    out: float = structural(default=-4e-3, doc="Depth of the tip above the plates [m]; negative: in the air")

    world: World = part()
    beam: Prismatic = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: Body = part()
    scene: ContactScene = part()
    across: TimeTable = part()
    down: TimeTable = part()
    beam_drive: Position = part()
    feed_drive: Position = part()
    speed: Speed = part()
    balance: EnergyBalance = part()

    experiment: ClassVar[Experiment] = Experiment(stop_time=15.0, tolerance=1e-7, solver="rosenbrock")
    figure: ClassVar[tuple[Panel, ...]] = (
        Panel(("slide.s", "beam.s"), title="Position of the tip", unit="mm"),
        Panel(
            ("scene.contacts[drill,plate0].s_tar", "scene.contacts[drill,plate0#1].s_tar"),
            title="Depth of the two holes",
            unit="mm",
        ),
        Panel(
            ("scene.contacts[drill,plate0].thrust", "scene.contacts[drill,plate0#1].thrust"), title="Thrust", unit="N"
        ),
    )

    def build(self) -> None:
        out, shallow, deep, aside = self.out, 3e-3, 6e-3, 0.02
        depths = ((0, out), (1, out), (4, shallow), (5, out), (6, out), (9, shallow), (10, out), (11, out))
        self.down = TimeTable(table=tuple((float(t), s) for t, s in (*depths, (14, deep), (15, out))))
        places = ((0, 0.0), (5, 0.0), (6, aside), (10, aside), (11, 0.0), (15, 0.0))
        self.across = TimeTable(table=tuple((float(t), s) for t, s in places))
        self.world = World(g=0.0)
        self.beam = Prismatic(n=(1.0, 0.0, 0.0))
        self.slide = Prismatic(n=UP)
        self.spindle = Revolute(n=UP, phi=fixed(0.0))
        self.drill = Body(m=5.0)
        self.beam_drive, self.feed_drive = Position(), Position()
        self.speed = Speed(w_ref=2 * math.pi * 9.28)
        plates = (
            WorkpieceBody(
                name=f"plate{k}", shape=Box((0.1, 0.1, 0.05)), pose=((0.12 * k, 0.0, 0.025), IDENTITY), at_rest=True
            )
            for k in range(self.n)
        )
        self.scene = ContactScene(bodies=(DrillBody(name="drill"), *plates))

        drives = self.beam.f * self.beam.v + self.slide.f * self.slide.v
        self.balance = EnergyBalance(
            P_source=drives + self.spindle.tau * self.spindle.w,
            P_cutting=self.scene.power_cutting,
            P_friction=self.scene.power_friction,
            P_damping=self.scene.power_damping,
            E=self.scene.energy,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.beam.frame_a)
        yield connect(self.beam.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.drill.frame_a, self.scene.frame("drill"))
        yield connect(self.across.y, self.beam_drive.s_ref)
        yield connect(self.down.y, self.feed_drive.s_ref)
        yield connect(self.beam_drive.flange, self.beam.axis)
        yield connect(self.feed_drive.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)
