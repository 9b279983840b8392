"""Examples of Modelica.Mechanics.MultiBody with a gear in three dimensions and with a rolling wheel."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from acausal import Component, Equations, Real, connect, fixed, guess, sin, time, variable
from acausal.library.multibody import Body, BodyCylinder, GearConstraint, RollingWheel, World, WorldTorque
from tests.accuracy.msl_reference import met


class GearDrive(Component):
    world: World = World()
    gear: GearConstraint = GearConstraint(ratio=10.0)
    shaft_a: BodyCylinder = BodyCylinder(r=(0.4, 0.0, 0.0), diameter=0.1, g_0=(0.0, 0.0, 0.0))
    shaft_b: BodyCylinder = BodyCylinder(r=(0.4, 0.0, 0.0), diameter=0.2, g_0=(0.0, 0.0, 0.0))
    drive: WorldTorque = WorldTorque(torque=(2 * sin(2 * math.pi * time), 0.0, 0.0))
    phi: Real = variable(unit="rad", default=fixed(0.0))
    w: Real = variable(unit="rad/s", default=fixed(0.0))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.gear.bearing)
        yield connect(self.gear.frame_a, self.shaft_a.frame_a, self.drive.frame_b)
        yield connect(self.gear.frame_b, self.shaft_b.frame_a)
        yield self.phi == self.gear.revolute_b.phi
        yield self.w == self.gear.revolute_b.w


def test_gear_in_three_dimensions(reference: Path) -> None:
    renamed = {"gearConstraint.actuatedRevolute_b": "gear.revolute_b", "inertia2": "gear.revolute_b"}
    folder = reference / "msl" / "MultiBody_GearConstraint"
    result = met(GearDrive(), folder, renamed=renamed, file="reference.csv")  # published with an error of 3e-6
    omega = 2 * math.pi
    a = 20 / (100 * 0.0302378292908 + 0.483805268653)  # inertias as printed in the reference's README
    t = result.time
    np.testing.assert_allclose(result["phi"], a * (t / omega - np.sin(omega * t) / omega**2), atol=5e-6)
    # What the bearing gives: the change of both shafts' angular momentum, less the drive.
    acceleration = a * np.sin(omega * t)
    torque = (10 * 0.0302378292908 + 0.483805268653) * acceleration - 2 * np.sin(omega * t)
    np.testing.assert_allclose(result["gear.bearing.t"][:, 0], torque, atol=1e-5)


class Wheel(Component):
    """A disc that is pushed off with some lean."""

    wheel: RollingWheel = RollingWheel(radius=0.3, n=(0.0, 0.0, 1.0))
    body: Body = Body(
        m=2.0,
        I_11=0.12,
        I_22=0.06,
        I_33=0.12,
        g_0=(0.0, 0.0, -9.80665),
        r_0=guess((0.2, 0.2, 0.3)),
        Q=fixed((0.0, 0.0, 0.0, 1.0)),
        w_a=fixed((1.0, 5.0, 0.0)),
    )

    def equations(self) -> Equations:
        yield connect(self.wheel.frame_a, self.body.frame_a)

    def initial_equations(self) -> Equations:
        yield self.body.r_0[0] == 0.2
        yield self.body.r_0[1] == 0.2


def test_rolling_wheel(reference: Path) -> None:
    renamed = {"wheel1.x": "body.r_0[0]", "wheel1.y": "body.r_0[1]"}
    result = met(Wheel(), reference / "msl" / "MultiBody_RollingWheel", renamed=renamed)
    # It rolls: the work of the contact is zero, so energy stays.
    w, v = result["body.w_a"], result["body.v_0"]
    energy = (v**2).sum(axis=1) + (w**2 * [0.06, 0.03, 0.06]).sum(axis=1) + 2 * 9.80665 * result["body.r_0"][:, 2]
    assert np.ptp(energy) < 1e-6 * energy[0]
