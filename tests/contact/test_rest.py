"""Bodies on the ground: rest, creep, slip, roll, bounce; and where their energy goes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal.library.contact import Coulomb, HuntCrossley, KelvinVoigt, LuGre, Sphere, Stribeck
from tests.contact.scenes import FIRM, G, OnGround


def test_a_box_on_the_ground_stays_for_100_s() -> None:
    """Four corners carry m g: depth m g / (4 k); nothing else moves."""
    r = acausal.simulate(OnGround(), stop_time=100.0, tolerance=1e-8, solver="rosenbrock")
    assert r.final("contact.depth") == pytest.approx(G / 4e5, rel=1e-6)
    np.testing.assert_allclose(r.final("body.r_0"), [0.0, 0.0, 0.05 - G / 4e5], atol=1e-9)
    np.testing.assert_allclose(r["body.Q"][-1], [0.0, 0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.slow
def test_a_box_on_a_slope_creeps_as_its_law_says() -> None:
    """Regularised Coulomb friction holds q of what it can at v_s atanh(q): the closed form of the law."""
    mu, v_s, share = 0.5, 1e-6, 0.8
    r = acausal.simulate(
        OnGround(friction=Coulomb(mu=mu, v_s=v_s)),
        stop_time=100.0,
        tolerance=1e-8,
        solver="rosenbrock",
        parameters={"sideways": share * mu},
    )
    creep = v_s * math.atanh(share)
    assert r.final("body.v_0[0]") == pytest.approx(creep, rel=1e-4)
    # while it settles, corners bear unequal loads
    assert r.final("body.r_0[0]") == pytest.approx(100.0 * creep, abs=5 * creep + 2e-5)


@pytest.mark.slow
def test_bristles_hold_without_creep() -> None:
    """LuGre at rest: z = q / s_0 for the share q of the normal force, and no velocity."""
    r = acausal.simulate(
        OnGround(friction=LuGre(mu=0.5, mu_s=0.6)),
        stop_time=20.0,
        tolerance=1e-7,
        solver="rosenbrock",
        parameters={"sideways": 0.2},
    )
    assert np.abs(r.final("body.v_0[0]")) < 1e-9
    assert r.final("contact.bristle[0]") == pytest.approx(0.2 / 1e5, rel=1e-3)
    assert np.ptp(np.asarray(r.at([10.0, 20.0], "body.r_0[0]"))) < 1e-8


def test_a_box_slides_as_far_as_friction_lets_it() -> None:
    """From v_0 it stops after v_0 / (mu g), v_0**2 / (2 mu g) away; the start is at rest on its corners."""
    r = acausal.simulate(
        OnGround(friction=Coulomb(mu=0.2, v_s=1e-4)),
        stop_time=0.6,
        tolerance=1e-5,
        solver="rosenbrock",
        parameters={"v_x": 1.0, "height": 0.05 - G / 4e5},
    )
    assert r.final("body.r_0[0]") == pytest.approx(1.0 / (2 * 0.2 * G), rel=5e-3)
    assert np.abs(r.final("body.v_0[0]")) < 1e-6


def test_a_ball_that_slides_begins_to_roll() -> None:
    """A solid ball thrown without spin rolls with 5/7 of its velocity, whatever the friction."""
    radius = 0.05
    r = acausal.simulate(
        OnGround(shape=Sphere(radius), friction=Coulomb(mu=0.3, v_s=1e-4)),
        stop_time=0.6,
        tolerance=1e-6,
        solver="rosenbrock",
        parameters={"v_x": 1.0, "height": radius - G / 1e5, "inertia": 0.4 * radius**2},
    )
    assert r.final("body.v_0[0]") == pytest.approx(5 / 7, rel=1e-3)
    assert r.final("body.w_a[1]") * radius == pytest.approx(5 / 7, rel=1e-3)


def test_stribeck_falls_from_the_static_to_the_sliding_coefficient() -> None:
    law = Stribeck(mu=0.3, mu_s=0.5, v_st=1e-2, mu_v=0.1, v_s=1e-4)

    class Probe(acausal.Component):
        v: acausal.Real = acausal.parameter(default=1.0, unit="m/s")
        mu: acausal.Real = acausal.variable(unit="1")

        def equations(self) -> acausal.Equations:
            yield self.mu == law.drag(self.v) * self.v

    for v in (1e-3, 1e-2, 0.5):
        value = acausal.simulate(Probe(), stop_time=1.0, parameters={"v": v}).final("mu")
        sliding = 0.3 + 0.2 * math.exp(-((v / 1e-2) ** 2))
        assert value == pytest.approx(sliding * math.tanh(v / 1e-4) + 0.1 * v, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "friction"),
    [
        (HuntCrossley(k=1e7, n=1.5, e=0.7, v_0=0.5), Stribeck(mu=0.2, mu_s=0.4)),
        (FIRM, LuGre(mu=0.3, mu_s=0.4, s_0=1e4)),
    ],
)
def test_the_energy_of_a_tumbling_box_is_accounted_for(law: HuntCrossley, friction: Coulomb) -> None:
    """Work of gravity = friction + damping + stored + kinetic, to 1e-6 of the work."""
    r = acausal.simulate(
        OnGround(law=law, friction=friction),
        stop_time=0.25,
        tolerance=1e-9,
        solver="rosenbrock",
        parameters={"height": 0.12, "v_x": 0.5, "w_y": 6.0},
    )
    spent = r["balance.W_friction"][-1] + r["balance.W_damping"][-1]
    assert spent > 0.05
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()


def test_the_energy_of_a_ball_that_jumps_is_accounted_for() -> None:
    """Kelvin-Voigt: the force jumps at touch, and what is stored at the release is lost."""
    r = acausal.simulate(
        OnGround(shape=Sphere(0.05), law=KelvinVoigt(k=1e5, d=50.0), friction=Coulomb(mu=0.3)),
        stop_time=0.15,  # it touches at 0.092 s
        tolerance=1e-8,
        solver="idas",
        parameters={"height": 0.0912, "v_x": 0.5, "w_y": 6.0},
    )
    assert r["contact.F_N"].min() >= -1e-9
    assert r["balance.W_damping"][-1] > 0.01
    assert np.abs(r["balance.residual"]).max() < 1e-6 * np.abs(r["balance.W_source"]).max()
