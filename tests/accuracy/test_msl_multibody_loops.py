"""Modelica.Mechanics.MultiBody.Examples.Loops: closed kinematic loops, against their converged results."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import acausal
from acausal import Component, Equations, connect, fixed, guess, part, where
from acausal.library.multibody import (
    BodyBox,
    BodyCylinder,
    Fixed,
    FixedTranslation,
    Prismatic,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
)
from acausal.library.rotational import Inertia
from acausal.library.translational import Flange
from tests.accuracy.msl_reference import met

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Fourbar1(Component):
    """Spatial four-bar: seven joints in one loop, one degree of freedom."""

    world: World = World()
    base: Fixed = Fixed(r=(1.2, 0.0, 0.0))
    j1: Revolute = Revolute(n=X, phi=fixed(0.0), w=fixed(math.radians(300.0)))
    b1: BodyCylinder = BodyCylinder(r=(0.0, 0.5, 0.1), diameter=0.05)
    j2: Prismatic = Prismatic(n=X, s=guess(-0.2))
    b2: BodyCylinder = BodyCylinder(r=(0.0, 0.2, 0.0), diameter=0.05)
    joints: list[Revolute] = part()
    b3: BodyCylinder = BodyCylinder(r=(-1.0, 0.3, 0.1), diameter=0.05)

    def build(self) -> None:
        self.joints = [Revolute(n=n) for n in (Y, Z, X, Y, Z)]

    def equations(self) -> Equations:
        about_y, about_z, *ball = self.joints
        yield connect(self.world.frame_b, self.j1.frame_a)
        yield connect(self.j1.frame_b, self.b1.frame_a)
        yield connect(self.base.frame_b, self.j2.frame_a)
        yield connect(self.j2.frame_b, self.b2.frame_a)
        yield connect(self.b2.frame_b, about_y.frame_a)
        yield connect(about_y.frame_b, about_z.frame_a)
        yield connect(about_z.frame_b, self.b3.frame_a)
        yield connect(self.b3.frame_b, ball[2].frame_b)
        yield connect(ball[2].frame_a, ball[1].frame_b)
        yield connect(ball[1].frame_a, ball[0].frame_b)
        yield connect(ball[0].frame_a, self.b1.frame_b)


class Engine1a(Component):
    """Crank, rod and piston: a planar loop in space."""

    world: World = part()
    bearing: Revolute = part()
    inertia: Inertia = part()
    crank1: BodyCylinder = part()
    crank2: BodyBox = part()
    crank3: BodyCylinder = part()
    crank4: BodyBox = part()
    pin: FixedTranslation = part()
    lower: RevolutePlanarLoopConstraint = part()
    rod: BodyBox = part()
    upper: Revolute = part()
    piston: BodyCylinder = part()
    top: Fixed = part()
    cylinder: Prismatic = part()

    def build(self) -> None:
        self.world = World()
        self.bearing = Revolute(n=X)
        self.inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(10.0))
        self.crank1 = BodyCylinder(r=(0.1, 0.0, 0.0), diameter=0.05)
        self.crank2 = BodyBox(r=(0.0, 0.1, 0.0), width=0.02, height=0.05, width_direction=X)
        self.crank3 = BodyCylinder(r=(0.1, 0.0, 0.0), diameter=0.03)
        self.crank4 = BodyBox(r=(0.0, -0.1, 0.0), width=0.02, height=0.05, width_direction=X)
        self.pin = FixedTranslation(r=(0.05, 0.0, 0.0))
        self.lower = RevolutePlanarLoopConstraint(n=X)
        self.rod = BodyBox(r=(0.0, 0.2, 0.0), width=0.02, height=0.06, width_direction=X)
        self.upper = Revolute(n=X)
        self.piston = BodyCylinder(r=(0.0, 0.1, 0.0), diameter=0.1)
        self.top = Fixed(r=(0.15, 0.45, 0.0))
        self.cylinder = Prismatic(n=(0.0, -1.0, 0.0), s=guess(0.15))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.bearing.frame_a)
        yield connect(self.inertia.flange_b, self.bearing.axis)
        yield connect(self.bearing.frame_b, self.crank1.frame_a)
        yield connect(self.crank1.frame_b, self.crank2.frame_a)
        yield connect(self.crank2.frame_b, self.crank3.frame_a, self.pin.frame_a)
        yield connect(self.crank3.frame_b, self.crank4.frame_a)
        yield connect(self.pin.frame_b, self.lower.frame_a)
        yield connect(self.lower.frame_b, self.rod.frame_a)
        yield connect(self.rod.frame_b, self.upper.frame_b)
        yield connect(self.upper.frame_a, self.piston.frame_a)
        yield connect(self.piston.frame_b, self.cylinder.frame_b)
        yield connect(self.cylinder.frame_a, self.top.frame_b)


class GasForce(Component):
    """Pressure in a cylinder of diameter 0.1 m and length 0.35 m over the piston's place and direction."""

    flange: Flange = Flange()
    s: acausal.Real = acausal.variable(unit="m")
    v: acausal.Real = acausal.variable(unit="m/s")

    def equations(self) -> Equations:
        yield self.s == self.flange.s
        yield self.v == acausal.der(self.s)
        x = 1 - self.s / acausal.quantity(0.35, "m")
        inward = where(
            x < 0.986061,
            177.4132 * x**4 - 287.2189 * x**3 + 151.8252 * x**2 - 24.9973 * x + 2.4,
            2836360 * x**4 - 10569296 * x**3 + 14761814 * x**2 - 9158505 * x + 2129670,
        )
        outward = where(
            x > 0.933,
            -3929704 * x**4 + 14748765 * x**3 - 20747000 * x**2 + 12964477 * x - 3036495,
            145.930 * x**4 - 131.707 * x**3 + 17.3438 * x**2 + 17.9272 * x + 2.4,
        )
        pressure = acausal.quantity(1.0, "bar") * where(self.v < 0, inward, outward)
        yield self.flange.f == -pressure * acausal.quantity(math.pi * 0.1**2 / 4, "m2")


class Engine1b(Engine1a):
    gas: GasForce = part()

    def build(self) -> None:
        Engine1a.build(self)
        self.gas = GasForce()

    def equations(self) -> Equations:
        yield connect(self.gas.flange, self.cylinder.axis)


EXAMPLES: dict[str, type[Component]] = {
    "MultiBody_Fourbar1": Fourbar1,
    "MultiBody_Engine1a": Engine1a,
    "MultiBody_Engine1b": Engine1b,
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_converged_solution_is_met(reference: Path, name: str) -> None:
    met(EXAMPLES[name](), reference / "msl" / name)
