"""Sensors, and bodies made of shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, part
from acausal.library.multibody import (
    AbsoluteSensor,
    Body,
    BodyBox,
    BodyCylinder,
    FixedRotation,
    FixedTranslation,
    RelativeSensor,
    Revolute,
    Universal,
    World,
    rotation_sequence,
)

ANGLES = (0.3, -0.4, 1.1)


class Turntable(Component):
    """A turning arm with sensors on it; its base is turned against the world."""

    world: World = World()
    base: FixedRotation = FixedRotation(r=(1.0, 2.0, 3.0), R_rel=rotation_sequence(ANGLES))
    revolute: Revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.5), w=fixed(2.0))
    arm: FixedTranslation = FixedTranslation(r=(0.4, 0.0, 0.0))
    body: Body = Body(m=1.0, g_0=(0.0, 0.0, 0.0))
    absolute: AbsoluteSensor = AbsoluteSensor()
    of_base: AbsoluteSensor = AbsoluteSensor()
    relative: RelativeSensor = RelativeSensor()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.base.frame_a)
        yield connect(self.base.frame_b, self.revolute.frame_a, self.relative.frame_a, self.of_base.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a, self.arm.frame_a)
        yield connect(self.arm.frame_b, self.absolute.frame_a, self.relative.frame_b)


def test_sensors_on_a_turning_arm() -> None:
    result = acausal.simulate(Turntable(), stop_time=1.0, tolerance=1e-9)
    phi = 2.5
    R = np.array(rotation_sequence(ANGLES))
    radial, tangential = np.array([math.cos(phi), math.sin(phi), 0]), np.array([-math.sin(phi), math.cos(phi), 0])
    near: Any = {"atol": 1e-7}
    np.testing.assert_allclose(result.final("of_base.angles"), ANGLES, **near)
    np.testing.assert_allclose(result.final("of_base.r"), [1.0, 2.0, 3.0], **near)
    np.testing.assert_allclose(result.final("absolute.r"), [1.0, 2.0, 3.0] + R @ radial * 0.4, **near)
    np.testing.assert_allclose(result.final("absolute.v"), R @ tangential * 0.8, **near)
    np.testing.assert_allclose(result.final("absolute.w"), [0.0, 0.0, 2.0], **near)
    np.testing.assert_allclose(result.final("relative.r_rel"), radial * 0.4, **near)
    np.testing.assert_allclose(result.final("relative.v_rel"), tangential * 0.8, **near)
    np.testing.assert_allclose(result.final("relative.w_rel"), [0.0, 0.0, 2.0], **near)
    np.testing.assert_allclose(result.final("relative.angles"), [0.0, 0.0, phi], **near)


class Swing(Component):
    """A body of some shape that swings about z at its frame_a."""

    world: World = World()
    revolute: Revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0), w=fixed(0.0))
    body: BodyBox | BodyCylinder = part()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.revolute.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a)


L = 0.4


DOWN, RIGHT = (0.0, -9.80665, 0.0), (9.80665, 0.0, 0.0)


@pytest.mark.parametrize(
    ("body", "square"),
    [
        (BodyCylinder(r=(L, 0.0, 0.0), diameter=0.1, g_0=DOWN), (L**2 + 0.75 * 0.1**2) / 12),
        (
            BodyCylinder(r=(L, 0.0, 0.0), diameter=0.1, inner_diameter=0.06, g_0=DOWN),
            (L**2 + 0.75 * (0.1**2 + 0.06**2)) / 12,
        ),
        (BodyBox(r=(L, 0.0, 0.0), width=0.1, height=0.2, width_direction=(0, 1, 0), g_0=DOWN), (L**2 + 0.1**2) / 12),
        (BodyBox(r=(L, 0.0, 0.0), width=0.1, height=0.2, width_direction=(0, 0, 1), g_0=DOWN), (L**2 + 0.2**2) / 12),
        (BodyBox(r=(0.0, L, 0.0), width=0.1, height=0.2, width_direction=(1, 0, 0), g_0=RIGHT), (L**2 + 0.1**2) / 12),
    ],
)
def test_first_acceleration_of_a_solid(body: BodyBox | BodyCylinder, square: float) -> None:
    """Textbook moments of inertia over the mass about the centre, and Steiner; gravity across the arm."""
    result = acausal.simulate(Swing(body=body), stop_time=0.01, tolerance=1e-8)
    expected = -9.80665 * (L / 2) / (square + (L / 2) ** 2)
    assert result.at(0.0, "revolute.a") == pytest.approx(expected, abs=1e-9)


class CardanPendulum(Component):
    """A bar on a universal joint."""

    world: World = World()
    joint: Universal = Universal(
        n_a=(1.0, 0.0, 0.0), n_b=(0.0, 0.0, 1.0), phi_a=fixed(0.4), phi_b=fixed(0.7), w_a=fixed(2.0), w_b=fixed(0.0)
    )
    body: Body = Body(m=1.0, r_CM=(0.0, -L, 0.0), I_11=0.02, I_22=0.01, I_33=0.02)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a)


def test_universal_joint_keeps_energy_and_its_second_axis_stays_across_the_first() -> None:
    result = acausal.simulate(CardanPendulum(), stop_time=3.0, tolerance=1e-10)
    R, w = result["body.frame_a.R"], result["body.w_a"]
    about_joint = np.diag([0.02 + L**2, 0.01, 0.02 + L**2])
    energy = np.einsum("ti,ij,tj->t", w, about_joint, w) / 2 - 9.80665 * L * R[:, 1, 1]
    assert np.ptp(energy) < 1e-6
    np.testing.assert_allclose(R[:, 0, 2], 0.0, atol=1e-12)
