"""Small models, one for each feature; their solutions stand in `features.py`."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import casadi as ca

from acausal import (
    Component,
    Equations,
    Experiment,
    External,
    Real,
    assert_,
    boolean,
    connect,
    delay,
    der,
    discrete,
    fabs,
    fixed,
    guess,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    sign,
    signal_input,
    structural,
    time,
    variable,
    when,
    where,
)
from acausal.library.blocks import TimeTable
from acausal.library.contact import ContactBody, ContactScene, HalfSpace, HuntCrossley, Sphere, Surfaces
from acausal.library.electrical import Capacitor, ConstantVoltage, Ground, IdealDiode, Resistor, SineVoltage
from acausal.library.multibody import (
    Body,
    BodyShape,
    Fixed,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
    WorldForce,
)
from acausal.library.translational import Mass, SupportFriction
from acausal.models.drilling_kinematic import ThinPlate


class Smooth(Component):
    """x'' = -k x."""

    k: Real = parameter(default=4.0)
    x: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.v
        yield der(self.v) == -self.k * self.x


class Algebraic(Component):
    """x' = -a z with z + 0.1 z^3 = x: a nonlinear algebraic equation."""

    a: Real = parameter(default=1.5)
    x: Real = variable()
    z: Real = variable(default=fixed(1.2))

    def equations(self) -> Equations:
        yield der(self.x) == -self.a * self.z
        yield self.z + 0.1 * self.z**3 == self.x


class Pendulum(Component):
    """A point mass on a rod of length 1 in x and y: an equation of index 3."""

    g: Real = parameter(default=9.81)
    x: Real = variable(default=fixed(math.sin(1.0)))
    y: Real = variable(default=guess(-math.cos(1.0)))
    vx: Real = variable(default=fixed(0.0))
    vy: Real = variable()
    lam: Real = variable()

    def equations(self) -> Equations:
        yield der(self.x) == self.vx
        yield der(self.y) == self.vy
        yield der(self.vx) == -self.lam * self.x
        yield der(self.vy) == -self.lam * self.y - self.g
        yield self.x**2 + self.y**2 == 1.0


CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.9, 0.8, 1.0
MASSES = {"crank": (2.0, 0.05), "coupler": (1.0, 0.07), "rocker": (1.5, 0.08)}
"""Mass [kg] at the middle of each link, and inertia [kg.m2] about it."""


def _link(name: str, length: float) -> BodyShape:
    m, inertia = MASSES[name]
    half = (length / 2, 0.0, 0.0)
    return BodyShape(r=(length, 0.0, 0.0), r_CM=half, m=m, I_11=inertia, I_22=inertia, I_33=inertia)


class FourBar(Component):
    """A planar crank-rocker that turns freely, without gravity, from the crank angle `phi0`."""

    phi0: Real = parameter(default=0.5)
    w0: Real = parameter(default=4.0)
    coupler0: float = structural(default=0.0)
    rocker0: float = structural(default=1.0)
    world: World = World(g=0.0)
    pivot: Fixed = Fixed(r=(GROUND, 0.0, 0.0))
    j1: Revolute = part()
    j2: Revolute = part()
    j3: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint(n=(0.0, 0.0, 1.0))
    j4: Revolute = part()
    crank: BodyShape = _link("crank", CRANK)
    coupler: BodyShape = _link("coupler", COUPLER)
    rocker: BodyShape = _link("rocker", ROCKER)

    def build(self) -> None:
        self.j1 = Revolute(phi=fixed(self.phi0), w=fixed(self.w0))
        self.j2 = Revolute(phi=guess(self.coupler0))
        self.j4 = Revolute(phi=guess(self.rocker0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.j1.frame_a)
        yield connect(self.j1.frame_b, self.crank.frame_a)
        yield connect(self.crank.frame_b, self.j2.frame_a)
        yield connect(self.j2.frame_b, self.coupler.frame_a)
        yield connect(self.coupler.frame_b, self.j3.frame_a)
        yield connect(self.j3.frame_b, self.rocker.frame_b)
        yield connect(self.pivot.frame_b, self.j4.frame_a)
        yield connect(self.j4.frame_b, self.rocker.frame_a)


class Pulse(Component):
    """x' = a [0.3 <= t < 0.32] - x."""

    a: Real = parameter(default=30.0)
    x: Real = variable(default=fixed(0.5))

    def equations(self) -> Equations:
        on = (time >= 0.3) & (time < 0.32)
        yield der(self.x) == where(on, self.a, 0.0) - self.x


class Crossing(Component):
    """Two relations passed close to each other: |x| < 1e-3 for a moment, x > 0 no longer; x' = -c."""

    c: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.7))
    y: Real = variable(default=fixed(0.0))
    z: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.c
        yield der(self.y) == where(fabs(self.x) < 1e-3, 400.0, 0.0)
        yield der(self.z) == where(self.x > 0.0, 1.0, 0.0)


class Chained(Component):
    """A `when` that sets off another, and one that reads what a third sets at the same instant."""

    r: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))
    n: Real = integer()
    e: Real = discrete()
    m: Real = integer()

    def equations(self) -> Equations:
        yield der(self.x) == self.r
        yield when(self.x > 0.2, reset(self.x, 3.0), reset(self.n, pre(self.n) + 2))
        yield when(self.x > 1.0, reset(self.n, pre(self.n) + 20))
        yield when(self.x > 1.0, reset(self.e, 2.0))
        yield when(self.x > 1.0, reset(self.m, 1)).elsewhen(self.e > 1.5, reset(self.m, 2))


class Sampled(Component):
    """x' = u, u = -2 x at every tenth of a second."""

    x: Real = variable(default=fixed(1.0))
    u: Real = discrete()
    gain: Real = parameter(default=2.0)

    def equations(self) -> Equations:
        yield der(self.x) == self.u
        yield when(sample(0.1, 0.1), reset(self.u, -self.gain * self.x))


class Thermostat(Component):
    """T' = 4 [heating] - (T - 10)/5, between 19 and 21."""

    power: Real = parameter(default=4.0)
    T: Real = variable(default=fixed(20.0))
    heating: Real = boolean(default=True)

    def equations(self) -> Equations:
        yield self.heating == ((self.T < 19.0) | pre(self.heating) & (self.T < 21.0))
        yield der(self.T) == where(self.heating, self.power, 0.0) - (self.T - 10.0) / 5.0


class Delayed(Component):
    """x' = r - x(t - 0.4)."""

    r: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.r - delay(self.x, 0.4)


class Ball(Component):
    """A ball that falls from 1 m and bounces to rest."""

    e: Real = parameter(default=0.6)
    h: Real = variable(default=fixed(1.0))
    v: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield when(self.h < 0.0, reset(self.v, -self.e * pre(self.v)))


class Sliding(Component):
    """x' = 0.3 - sign(x), y' = x."""

    u: Real = parameter(default=0.3)
    x: Real = variable(default=fixed(-0.65))
    y: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.u - sign(self.x)
        yield der(self.y) == self.x


class Stopped(Component):
    """A mass of 1 kg at 3 m/s in a guide with friction."""

    v0: Real = parameter(default=3.0)
    mass: Mass = part()
    guide: SupportFriction = SupportFriction(f_pos=((0.0, 2.5),))

    def build(self) -> None:
        self.mass = Mass(m=1.0, s=fixed(0.0), v=fixed(self.v0))

    def equations(self) -> Equations:
        yield connect(self.mass.flange_a, self.guide.flange_b)


class Rectifier(Component):
    """10 V, 50 Hz, a diode of 0.1 Ohm and 0.01 mS, 100 Ohm beside 0.1 mF."""

    source: SineVoltage = SineVoltage(V=10.0, f=50.0, phase=0.3)
    diode: IdealDiode = IdealDiode(Ron=0.1, Goff=1e-5)
    load: Resistor = Resistor(R=100.0)
    store: Capacitor = Capacitor(C=1e-4, v=fixed(0.0))
    ground: Ground = Ground()

    def equations(self) -> Equations:
        yield connect(self.source.p, self.diode.p)
        yield connect(self.diode.n, self.load.p, self.store.p)
        yield connect(self.source.n, self.load.n, self.store.n, self.ground.p)


class Bouncing(Component):
    """A sphere of 1 kg and 0.1 m that falls 20 mm on an elastic ground, as a scene that finds its contacts."""

    world: World = World(g=0.0)
    body: Body = Body(
        m=1.0,
        I_11=0.004,
        I_22=0.004,
        I_33=0.004,
        r_0=fixed((0.0, 0.0, 0.12)),
        v_0=fixed((0.0, 0.0, 0.0)),
        Q=fixed((0.0, 0.0, 0.0, 1.0)),
        w_a=fixed((0.0, 0.0, 0.0)),
    )
    weight: WorldForce = WorldForce(force=(0.0, 0.0, -9.81))
    scene: ContactScene = part()

    def build(self) -> None:
        ground = ContactBody(name="ground", shape=HalfSpace(), at_rest=True)
        ball = ContactBody(name="ball", shape=Sphere(0.1))
        law = HuntCrossley(k=1e4, n=1.0, e=1.0, v_0=0.1)
        self.scene = ContactScene(bodies=(ground, ball), surfaces=Surfaces(law=law), keep=1, skin=0.02)

    def equations(self) -> Equations:
        yield connect(self.body.frame_a, self.scene.frame("ball"), self.weight.frame_b)


class Drilling(ThinPlate):
    """A drill of 16 mm that is driven through a plate of 1 mm, without an experiment of its own."""

    experiment: ClassVar[Experiment] = Experiment()


def _square() -> Any:
    x = ca.MX.sym("x")
    return ca.Function("square", [x], [x * x], {"never_inline": True})


SQUARE = External("square", _square, inputs=((),), outputs=((),))


class Called(Component):
    """x' = -k x^2, the square being computed outside of the language."""

    k: Real = parameter(default=1.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == -self.k * SQUARE(self.x)


class Ladder(Component):
    """150 equal sections of 1 Ohm and 1 F behind 1 V."""

    source: ConstantVoltage = ConstantVoltage(V=1.0)
    resistors: list[Resistor] = part()
    capacitors: list[Capacitor] = part()
    ground: Ground = Ground()

    def build(self) -> None:
        self.resistors = [Resistor(R=1.0) for _ in range(150)]
        self.capacitors = [Capacitor(C=1.0, v=fixed(0.0)) for _ in range(150)]

    def equations(self) -> Equations:
        before = self.source.p
        for resistor, capacitor in zip(self.resistors, self.capacitors, strict=True):
            yield connect(before, resistor.p)
            yield connect(resistor.n, capacitor.p)
            yield connect(capacitor.n, self.ground.p)
            before = resistor.n
        yield connect(self.source.n, self.ground.p)


TABLE_A = tuple((k / 100.0, math.sin(0.3 * k)) for k in range(101))
TABLE_B = tuple((k / 64.0, math.cos(0.2 * k * k)) for k in range(65))


class Tables(Component):
    """x' = k (a(t) + b(t))^2 with two tables of 101 and 65 rows in one square."""

    k: Real = parameter(default=1.0)
    a: TimeTable = TimeTable(table=TABLE_A)
    b: TimeTable = TimeTable(table=TABLE_B)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.k * (self.a.y + self.b.y) ** 2


class Driven(Component):
    """x' = k (u - x), u an input."""

    k: Real = parameter(default=1.5)
    u: Real = signal_input()
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.k * (self.u - self.x)


class Watched(Component):
    """x' = r; x must stay below `limit`."""

    r: Real = parameter(default=1.0)
    limit: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(0.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.r
        yield assert_(self.x < self.limit, "x has left its range")
