"""Drilling scenes that only tests need: a workpiece that gives way, a tilted drill, the paper's Figure 2."""

from __future__ import annotations

import math

from acausal import Component, Equations, Expr, Real, connect, der, fixed, guess, parameter, part, structural, variable
from acausal.library.blocks import TimeTable
from acausal.library.drilling import DrillingForce, KinematicDrillingForce, Workpiece
from acausal.library.multibody import Body, FixedRotation, Prismatic, Revolute, World, axis_rotation
from acausal.library.rotational import Speed as RotationalSpeed
from acausal.library.translational import Fixed, Force, Mass, SpringDamper
from acausal.library.translational import Speed as TranslationalSpeed
from acausal.library.translational.interfaces import PartialCompliant

Points = tuple[tuple[float, float], ...]
AXIS = (0.0, 0.0, 1.0)


class TwoBodies(Component):
    """A drill pressed against a workpiece that slides freely along the drill axis, both at rest at first."""

    force_profile: Points = structural()
    n: Real = parameter(default=9.28, unit="1/s")
    gap: Real = parameter(default=1e-3, unit="m")
    m_drill: Real = parameter(default=5.0, unit="kg")
    m_work: Real = parameter(default=20.0, unit="kg")

    world: World = World(g=0.0)
    slide: Prismatic = part()
    spindle: Revolute = Revolute(n=AXIS, phi=fixed(0.0))
    body: Body = part()
    drill: DrillingForce = part()
    table: Prismatic = Prismatic(n=AXIS, s=fixed(0.0), v=fixed(0.0))
    block: Body = part()
    workpiece: Workpiece = part()
    profile: TimeTable = part()
    force: Force = Force()
    speed: RotationalSpeed = part()

    def build(self) -> None:
        self.slide = Prismatic(n=AXIS, s=fixed(-self.gap), v=fixed(0.0))
        self.body = Body(m=self.m_drill)
        self.block = Body(m=self.m_work)
        self.workpiece = Workpiece(t=0.05)
        self.drill = DrillingForce(t=self.workpiece.t, k=1e8, d_c=2e4)
        self.profile = TimeTable(table=self.force_profile)
        self.speed = RotationalSpeed(w_ref=2 * math.pi * self.n)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.slide.frame_a, self.table.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.body.frame_a, self.drill.frame_a)
        yield connect(self.table.frame_b, self.block.frame_a, self.workpiece.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.profile.y, self.force.u)
        yield connect(self.force.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


class TiltedDrill(Component):
    """A driven drill whose axis is tilted about x against a plate that moves and turns itself.

    The tip starts at `place`, seen from the centre of the entry face; the plate moves with `v_plate` along z and the
    table under it turns with `n_plate` about z through the centre of the face.
    """

    tilt: float = structural(default=math.radians(20.0))
    place: Real = parameter(default=(0.003, -0.004, -0.001), unit="m", shape=3)
    v: Real = parameter(default=1.672e-3, unit="m/s")
    n: Real = parameter(default=9.28, unit="1/s")
    v_plate: Real = parameter(default=0.0, unit="m/s")
    n_plate: Real = parameter(default=0.0, unit="1/s")
    t: Real = parameter(default=1e-3, unit="m")

    world: World = World(g=0.0)
    mount: FixedRotation = part()
    slide: Prismatic = Prismatic(n=AXIS, s=fixed(0.0))
    spindle: Revolute = Revolute(n=AXIS, phi=fixed(0.0))
    drill: KinematicDrillingForce = part()
    lift: Prismatic = Prismatic(n=AXIS, s=fixed(0.0))
    turntable: Revolute = Revolute(n=AXIS, phi=fixed(0.0))
    workpiece: Workpiece = part()
    feed: TranslationalSpeed = part()
    speed: RotationalSpeed = part()
    lift_speed: TranslationalSpeed = part()
    turntable_speed: RotationalSpeed = part()

    def build(self) -> None:
        self.mount = FixedRotation(r=self.place, R_rel=axis_rotation((1.0, 0.0, 0.0), self.tilt))
        self.workpiece = Workpiece(t=self.t)
        self.drill = KinematicDrillingForce(t=self.workpiece.t)
        self.feed = TranslationalSpeed(v_ref=self.v)
        self.speed = RotationalSpeed(w_ref=2 * math.pi * self.n)
        self.lift_speed = TranslationalSpeed(v_ref=self.v_plate)
        self.turntable_speed = RotationalSpeed(w_ref=2 * math.pi * self.n_plate)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.mount.frame_a, self.lift.frame_a)
        yield connect(self.mount.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.lift.frame_b, self.turntable.frame_a)
        yield connect(self.turntable.frame_b, self.workpiece.frame_a)
        yield connect(self.workpiece.frame_b, self.drill.frame_w)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)
        yield connect(self.lift_speed.flange, self.lift.axis)
        yield connect(self.turntable_speed.flange, self.turntable.axis)


class CuttingDamper(PartialCompliant):
    """Damper whose force is a power of its speed: the cut at full diameter, f == f_1 (v_rel / v_1)**exponent."""

    f_1: Real = parameter(unit="N")
    v_1: Real = parameter(default=1e-3, unit="m/s")
    exponent: Real = parameter(unit="1")
    v_rel: Real = variable(unit="m/s", default=guess(1e-3), nominal=1e-3)

    def equations(self) -> Equations:
        yield self.v_rel == der(self.s_rel)
        yield self.v_rel == self.v_1 * (self.f / self.f_1) ** (1 / self.exponent)


class SeriesOfFigure2(Component):
    """Figure 2 of the paper: a mass on a spring-damper in series with the damper of the cut."""

    force_profile: Points = structural()
    m: Real = parameter(default=5.0, unit="kg")
    k: Real = parameter(default=1e8, unit="N/m")
    d_c: Real = parameter(default=2e4, unit="N.s/m")
    f_1: Real = parameter(unit="N")
    exponent: Real = parameter(unit="1")
    preload: Real = parameter(unit="N")

    profile: TimeTable = part()
    force: Force = Force()
    mass: Mass = part()
    contact: SpringDamper = part()
    cut: CuttingDamper = part()
    ground: Fixed = Fixed()

    def build(self) -> None:
        at_rest: Expr = self.preload / self.k
        self.profile = TimeTable(table=self.force_profile)
        self.mass = Mass(m=self.m, s=fixed(at_rest), v=fixed(0.0))
        self.contact = SpringDamper(c=self.k, d=self.d_c)
        self.cut = CuttingDamper(f_1=self.f_1, exponent=self.exponent, s_rel=fixed(0.0), f=guess(self.preload))

    def equations(self) -> Equations:
        yield connect(self.profile.y, self.force.u)
        yield connect(self.force.flange, self.mass.flange_a)
        yield connect(self.contact.flange_b, self.mass.flange_b)
        yield connect(self.cut.flange_b, self.contact.flange_a)
        yield connect(self.ground.flange, self.cut.flange_a)
