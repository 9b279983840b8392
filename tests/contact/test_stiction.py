"""Friction that sticks exactly, as a mode: on a slope, under a push that grows, when sliding ends, when landing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, connect, fixed, maximum, part, quantity, structural, time
from acausal.library.contact import Box, FrictionLaw, HalfSpace, Hybrid, KelvinVoigt, LuGre, Sphere, SurfaceContact
from acausal.library.multibody import Body, Fixed, Prismatic, Revolute, World, WorldForce
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Speed as Drag
from tests.contact.scenes import FIRM, G, OnGround
from tests.marks import slow_but

REST = 0.05 - G / 4e5
"""Height of the box on its four corners [m]."""
STICKS: dict[str, Any] = {"solver": "rosenbrock", "tolerance": 1e-8}


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.7, 0.95])
def test_below_the_angle_of_friction_nothing_creeps(share: float) -> None:
    """A stuck contact is a spring: at rest after it was bent, by no more than rounding in 100 s.

    Near the limit the load that is there at once makes the box rock, and slip by some 0.01 mm first.
    """
    slope = {"sideways": 0.4 * share, "height": REST}
    r = acausal.simulate(OnGround(friction=Hybrid(mu=0.4)), stop_time=100.0, parameters=slope, **STICKS)
    assert share > 0.9 or set(r["contact.mode"]) == {0.0}
    assert r.final("contact.mode") == 0.0
    assert np.ptp(np.asarray(r.at([1.0, 10.0, 100.0], "body.r_0[0]"))) < 1e-12
    assert np.abs(r.final("body.v_0[0]")) < 1e-12
    assert r.final("contact.f_0[0]") == pytest.approx(0.4 * share * G, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("mu", "slope"), [(0.3, 0.36)])
def test_above_it_slides_with_the_difference(mu: float, slope: float) -> None:
    """g (sin - mu cos), here with gravity's normal part as g cos."""
    start = {"sideways": slope, "height": REST}
    r = acausal.simulate(OnGround(friction=Hybrid(mu=mu)), stop_time=1.2, parameters=start, **STICKS)
    v = np.asarray(r.at([0.8, 1.2], "body.v_0[0]"))
    assert (v[1] - v[0]) / 0.4 == pytest.approx((slope - mu) * G, rel=1e-6)


@pytest.mark.parametrize(
    ("mu", "mu_s", "solver"),
    slow_but([(0.3, None, "rosenbrock"), (0.2, 0.4, "idas")], (0.2, 0.4, "idas")),
)
def test_a_push_that_grows_breaks_it_away_at_the_limit(mu: float, mu_s: float | None, solver: str) -> None:
    """A push of 0.1 m g a second reaches mu_s m g at t = 10 mu_s; before, the friction is the push."""
    limit = mu if mu_s is None else mu_s
    r = acausal.simulate(
        OnGround(friction=Hybrid(mu=mu, mu_s=mu_s)),
        stop_time=10 * limit + 0.5,
        parameters={"ramp": 0.1, "height": REST},
        tolerance=1e-8,
        solver=solver,
    )
    first = float(r.time[np.argmax(r["contact.mode"] > 0)])
    assert first == pytest.approx(10 * limit, abs=1e-6)
    assert r.at(0.9 * first, "contact.f_0[0]") == pytest.approx(0.9 * limit * G, rel=1e-5)
    assert r.final("contact.f_0[0]") == pytest.approx(mu * G, rel=1e-6)


@pytest.mark.slow
def test_sliding_ends_at_an_instant_and_for_good() -> None:
    """v_0 / (mu g) after the start, v_0**2 / (2 mu g) away, to the bending of the springs."""
    start = {"v_x": 1.0, "height": REST}
    r = acausal.simulate(OnGround(friction=Hybrid(mu=0.3)), stop_time=3.0, parameters=start, **STICKS)
    assert r.final("contact.mode") == 0.0
    stuck = float(r.time[np.flatnonzero(r["contact.mode"] > 0)[-1]])
    assert stuck == pytest.approx(1.0 / (0.3 * G), rel=1e-3)
    assert r.final("body.r_0[0]") == pytest.approx(1.0 / (2 * 0.3 * G), rel=1e-3)
    assert np.ptp(np.asarray(r.at([1.0, 3.0], "body.r_0[0]"))) < 1e-12
    assert np.abs(r["balance.residual"]).max() < 1e-6 * 0.5


@pytest.mark.slow
def test_a_tumbling_box_keeps_its_energy_balance() -> None:
    """Landing, slipping and sticking on single corners: to 1e-6 of the work."""
    r = acausal.simulate(
        OnGround(friction=Hybrid(mu=0.3, mu_s=0.4)),
        stop_time=0.4,
        tolerance=1e-9,
        solver="rosenbrock",
        parameters={"height": 0.12, "v_x": 0.5, "w_y": 6.0},
    )
    assert {0.0, 1.0, 2.0} <= set(r["contact.mode"])
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()


TURN, RADIUS, MASS, SPRING = 6.0, 0.1, 0.1, 1e5
"""A turning table [rad/s], and on it a body at a radius [m] with a mass [kg], held by a spring per newton [1/m]."""


class TurningTable(Component):
    """A ball is pressed on a turning table with 1 N, on a guide that lets it move outwards, and is held by friction."""

    law: FrictionLaw = structural(default=Hybrid(mu=0.6, s_0=SPRING))
    world: World = World(g=0.0)
    axle: Revolute = Revolute(n=(0.0, 0.0, 1.0), phi=fixed(0.0))
    speed: Speed = Speed(w_ref=TURN)
    guide: Prismatic = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(RADIUS), v=fixed(0.0))
    ball: Body = Body(m=MASS)
    contact: SurfaceContact = part()

    def build(self) -> None:
        self.contact = SurfaceContact(
            shape_a=Sphere(0.01),
            shape_b=HalfSpace(),
            pose_b=((0.0, 0.0, 1e-4 - 0.01), IDENTITY),
            law=KelvinVoigt(k=1e4),
            friction=self.law,
        )

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.axle.frame_a)
        yield connect(self.axle.frame_b, self.guide.frame_a, self.contact.frame_b)
        yield connect(self.guide.frame_b, self.ball.frame_a, self.contact.frame_a)
        yield connect(self.speed.flange, self.axle.axis)


@pytest.mark.parametrize(
    "law", [Hybrid(mu=0.6, s_0=SPRING), LuGre(mu=0.6, mu_s=0.7, s_0=SPRING)], ids=["hybrid", "lugre"]
)
def test_what_sticks_to_a_turning_table_turns_with_it(law: FrictionLaw) -> None:
    """The centrifugal force is a constant load on the table, m w**2 r per newton, which bends the spring once."""
    r = acausal.simulate(TurningTable(law=law), stop_time=0.5, tolerance=1e-7, solver="idas")
    bent = MASS * TURN**2 * RADIUS / SPRING
    away = r["guide.s"] - RADIUS
    assert float(r.at(0.5, "guide.s")) - float(r.at(0.4, "guide.s")) == pytest.approx(0.0, abs=1e-3 * bent)
    if isinstance(law, Hybrid):
        assert float(away[-1]) == pytest.approx(bent, rel=1e-3)
    z = r["contact.bristle"][-1] @ np.array([np.cos(0.5 * TURN), np.sin(0.5 * TURN), 0.0])
    assert float(z) == pytest.approx(bent, rel=1e-3)


DRAGGED = 9e-5
"""Velocity [m/s] at which a body is dragged, below that of slow sliding."""


class DraggedAndPushed(Component):
    """A ball that slides slowly along x, and that a force along y pushes more and more."""

    world: World = World(n=(0.0, 0.0, -1.0))
    along: Prismatic = Prismatic(n=(1.0, 0.0, 0.0), s=fixed(0.0))
    drag: Drag = Drag(v_ref=DRAGGED)
    across: Prismatic = Prismatic(n=(0.0, 1.0, 0.0), s=fixed(0.0), v=fixed(0.0))
    down: Prismatic = Prismatic(n=(0.0, 0.0, 1.0), s=fixed(0.05 - G / 1e5), v=fixed(0.0))
    ball: Body = Body(m=1.0)
    push: WorldForce = WorldForce()
    ground: Fixed = Fixed()
    contact: SurfaceContact = part()

    def build(self) -> None:
        law, friction = KelvinVoigt(k=1e5), Hybrid(mu=0.5, v_s=1e-4)
        self.contact = SurfaceContact(shape_a=Sphere(0.05), shape_b=HalfSpace(), law=law, friction=friction)

    def equations(self) -> Equations:
        yield connect(self.drag.flange, self.along.axis)
        yield connect(self.world.frame_b, self.along.frame_a)
        yield connect(self.along.frame_b, self.across.frame_a)
        yield connect(self.across.frame_b, self.down.frame_a)
        yield connect(self.down.frame_b, self.ball.frame_a, self.push.frame_b, self.contact.frame_a)
        yield connect(self.ground.frame_b, self.contact.frame_b)
        yield self.push.force == (0.0, quantity(20.0, "N/s") * maximum(time - quantity(0.4, "s"), 0.0), 0.0)


def test_slow_sliding_resists_a_push_across_it() -> None:
    """Friction points against the velocity: a push across of q mu m g gives v_y = q / sqrt(1 - q**2) v_x.

    Friction that keeps its direction along x lets the push accelerate the ball, to 0.1 m/s.
    """
    r = acausal.simulate(DraggedAndPushed(), stop_time=0.5, tolerance=1e-7)
    q = 2.0 / (0.5 * G)
    assert r.final("across.v") == pytest.approx(q / np.sqrt(1 - q**2) * DRAGGED, rel=0.02)


class SpinningBox(Component):
    """A box of 0.1 m and 1 kg that lies on the ground and spins on its four corners at 10 rad/s."""

    law: FrictionLaw = structural()
    world: World = World(n=(0.0, 0.0, -1.0), g=G)
    box: Body = part()
    ground: Fixed = Fixed()
    contact: SurfaceContact = part()

    def build(self) -> None:
        self.box = Body(
            m=1.0,
            I_11=1 / 600,
            I_22=1 / 600,
            I_33=1 / 600,
            r_0=fixed((0.0, 0.0, REST)),
            v_0=fixed((0.0, 0.0, 0.0)),
            Q=fixed((0.0, 0.0, 0.0, 1.0)),
            w_a=fixed((0.0, 0.0, 10.0)),
        )
        box = Box((0.1, 0.1, 0.1))
        self.contact = SurfaceContact(shape_a=box, shape_b=HalfSpace(), law=FIRM, friction=self.law)

    def equations(self) -> Equations:
        yield connect(self.box.frame_a, self.contact.frame_a)
        yield connect(self.ground.frame_b, self.contact.frame_b)


@pytest.mark.parametrize("law", [Hybrid(mu=0.3), LuGre(mu=0.3, mu_s=0.3)], ids=["hybrid", "lugre"])
def test_a_spin_on_four_corners_is_braked_by_friction(law: FrictionLaw) -> None:
    """mu m g times the distance of the corners, over the inertia: the mean slip of such a spin is zero."""
    r = acausal.simulate(SpinningBox(law=law), stop_time=0.02, tolerance=1e-6, solver="rosenbrock")
    braked = 0.3 * G * 0.1 * np.sqrt(0.5) * 600 * 0.02
    assert r.final("box.w_a[2]") == pytest.approx(10.0 - braked, rel=5e-3)
