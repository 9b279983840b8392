"""Pendulums of all kinds: periods, energies, reactions, and the states the compiler finds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ellipk

import acausal
from acausal import Component, Equations, connect, fixed, part, structural
from acausal.library.multibody import Body, CutForce, CutTorque, Prismatic, Revolute, Spherical, World
from acausal.models.double_pendulum import DoublePendulum
from acausal.models.pendulum import Pendulum
from acausal.models.pendulum_chain import PendulumChain

G = 9.80665
LENGTH, INERTIA = 0.5, 0.001
ABOUT_HINGE = INERTIA + LENGTH**2  # of a mass of 1 kg
PERIOD = 4 * ellipk(0.5) * math.sqrt(ABOUT_HINGE / (G * LENGTH))
"""A physical pendulum of amplitude 90 degrees: T = 4 K(sin^2 45 degrees) sqrt(I / (m g l))."""


def test_period_is_the_elliptic_integral() -> None:
    result = acausal.simulate(Pendulum(), stop_time=2 * PERIOD, tolerance=1e-10)
    assert result.at(PERIOD / 4, "revolute.phi") == pytest.approx(-math.pi / 2, abs=1e-7)
    assert result.at(PERIOD / 2, "revolute.phi") == pytest.approx(-math.pi, abs=1e-7)
    assert result.final("revolute.phi") == pytest.approx(0.0, abs=1e-6)
    assert result.at(PERIOD / 4, "revolute.w") == pytest.approx(-math.sqrt(2 * G * LENGTH / ABOUT_HINGE), abs=1e-7)


def test_a_pendulum_described_in_three_dimensions_has_two_states() -> None:
    assert set(acausal.compile(Pendulum()).states) == {"revolute.phi", "revolute.w"}


@pytest.mark.parametrize("n", [1, 4])
def test_a_chain_has_two_states_for_each_joint(n: int) -> None:
    expected = {f"joints[{k}].{x}" for k in range(n) for x in ("phi", "w")}
    assert set(acausal.compile(PendulumChain(n=n)).states) == expected


def test_a_chain_of_one_link_is_a_pendulum() -> None:
    about_hinge = 0.02 + 0.25**2
    period = 4 * ellipk(0.5) * math.sqrt(about_hinge / (G * 0.25))
    result = acausal.simulate(PendulumChain(n=1), stop_time=period, tolerance=1e-10)
    assert result.final("joints[0].phi") == pytest.approx(0.0, abs=1e-6)


class Tilted(Component):
    """The pendulum of the models about an oblique axis, hung by either frame of the joint."""

    reversed_joint: bool = structural(default=False)
    world: World = part()
    revolute: Revolute = part()
    body: Body = part()

    def build(self) -> None:
        # Axis, direction of the arm and direction of gravity: a right-handed triad along no axis of the world.
        self.world = World(n=(-2.0, -1.0, 2.0))
        self.revolute = Revolute(n=(1.0, 2.0, 2.0), phi=fixed(0.0), w=fixed(0.0))
        arm = np.cross([2 / 3, 1 / 3, -2 / 3], [1 / 3, 2 / 3, 2 / 3]) * LENGTH
        self.body = Body(m=1.0, r_CM=tuple(arm.tolist()))

    def equations(self) -> Equations:
        a, b = self.revolute.frame_a, self.revolute.frame_b
        near, far = (b, a) if self.reversed_joint else (a, b)
        yield connect(self.world.frame_b, near)
        yield connect(far, self.body.frame_a)


@pytest.mark.parametrize("reversed_joint", [False, True])
def test_the_motion_depends_on_neither_the_axes_nor_the_side_of_the_root(reversed_joint: bool) -> None:
    result = acausal.simulate(Tilted(reversed_joint=reversed_joint), stop_time=PERIOD / 2, tolerance=1e-10)
    direction = 1.0 if reversed_joint else -1.0
    assert result.final("revolute.phi") == pytest.approx(direction * math.pi, abs=1e-6)


def test_double_pendulum_keeps_its_energy() -> None:
    result = acausal.simulate(DoublePendulum(), stop_time=5.0, tolerance=1e-10)
    m, L = 7700 * 0.5 * 0.06**2, 0.5
    about_centre = m * (L**2 + 0.06**2) / 12
    energy = np.zeros_like(result.time)
    for k in (1, 2):
        v_0, w = result[f"bar{k}.v_0"], result[f"bar{k}.w_a"]
        R = result[f"bar{k}.frame_a.R"]
        arm = np.array([L / 2, 0.0, 0.0])
        v_c = v_0 + np.einsum("tij,tj->ti", R, np.cross(w, arm))
        height = result[f"bar{k}.r_0"][:, 1] + R[:, 1, 0] * L / 2
        energy += m / 2 * (v_c**2).sum(axis=1) + about_centre / 2 * w[:, 2] ** 2 + m * G * height
    assert np.ptp(energy) < 1e-7 * m * G * L


class Rail(Component):
    """A bar on a slider without mass or friction: nothing pushes it sideways."""

    world: World = World()
    prismatic: Prismatic = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(0.0), v=fixed(0.0))
    revolute: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    body: Body = Body(m=1.0, r_CM=(LENGTH, 0.0, 0.0), I_33=0.02)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.prismatic.frame_a)
        yield connect(self.prismatic.frame_b, self.revolute.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a)


def test_slider_and_hinge_reduce_to_their_coordinates() -> None:
    expected = {"prismatic.s", "prismatic.v", "revolute.phi", "revolute.w"}
    assert set(acausal.compile(Rail()).states) == expected


def test_the_centre_of_mass_on_a_rail_falls_straight_down() -> None:
    result = acausal.simulate(Rail(), stop_time=1.0, tolerance=1e-10)
    s, phi, w = (result[name] for name in ("prismatic.s", "revolute.phi", "revolute.w"))
    np.testing.assert_allclose(s + LENGTH * np.cos(phi), LENGTH, atol=1e-8)
    # Energy: the centre of mass moves with L w cos(phi) vertically.
    kinetic = ((LENGTH * w * np.cos(phi)) ** 2 + 0.02 * w**2) / 2
    np.testing.assert_allclose(kinetic, -G * LENGTH * np.sin(phi), atol=1e-7)


class Cut(Component):
    world: World = World()
    force: CutForce = CutForce()
    torque: CutTorque = CutTorque()
    revolute: Revolute = Revolute(phi=fixed(0.0), w=fixed(0.0))
    body: Body = Body(m=1.0, r_CM=(LENGTH, 0.0, 0.1))

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.force.frame_a)
        yield connect(self.force.frame_b, self.torque.frame_a)
        yield connect(self.torque.frame_b, self.revolute.frame_a)
        yield connect(self.revolute.frame_b, self.body.frame_a)


def test_reactions_of_the_hinge() -> None:
    """Thrown from the horizontal, the hinge bears m g (1 + 2 m l^2 / I) at the bottom; the offset along the axis
    makes a torque about x."""
    result = acausal.simulate(Cut(), stop_time=PERIOD / 4, tolerance=1e-10)
    bottom = G * (1 + 2 * LENGTH**2 / ABOUT_HINGE)
    np.testing.assert_allclose(result.final("force.force"), [0.0, bottom, 0.0], atol=1e-5)
    np.testing.assert_allclose(result.final("torque.torque"), [-0.1 * bottom, 0.0, 0.0], atol=1e-5)
    # At the start only m g less the mass' own acceleration is borne.
    start = G * (1 - LENGTH**2 / ABOUT_HINGE)
    np.testing.assert_allclose(result.at(0.0, "force.force"), [0.0, start, 0.0], atol=1e-9)


class BallPendulum(Component):
    world: World = World()
    ball: Spherical = Spherical()
    body: Body = Body(
        m=1.0,
        r_CM=(LENGTH, 0.0, 0.0),
        I_22=0.002,
        Q=fixed((0.0, 0.0, 0.0, 1.0)),
        w_a=fixed((0.0, 3.0, 0.0)),
    )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.ball.frame_a)
        yield connect(self.ball.frame_b, self.body.frame_a)


def test_ball_pendulum_keeps_energy_and_vertical_spin() -> None:
    result = acausal.simulate(BallPendulum(), stop_time=5.0, tolerance=1e-10)
    R, w = result["body.frame_a.R"], result["body.w_a"]
    about_hinge = np.diag([0.001, 0.002 + LENGTH**2, 0.001 + LENGTH**2])
    spin = np.einsum("tij,tj->ti", R, w @ about_hinge)
    energy = np.einsum("ti,ij,tj->t", w, about_hinge, w) / 2 + G * LENGTH * R[:, 1, 0]
    assert np.ptp(spin[:, 1]) < 1e-7
    assert np.ptp(energy) < 1e-6
    assert np.ptp(result["body.r_0"]) < 1e-12
