"""Contact scenes: which pairs are in the equations, and that it makes no difference to the result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import (
    Component,
    Equations,
    Real,
    connect,
    fixed,
    initial,
    integer,
    parameter,
    part,
    pre,
    reset,
    sample,
    structural,
    terminal,
    terminate,
    when,
)
from acausal.errors import DeclarationError
from acausal.library.contact import (
    Box,
    ContactBody,
    ContactScene,
    Coulomb,
    HuntCrossley,
    Sphere,
    Surfaces,
)
from acausal.library.multibody import Body, World, WorldForce
from acausal.library.multibody.orientation import IDENTITY
from acausal.models.contact_scenes import BoxStack
from tests.cli.running import run
from tests.contact.scenes import G
from tests.expected import fails_with

LAWS = Surfaces(law=HuntCrossley(k=1e4, n=1.0, e=0.7, v_0=0.4), friction=Coulomb(mu=0.3, v_s=1e-2))


def plate(name: str, x: float, z: float = 0.0) -> ContactBody:
    return ContactBody(name=name, shape=Box((0.1, 0.2, 0.02)), pose=((x, 0.0, z - 0.01), IDENTITY), at_rest=True)


class ThrownBall(Component):
    """A ball thrown over a row of plates at rest."""

    n: int = structural(default=16)
    keep: int = structural(default=1000)
    v: Real = parameter(default=1.0, unit="m/s")
    ball: Body = part()
    scene: ContactScene = part()

    def build(self) -> None:
        self.ball = Body(
            m=0.1,
            I_11=1.6e-5,
            I_22=1.6e-5,
            I_33=1.6e-5,
            g_0=(0.0, 0.0, -G),
            Q=fixed((0.0, 0.0, 0.0, 1.0)),
            w_a=fixed((0.0, 0.0, 0.0)),
            r_0=fixed((0.0, 0.0, 0.03)),
            v_0=fixed((self.v, 0.0, 0.0)),
        )
        plates = (plate(f"plate{k}", 0.13 * k) for k in range(self.n))
        ball = ContactBody(name="ball", shape=Sphere(0.02))
        self.scene = ContactScene(bodies=(ball, *plates), surfaces=LAWS, keep=self.keep, skin=0.1)

    def equations(self) -> Equations:
        yield connect(self.ball.frame_a, self.scene.frame("ball"))


class Clocked(Component):
    """The throw beside counters of what must happen once, at a clock of 30 ms, and an end at a height."""

    low: Real = parameter(default=-1.0, unit="m")
    throw: ThrownBall = part()
    ticks: Real = integer()
    starts: Real = integer()
    ends: Real = integer()

    def build(self) -> None:
        self.throw = ThrownBall(keep=2)

    def equations(self) -> Equations:
        yield when(sample(0.0, 0.03), reset(self.ticks, pre(self.ticks) + 1))
        yield when(initial(), reset(self.starts, pre(self.starts) + 1))
        yield when(terminal(), reset(self.ends, pre(self.ends) + 1))
        yield when(self.throw.ball.r_0[2] < self.low, terminate("low"))


@pytest.mark.parametrize("solver", [pytest.param("idas", marks=pytest.mark.slow), "rosenbrock"])
def test_what_happens_once_happens_once_over_all_structures(solver: str) -> None:
    """From 0 to 0.3 s a clock of 30 ms ticks 11 times."""
    r = acausal.simulate(Clocked(), stop_time=0.3, solver=solver)
    assert int(str(r.stats["structures"])) > 1
    assert (r.final("ticks"), r.final("starts"), r.final("ends")) == (11, 1, 1)


def test_an_end_that_the_model_asks_for_ends_all_structures() -> None:
    """The ball starts 10 mm above the plates and bounces: 5 mm lower it is after sqrt(2 * 5 mm / G)."""
    r = acausal.simulate(Clocked(low=0.025), stop_time=0.6, tolerance=1e-8, solver="rosenbrock")
    assert r.time[-1] == pytest.approx(np.sqrt(2 * 0.005 / G), abs=1e-7)
    assert r.stats["terminated"] == "low"


@pytest.mark.slow
def test_pairs_that_come_and_go_make_no_difference() -> None:
    """The same throw with all pairs in the equations, and with those near the ball only."""
    model = ThrownBall(keep=2)
    whole, near = (
        acausal.simulate(m, stop_time=0.6, tolerance=1e-8, solver="rosenbrock") for m in (ThrownBall(), model)
    )
    assert int(str(near.stats["structures"])) > 3
    assert near.stats["reports"]["scene"].count("ball - plate") <= 4  # type: ignore[index]
    assert len(model.scene.report().kept) == model.n
    np.testing.assert_allclose(near.final("ball.r_0"), whole.final("ball.r_0"), atol=2e-6)
    np.testing.assert_allclose(near.final("ball.w_a"), whole.final("ball.w_a"), atol=2e-4)
    force = np.nansum([near[n] for n in near.names if n.endswith(".F_N")], axis=0)
    assert force.max() > 1.0
    assert np.isnan(near["scene.contacts[ball,plate0].F_N"][-1])


def test_the_cost_does_not_grow_with_what_is_far_away() -> None:
    """Steps and equations of 10 and of 100 plates are the same while the ball is over the first two."""
    runs = [
        acausal.simulate(ThrownBall(n=n, keep=2), stop_time=0.1, tolerance=1e-8, solver="rosenbrock") for n in (10, 100)
    ]
    assert runs[0].stats["steps"] == runs[1].stats["steps"]
    assert runs[0].stats["structures"] == runs[1].stats["structures"]
    assert runs[0].final("ball.r_0[0]") == runs[1].final("ball.r_0[0]")


@pytest.mark.slow
def test_a_stack_of_five_boxes_stands() -> None:
    """15 possible pairs, of which 5 touch; each carries the boxes above it."""
    model = BoxStack()
    r = acausal.simulate(model, stop_time=0.4)
    report: Any = r.stats["reports"]
    kept = {
        frozenset(line.split("   ")[0].strip().split(" - ")) for line in report["scene"].splitlines() if " - " in line
    }
    assert kept == {frozenset(p) for p in [("ground", "box0"), *((f"box{k}", f"box{k + 1}") for k in range(4))]}
    for k in range(5):
        below = "ground,box0" if k == 0 else f"box{k - 1},box{k}"
        assert r.final(f"scene.contacts[{below}].F_N") == pytest.approx((5 - k) * 9.80665, rel=1e-3)
        x, y, z = np.asarray(r.final(f"boxes[{k}].r_0"))
        assert abs(x - 2e-3 * (k % 2)) < 1e-4
        assert abs(y) < 1e-4
        assert z == pytest.approx(0.05 + 0.1 * k, abs=1e-3)
        assert np.abs(r.final(f"boxes[{k}].v_0")).max() < 1e-4
    # over all structures of the run: what gravity gave is stored, damped or rubbed
    assert np.abs(r["balance.residual"]).max() < 1e-6 * r["balance.W_source"].max()


def test_the_report_says_why() -> None:
    near = ((-0.1, -0.1, 0.0), (0.1, 0.1, 0.1))
    scene = ContactScene(
        bodies=(
            ContactBody(name="ball", shape=Sphere(0.02), reach=near, group="hand"),
            ContactBody(name="finger", shape=Sphere(0.01), group="hand"),
            plate("table", 0.0),
            plate("shelf", 0.0, z=1.0),
        ),
        surfaces=LAWS,
    )
    report = scene.report()
    assert [k[:2] for k in report.kept] == [("ball", "table"), ("finger", "table"), ("finger", "shelf")]
    assert {d.reason: d.count for d in report.dropped} == {
        "both at rest": 1,
        "in one group": 1,
        "never within reach of each other": 1,
    }
    assert repr(report).startswith("4 bodies, 6 pairs: 3 in the equations\n  ball - table   closed form")


class Refused(Component):
    bodies: tuple[ContactBody, ...] = structural()
    surfaces: Surfaces = structural(default=LAWS)
    world: World = part()
    scene: ContactScene = part()

    def build(self) -> None:
        self.world = World()
        self.scene = ContactScene(bodies=self.bodies, surfaces=self.surfaces)


@pytest.mark.parametrize(
    ("bodies", "surfaces", "code", "named"),
    [
        ((ContactBody(name="lid", shape=Box((0.1, 0.1, 0.0))),), LAWS, "AC174", "lid"),
        ((plate("a", 0.0), plate("a", 1.0)), LAWS, "AC172", "'a'"),
        ((ContactBody(name="ball", shape=Sphere(0.02)), plate("table", 0.0)), Surfaces(), "AC171", "ball and table"),
    ],
)
def test_bad_scenes_are_refused_with_the_name_of_the_body(
    bodies: tuple[ContactBody, ...], surfaces: Surfaces, code: str, named: str
) -> None:
    with fails_with(DeclarationError, code) as caught:
        Refused(bodies=bodies, surfaces=surfaces)
    assert named in str(caught.value)


def test_a_body_that_is_not_registered_is_not_found() -> None:
    scene = ContactScene(bodies=(ContactBody(name="ball", shape=Sphere(0.02)), plate("table", 0.0)), surfaces=LAWS)
    with pytest.raises(DeclarationError, match="the scene has no moving body 'table'"):
        scene.frame("table")


def test_a_scene_without_bodies_is_no_contact() -> None:
    """As a loop that registers what there is may leave it."""
    scene = ContactScene(bodies=())
    assert repr(scene.report()).startswith("0 bodies, 0 pairs: 0 in the equations")
    assert acausal.simulate(scene, stop_time=1.0).final("energy") == 0.0


class Blown(ThrownBall):
    """The same ball in the wind."""

    wind: WorldForce = part()

    def build(self) -> None:
        super().build()
        self.wind = WorldForce()

    def equations(self) -> Equations:
        yield connect(self.ball.frame_a, self.wind.frame_b)


@pytest.mark.slow
def test_inputs_over_time_and_starts_go_through_changes_of_structure() -> None:
    """With pairs that come and go as with all of them; 28 mm above the plates instead of the declared 30."""
    wind = {"wind.force[0]": lambda t: 0.3 * np.sin(20.0 * t), "wind.force[1]": 0.0, "wind.force[2]": 0.0}
    near, whole = (
        acausal.simulate(
            acausal.free(model, "wind.force"),
            inputs=wind,
            start={"ball.r_0": (0.0, 0.0, 0.028)},
            stop_time=0.15,
            tolerance=1e-7,
            solver="rosenbrock",
        )
        for model in (Blown(keep=2, n=4), Blown(n=4))
    )
    assert int(str(near.stats["structures"])) > 1
    assert near["ball.r_0"][0].tolist() == [0.0, 0.0, 0.028]
    np.testing.assert_allclose(near.final("ball.r_0"), whole.final("ball.r_0"), atol=1e-6)


@pytest.mark.slow
def test_the_command_line_runs_a_scene_in_pieces(tmp_path: Path) -> None:
    picture = tmp_path / "holes.png"
    done = run("simulate", "HolesSideBySide", "--set", "n=3", "--json", "--no-output", "--plot-file", picture)
    assert done.code == 0, done.err
    assert done.json["stats"]["structures"] > 2
    assert picture.stat().st_size > 10_000


def test_stats_tell_the_pairs_of_a_scene(tmp_path: Path) -> None:
    done = run("simulate", "StackedPlates", "--stop-time", "0.1", "--no-output", "--stats")
    assert done.code == 0, done.err
    assert "4 bodies, 6 pairs: 2 in the equations" in done.out
    assert "drill - upper   drilling" in done.out
