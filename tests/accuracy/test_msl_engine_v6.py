"""Modelica.Mechanics.MultiBody.Examples.Loops.EngineV6_analytic: six loops, one degree of freedom, gas forces."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from acausal import (
    Component,
    Equations,
    Real,
    connect,
    der,
    fixed,
    guess,
    parameter,
    part,
    quantity,
    structural,
    variable,
    where,
)
from acausal.library.multibody import (
    Body,
    BodyShape,
    FixedRotation,
    FixedTranslation,
    Frame,
    Prismatic,
    Revolute,
    RevolutePlanarLoopConstraint,
    World,
    axis_rotation,
)
from acausal.library.rotational import Flange as RotationalFlange
from acausal.library.rotational import Inertia
from acausal.library.translational import Flange
from tests.accuracy.msl_reference import met

X = (1.0, 0.0, 0.0)


class GasForce(Component):
    """Pressure over the piston's place `s` below the head and the direction of its motion, in a bore of 0.1 m."""

    flange: Flange = Flange()
    L: Real = parameter(unit="m")
    s: Real = variable(unit="m")
    v: Real = variable(unit="m/s")

    def equations(self) -> Equations:
        yield self.s == self.flange.s
        yield self.v == der(self.s)
        x = 1 - self.s / self.L
        # fitted curves that meet: no crossing of theirs has to be located (as events they cost minutes)
        inward = where(
            x < 0.986061,
            177.4132 * x**4 - 287.2189 * x**3 + 151.8252 * x**2 - 24.9973 * x + 2.4,
            2836360 * x**4 - 10569296 * x**3 + 14761814 * x**2 - 9158505 * x + 2129670,
            smooth=True,
        )
        outward = where(
            x > 0.933,
            -3929704 * x**4 + 14748765 * x**3 - 20747000 * x**2 + 12964477 * x - 3036495,
            145.930 * x**4 - 131.707 * x**3 + 17.3438 * x**2 + 17.9272 * x + 2.4,
            smooth=True,
        )
        pressure = quantity(1.0, "bar") * where(self.v < 0, inward, outward, smooth=True)
        yield self.flange.f == -pressure * quantity(math.pi * 0.1**2 / 4, "m2")


class Cylinder(Component):
    """Crank pin, rod, piston and head of one cylinder; angles in degrees."""

    crank: Frame = Frame()
    engine: Frame = Frame()
    offset: float = structural()
    inclination: float = structural()
    x: float = structural()
    turned: FixedRotation = part()
    pin: FixedTranslation = FixedTranslation(r=(0.0, 0.05, 0.0))
    lower: RevolutePlanarLoopConstraint = RevolutePlanarLoopConstraint(n=X)
    rod: BodyShape = BodyShape(m=1.0, r=(0.0, 0.175, 0.0), r_CM=(0.0, 0.0875, 0.0), I_11=0.006)
    upper: Revolute = Revolute(n=X)
    piston: BodyShape = BodyShape(m=6.0, r=(0.0, 0.1, 0.0), r_CM=(0.0, 0.05, 0.0))
    slide: Prismatic = Prismatic(n=(0.0, -1.0, 0.0), s=guess(0.15))
    head: FixedTranslation = FixedTranslation(r=(0.0, 0.42, 0.0))
    tilted: FixedRotation = part()
    gas: GasForce = GasForce(L=0.195)

    def build(self) -> None:
        self.turned = FixedRotation(r=(self.x, 0.0, 0.0), R_rel=axis_rotation(X, math.radians(self.offset)))
        self.tilted = FixedRotation(r=(self.x, 0.0, 0.0), R_rel=axis_rotation(X, math.radians(self.inclination)))

    def equations(self) -> Equations:
        yield connect(self.crank, self.turned.frame_a)
        yield connect(self.turned.frame_b, self.pin.frame_a)
        yield connect(self.pin.frame_b, self.lower.frame_a)
        yield connect(self.lower.frame_b, self.rod.frame_a)
        yield connect(self.rod.frame_b, self.upper.frame_b)
        yield connect(self.upper.frame_a, self.piston.frame_a)
        yield connect(self.piston.frame_b, self.slide.frame_b)
        yield connect(self.slide.frame_a, self.head.frame_b)
        yield connect(self.head.frame_a, self.tilted.frame_b)
        yield connect(self.tilted.frame_a, self.engine)
        yield connect(self.gas.flange, self.slide.axis)


class Load(Component):
    """Resistance that grows with the square of the speed, and the torque on the load, filtered twice."""

    flange: RotationalFlange = RotationalFlange()
    J: Real = parameter(default=1.0, unit="kg.m2")
    w_0: Real = parameter(default=200.0, unit="rad/s")
    tau_0: Real = parameter(default=100.0, unit="N.m")
    w: Real = variable(unit="rad/s")
    u: Real = variable(unit="N.m")
    x1: Real = variable(unit="N.m")
    x2: Real = variable(unit="N.m")

    def equations(self) -> Equations:
        W = quantity(2 * math.pi * 5 / math.sqrt(math.sqrt(2) - 1), "rad/s")
        yield self.w == der(self.flange.phi)
        resistance = self.tau_0 * (self.w / self.w_0) * (self.w / self.w_0)
        yield self.flange.tau == resistance
        yield self.u == self.J * der(self.w) + resistance
        yield der(self.x1) == (self.u - self.x1) * W
        yield der(self.x2) == (self.x1 - self.x2) * W

    def initial_equations(self) -> Equations:
        yield self.x1 == self.u
        yield self.x2 == self.x1


class EngineV6(Component):
    world: World = World()
    bearing: Revolute = Revolute(n=X)
    crank: Body = Body(m=180.0, I_11=0.1)
    cylinders: list[Cylinder] = part()
    load: Inertia = Inertia(J=1.0, phi=fixed(0.0), w=fixed(10.0))
    resistance: Load = Load()

    def build(self) -> None:
        angles = ((-30, -30), (90, 30), (210, -30), (210, 30), (90, -30), (-30, 30))
        self.cylinders = [
            Cylinder(offset=float(offset), inclination=float(tilt), x=0.14 * k)
            for k, (offset, tilt) in enumerate(angles)
        ]

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.bearing.frame_a)
        yield connect(self.bearing.frame_b, self.crank.frame_a)
        for cylinder in self.cylinders:
            yield connect(self.bearing.frame_b, cylinder.crank)
            yield connect(self.world.frame_b, cylinder.engine)
        yield connect(self.bearing.axis, self.load.flange_a)
        yield connect(self.load.flange_b, self.resistance.flange)


@pytest.mark.slow
def test_six_cylinders(reference: Path) -> None:
    renamed = {"filter.x[0]": "resistance.x1", "filter.x[1]": "resistance.x2"}
    met(EngineV6(), reference / "msl" / "MultiBody_EngineV6_analytic", renamed=renamed, tolerance=1e-6)
