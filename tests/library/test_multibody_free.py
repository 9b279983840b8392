"""Free bodies: parabolas, tops, and what internal forces cannot change."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Result, connect, fixed, part, structural
from acausal.errors import AcausalError, EventError
from acausal.library.multibody import (
    Body,
    BodyShape,
    FixedRotation,
    FixedTranslation,
    Force,
    FrameForce,
    FrameTorque,
    FreeMotion,
    PointMass,
    ResolveIn,
    Spherical,
    Spring,
    Torque,
    World,
    WorldForce,
    WorldTorque,
    axis_rotation,
    quaternion,
)
from acausal.lower.cache.cache import forget
from tests.expected import fails_with

UPRIGHT = fixed((0.0, 0.0, 0.0, 1.0))
REST = fixed((0.0, 0.0, 0.0))
AT_REST: dict[str, Any] = {"r_0": REST, "v_0": REST, "w_a": REST, "Q": UPRIGHT}
WEIGHTLESS = (0.0, 0.0, 0.0)
G = 9.80665


class Alone(Component):
    body: Body = part()


def run(model: Component, stop_time: float) -> Result:
    return acausal.simulate(model, stop_time=stop_time, tolerance=1e-10)


def spin_of(result: Result, body: str, tensor: Any) -> np.ndarray:
    """Angular momentum about the centre of mass, in world axes."""
    return np.asarray(np.einsum("tij,jk,tk->ti", result[f"{body}.frame_a.R"], np.array(tensor), result[f"{body}.w_a"]))


def test_a_thrown_body_flies_a_parabola_whatever_its_spin() -> None:
    r_CM = np.array([0.2, -0.1, 0.3])
    w = np.array([0.5, -2.0, 3.0])
    body = Body(
        m=2.0,
        r_CM=tuple(r_CM.tolist()),
        I_11=0.1,
        I_22=0.2,
        I_33=0.15,
        I_21=0.02,
        r_0=fixed((1.0, 2.0, 3.0)),
        v_0=fixed((4.0, 5.0, 6.0)),
        w_a=fixed(tuple(w.tolist())),
        Q=UPRIGHT,
    )
    result = run(Alone(body=body), 2.0)
    t = result.time[:, None]
    centre = result["body.r_0"] + np.einsum("tij,j->ti", result["body.frame_a.R"], r_CM)
    thrown = np.array([1.0, 2.0, 3.0]) + r_CM + t * (np.array([4.0, 5.0, 6.0]) + np.cross(w, r_CM))
    np.testing.assert_allclose(centre, thrown - [0.0, G / 2, 0.0] * t**2, atol=1e-7)


def test_a_symmetric_top_precesses_at_the_rate_of_euler() -> None:
    """Free symmetric top: w turns about the figure axis at (I_3 - I_1) w_3 / I_1 (Goldstein, section 5.6)."""
    start: dict[str, Any] = AT_REST | {"w_a": fixed((0.3, 0.0, 2.0))}
    body = Body(m=1.0, g_0=WEIGHTLESS, I_11=1.0, I_22=1.0, I_33=1.8, **start)
    result = run(Alone(body=body), 10.0)
    rate = 0.8 * 2.0
    expected = np.stack([0.3 * np.cos(rate * result.time), 0.3 * np.sin(rate * result.time), 0 * result.time + 2.0], 1)
    np.testing.assert_allclose(result["body.w_a"], expected, atol=1e-7)


def test_a_tumbling_body_keeps_angular_momentum_and_energy() -> None:
    """Spin about the middle axis is unstable: the body turns over again and again (Dzhanibekov)."""
    tensor = np.array([[1.0, 0.1, 0.0], [0.1, 2.0, 0.05], [0.0, 0.05, 3.0]])
    body = Body(
        m=1.0,
        g_0=WEIGHTLESS,
        I_11=1.0,
        I_22=2.0,
        I_33=3.0,
        I_21=0.1,
        I_32=0.05,
        r_0=REST,
        v_0=REST,
        Q=fixed(quaternion(axis_rotation((1, 2, 3), 0.7))),
        w_a=fixed((0.01, 3.0, 0.0)),
    )
    result = run(Alone(body=body), 30.0)
    w = result["body.w_a"]
    assert w[:, 1].min() < -2.5  # it did turn over
    spin = spin_of(result, "body", tensor)
    np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), atol=2e-6)
    assert np.ptp(np.einsum("ti,ij,tj->t", w, tensor, w)) < 1e-6


def test_the_length_of_the_quaternion_does_not_matter() -> None:
    common: dict[str, Any] = {"m": 1.0, "r_0": REST, "v_0": REST, "w_a": fixed((1.0, 2.0, 3.0)), "I_33": 0.002}
    unit = run(Alone(body=Body(**common, Q=fixed((0.0, 0.0, 0.6, 0.8)))), 2.0)
    long = run(Alone(body=Body(**common, Q=fixed((0.0, 0.0, 3.0, 4.0)))), 2.0)
    np.testing.assert_allclose(unit.final("body.frame_a.R"), long.final("body.frame_a.R"), atol=1e-6)


class Jointed(Component):
    """The same body on a joint that constrains nothing."""

    world: World = part()
    joint: FreeMotion = part()
    body: Body = part()

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.body.frame_a)


def test_the_joint_of_free_motion_changes_nothing() -> None:
    shape: dict[str, Any] = {"m": 1.0, "r_CM": (0.1, 0.2, 0.0), "I_22": 0.002}
    v, w = fixed((1.0, 0.0, 0.5)), fixed((1.0, 2.0, 3.0))
    free = run(Alone(body=Body(**shape, r_0=REST, v_0=v, w_a=w, Q=UPRIGHT)), 2.0)
    joint = FreeMotion(r_rel_a=REST, v_rel_a=v, w_rel_b=w, Q=UPRIGHT)
    jointed = run(Jointed(world=World(), joint=joint, body=Body(**shape)), 2.0)
    for name in ("body.r_0", "body.w_a"):
        np.testing.assert_allclose(jointed.final(name), free.final(name), atol=1e-6)


class Pushed(Component):
    """One body with one external load."""

    body: Body = part()
    load: Any = part()

    def equations(self) -> Equations:
        yield connect(self.load.frame_b, self.body.frame_a)


def pushed(load: Component, **start: Any) -> Result:
    body = Body(m=2.0, g_0=WEIGHTLESS, I_11=0.5, I_22=0.5, I_33=0.5, **(AT_REST | start))
    return run(Pushed(body=body, load=load), 2.0)


def test_a_constant_force_in_the_world() -> None:
    result = pushed(WorldForce(force=(1.0, 2.0, 3.0)), w_a=fixed((0.0, 0.0, 4.0)))
    np.testing.assert_allclose(result.final("body.r_0"), np.array([1.0, 2.0, 3.0]) / 2 * 2.0**2 / 2, atol=1e-8)


def test_a_force_that_turns_with_the_body() -> None:
    """Spin W about z and thrust F along the body's x: v = F/(m W) (sin W t, 1 - cos W t)."""
    result = pushed(FrameForce(force=(1.0, 0.0, 0.0)), w_a=fixed((0.0, 0.0, 4.0)))
    expected = np.array([math.sin(8.0), 1 - math.cos(8.0), 0.0]) / (2.0 * 4.0)
    np.testing.assert_allclose(result.final("body.v_0"), expected, atol=1e-8)


@pytest.mark.parametrize("load", [WorldTorque, FrameTorque])
def test_a_torque_about_one_axis(load: type[Component]) -> None:
    result = pushed(load(torque=(0.0, 0.0, 0.25)))
    np.testing.assert_allclose(result.final("body.w_a"), [0.0, 0.0, 0.25 / 0.5 * 2.0], atol=1e-9)
    R = np.array(axis_rotation((0, 0, 1), 0.5 * 2.0**2 / 2))
    np.testing.assert_allclose(result.final("body.frame_a.R"), R, atol=1e-8)


class Pair(Component):
    """Two free bodies and something between them."""

    one: BodyShape = part()
    two: BodyShape = part()
    between: Any = part()

    def build(self) -> None:
        common: dict[str, Any] = {"r": (0.3, 0.1, 0.0), "g_0": WEIGHTLESS, "I_11": 0.1, "I_22": 0.2, "I_33": 0.3}
        self.one = BodyShape(m=1.0, **common, **AT_REST)
        turned = fixed(quaternion(axis_rotation((1, 1, 0), 1.0)))
        self.two = BodyShape(m=3.0, **common, **(AT_REST | {"r_0": fixed((0.0, 1.0, 0.5)), "Q": turned}))

    def equations(self) -> Equations:
        yield connect(self.one.frame_b, self.between.frame_a)
        yield connect(self.two.frame_b, self.between.frame_b)


@pytest.mark.parametrize("resolve_in", ResolveIn)
@pytest.mark.parametrize("kind", [Force, Torque])
def test_loads_between_bodies_move_neither_momentum_nor_spin(kind: type[Component], resolve_in: ResolveIn) -> None:
    signal = {"force" if kind is Force else "torque": (1.0, -2.0, 0.5)}
    result = run(Pair(between=kind(resolve_in=resolve_in, **signal)), 1.0)
    momentum, spin = np.zeros(3), np.zeros(3)
    for name, m in (("one", 1.0), ("two", 3.0)):
        p = m * result[f"{name}.v_0"]
        momentum = momentum + p
        spin = spin + np.cross(result[f"{name}.r_0"], p) + spin_of(result, name, np.diag([0.1, 0.2, 0.3]))
    assert np.abs(result["one.w_a"]).max() > 0.5
    np.testing.assert_allclose(momentum, 0.0, atol=1e-7)
    np.testing.assert_allclose(spin, 0.0, atol=1e-7)


class Molecule(Component):
    """Two point masses on a spring: points have no orientation, and need none."""

    one: PointMass = PointMass(m=1.0, g_0=WEIGHTLESS, r_0=REST, v_0=REST)
    two: PointMass = PointMass(m=3.0, g_0=WEIGHTLESS, r_0=fixed((0.0, 0.6, 0.8)), v_0=REST)
    spring: Spring = Spring(c=12.0, s_unstretched=0.7)

    def equations(self) -> Equations:
        yield connect(self.spring.frame_a, self.one.frame_a)
        yield connect(self.spring.frame_b, self.two.frame_a)


def test_two_masses_on_a_spring_oscillate_with_their_reduced_mass() -> None:
    result = run(Molecule(), 3.0)
    omega = math.sqrt(12.0 / 0.75)
    np.testing.assert_allclose(result["spring.s"], 0.7 + 0.3 * np.cos(omega * result.time), atol=1e-7)
    centre = (result["one.r_0"] + 3 * result["two.r_0"]) / 4
    np.testing.assert_allclose(centre, np.broadcast_to([0.0, 0.45, 0.6], centre.shape), atol=1e-8)


class Rod(Component):
    """A point mass at the end of a rod, on a ball joint: nothing but the rod says how it is turned."""

    world: World = part()
    joint: Spherical = Spherical()
    rod: FixedTranslation = FixedTranslation(r=(1.0, 0.0, 0.0))
    load: PointMass = PointMass(m=1.0)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.joint.frame_a)
        yield connect(self.joint.frame_b, self.rod.frame_a)
        yield connect(self.rod.frame_b, self.load.frame_a)


class Twisted(Component):
    """A torque on a point mass."""

    load: PointMass = PointMass(m=1.0, r_0=REST, v_0=REST)
    torque: WorldTorque = WorldTorque(torque=(0.0, 0.1, 0.0))

    def equations(self) -> Equations:
        yield connect(self.load.frame_a, self.torque.frame_b)


class Thrust(Component):
    """Two point masses in space with a rod between them, pushed by 1e12 N along the rod, which nothing turns."""

    one: PointMass = PointMass(m=1e12, g_0=WEIGHTLESS, r_0=REST, v_0=REST)
    rod: FixedTranslation = FixedTranslation(r=(0.3, 0.7, 0.19))
    two: PointMass = PointMass(m=1e12, g_0=WEIGHTLESS)
    push: FrameForce = FrameForce(force=(0.3e12, 0.7e12, 0.19e12))

    def equations(self) -> Equations:
        yield connect(self.one.frame_a, self.rod.frame_a)
        yield connect(self.rod.frame_b, self.two.frame_a, self.push.frame_b)


def test_rounding_of_a_torque_is_relative_to_the_forces() -> None:
    """x'' = F / (2 m); the torque of such a force is zero to rounding only, 1e-4 N.m."""
    result = run(Thrust(), 1.0)
    np.testing.assert_allclose(result.final("one.r_0"), np.array([0.3, 0.7, 0.19]) / 4, rtol=1e-9)


MICROSCOPIC: dict[str, Any] = {
    "rod": FixedTranslation(r=(1e-4, 0.0, 0.0)),
    "load": PointMass(m=1e-9),
}


@pytest.mark.parametrize("model", [Rod(world=World()), Rod(world=World(), **MICROSCOPIC), Twisted()])
def test_a_point_mass_takes_no_torque(model: Component) -> None:
    """The mass hung level in the air, at rest, held by the torque that its axes took."""
    with pytest.raises(EventError, match="a point mass has no rotational inertia"):
        acausal.simulate(model, stop_time=1.0)


def test_a_rod_turns_where_a_body_or_a_joint_says_how() -> None:
    """A uniform force at one end of a dumbbell of two masses m: w' = F / (m l), the centre moves by F / (2 m)."""

    class Dumbbell(Component):
        world: World = World(g=0.0)
        one: Body = Body(m=1.0, r_0=REST, v_0=REST, w_a=REST, Q=UPRIGHT, I_11=1e-9, I_22=1e-9, I_33=1e-9)
        rod: FixedTranslation = FixedTranslation(r=(1.0, 0.0, 0.0))
        two: PointMass = PointMass(m=1.0)
        push: FrameForce = FrameForce(force=(0.0, 1.0, 0.0))

        def equations(self) -> Equations:
            yield connect(self.one.frame_a, self.rod.frame_a)
            yield connect(self.rod.frame_b, self.two.frame_a, self.push.frame_b)

    result = run(Dumbbell(), 0.5)
    assert result.final("one.w_a[2]") == pytest.approx(0.5, rel=1e-6)


class OnABallJoint(Component):
    """A body turns about a point beside its centre of mass."""

    world: World = World()
    ball: Spherical = Spherical()
    body: Body = part()
    across: float = structural(default=0.0)

    def build(self) -> None:
        self.body = Body(
            m=2.0, r_CM=(0.3, self.across, 0.0), I_11=0.02, I_22=0.03, I_33=0.04, Q=UPRIGHT, w_a=fixed((1.0, 2.0, 3.0))
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.ball.frame_a)
        yield connect(self.ball.frame_b, self.body.frame_a)


@pytest.mark.parametrize("across", [0.3 - 0.2 - 0.1, 1e-15, 1e-12])
def test_an_arm_of_rounding_errors_is_none(across: float) -> None:
    """Newton's law for the centre of mass, m a = f + m g; nothing may be divided by an arm of -2.8e-17 m."""
    result = run(OnABallJoint(across=across), 0.5)
    exact = run(OnABallJoint(), 0.5)
    for k in range(3):
        name = f"ball.frame_b.f[{k}]"
        assert np.abs(result[name] - exact[name]).max() < 1e-9 * np.abs(exact[name]).max()
    R, f, w, z = (
        np.moveaxis(np.array([[result[f"body.frame_a.R[{i},{j}]"] for j in range(3)] for i in range(3)]), 2, 0),
        np.array([result[f"ball.frame_b.f[{i}]"] for i in range(3)]).T,
        np.array([result[f"body.w_a[{i}]"] for i in range(3)]).T,
        np.array([result[f"body.z_a[{i}]"] for i in range(3)]).T,
    )
    arm = np.array([0.3, across, 0.0])
    of_centre = np.cross(z, arm) + np.cross(w, np.cross(w, arm))
    weight = np.einsum("tji,j->ti", R, 2.0 * np.array([0.0, -G, 0.0]))
    assert np.abs(2.0 * of_centre + f - weight).max() < 1e-9 * np.abs(f).max()


def test_an_arm_that_shrinks_after_compiling_is_refused_or_compiled_anew() -> None:
    """Forces are continuous in the arm. Pivots chosen for 0.2 m divide by it: at 1e-15 m they were 2e-3 off."""
    forget()  # pivots that were chosen for a shorter arm are good for this one, too
    exact, long = run(OnABallJoint(), 0.1), acausal.compile(OnABallJoint(across=0.2))
    short = run(OnABallJoint(across=1e-12), 0.1)
    for k in range(3):
        name = f"ball.frame_b.f[{k}]"
        assert np.abs(short[name] - exact[name]).max() < 1e-9 * np.abs(exact[name]).max()
    acausal.simulate(long, parameters={"body.r_CM": (0.3, 0.01, 0.0)}, stop_time=0.1)
    values = {"body.r_CM": (0.3, 1e-12, 0.0)}
    for verb in (acausal.simulate, acausal.linearize):
        with fails_with(AcausalError, "AC029", match="other pivots"):
            verb(long, parameters=values)


class Welded(Component):
    """Two bodies that are one rigid body; the second is turned against the first by half a radian."""

    first: Body = Body(m=1.0, **AT_REST)
    second: Body = Body(m=1.0)
    weld: FixedRotation = FixedRotation(R_rel=axis_rotation((0, 0, 1), 0.5))

    def equations(self) -> Equations:
        yield connect(self.first.frame_a, self.weld.frame_a)
        yield connect(self.weld.frame_b, self.second.frame_a)


def test_an_orientation_is_given_to_a_body_that_has_one_of_its_own() -> None:
    """The start of the second body contradicts that of the first by the half radian between them."""
    assert run(Welded(), 0.1).final("second.frame_a.R[1,0]") == pytest.approx(math.sin(0.5))
    with fails_with(AcausalError, "AC130", "second", "Q is given"):
        run(Welded(second=Body(m=1.0, Q=UPRIGHT)), 0.1)
