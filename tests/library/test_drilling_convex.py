"""The drill against convex workpieces, and drilling in contact scenes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, parameter, part, quantity, structural, time
from acausal.errors import DeclarationError, EventError
from acausal.library.blocks import TimeTable
from acausal.library.contact import Box, ConvexHull, Cylinder, HalfSpace, Shape, Sphere
from acausal.library.drilling import (
    TWIST_DRILL_16MM,
    ConvexDrillGeometry,
    ConvexLevel,
    DrillGeometry,
    DrillingForce,
)
from acausal.library.multibody import FixedRotation, Prismatic, World, axis_rotation
from acausal.library.multibody.orientation import IDENTITY, Rotation, Vector
from acausal.library.translational import Position
from acausal.models.contact_scenes import HolesSideBySide, StackedPlates
from acausal.models.drilling_dynamic import ThickBlock
from tests.expected import fails_with
from tests.marks import slow_but

UP = (0.0, 0.0, 1.0)
PLATE = Box((0.1, 0.1, 0.01))
MIDDLE = ((0.0, 0.0, 0.005), IDENTITY)


class Probe(Component):
    """A drill that moves along its own tilted axis through a plate and through a solid of any shape.

    Its tip passes the origin of the world at 1 s, shifted by `x`.
    """

    solid: Shape = structural(default=PLATE)
    pose: tuple[Vector, Rotation] = structural(default=MIDDLE)
    tilt: float = structural(default=0.0)
    x: Real = parameter(default=0.0, unit="m")
    v: Real = parameter(default=0.02, unit="m/s")
    world: World = World()
    holder: FixedRotation = part()
    slide: Prismatic = Prismatic(n=UP)
    drive: Position = part()
    plate: DrillGeometry = part()
    convex: ConvexDrillGeometry = part()

    def build(self) -> None:
        self.holder = FixedRotation(r=(self.x, 0.0, 0.0), R_rel=axis_rotation((0.0, 1.0, 0.0), self.tilt))
        self.drive = Position(s_ref=self.v * time - quantity(20.0, "mm"))
        tool = TWIST_DRILL_16MM
        self.plate = DrillGeometry(d=tool.d, sigma=tool.sigma, t=0.01)
        self.convex = ConvexDrillGeometry(d=tool.d, sigma=tool.sigma, workpiece=self.solid, pose=self.pose)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.holder.frame_a, self.plate.frame_w, self.convex.frame_w)
        yield connect(self.holder.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.plate.frame_a, self.convex.frame_a)
        yield connect(self.drive.flange, self.slide.axis)


def probe(
    *, x: float = 0.0, solid: Shape = PLATE, pose: tuple[Vector, Rotation] = MIDDLE, tilt: float = 0.0
) -> acausal.Result:
    """The run of a probe until its tip is 28 mm deep."""
    return acausal.simulate(
        Probe(solid=solid, pose=pose, tilt=tilt), stop_time=2.4, output_interval=0.1, parameters={"x": x}
    )


@pytest.mark.parametrize(
    ("x", "tilt"),
    slow_but([(0.0, 0.0), (-0.035, 5.0), (0.0, 20.0), (0.02, 20.0)], (0.0, 0.0), (-0.035, 5.0)),
)
def test_a_box_is_the_plate(tilt: float, x: float) -> None:
    """Through the plate and out of it, at any place and up to 20 degrees: the levels agree to rounding."""
    r = probe(tilt=math.radians(tilt), x=x)
    for name in ("s", "v", "d_O", "d_I"):
        np.testing.assert_allclose(r[f"convex.{name}"], r[f"plate.{name}"], atol=1e-12)
    assert r["convex.d_I"].max() == pytest.approx(0.016)


@pytest.mark.slow
def test_the_corners_of_a_box_are_the_box() -> None:
    corners = [(x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (0.0, 0.01)]
    r = probe(solid=ConvexHull(corners), pose=((0.0, 0.0, 0.0), IDENTITY), tilt=math.radians(12.0), x=0.01)
    np.testing.assert_allclose(r["convex.s"], r["plate.s"], atol=1e-12)
    np.testing.assert_allclose(r["convex.d_I"], r["plate.d_I"], atol=1e-12)


@pytest.mark.parametrize(
    "case", slow_but(["ball", "beside ball", "bar across", "bar along"], "beside ball", "bar across")
)
def test_round_workpieces_are_entered_where_the_axis_meets_them(case: str) -> None:
    """Closed forms: a line through the middle of a ball, and beside it; a bar across, and along its axis."""
    radius, x = 0.01, 0.006
    below = ((0.0, 0.0, radius), IDENTITY)
    across = ((0.0, 0.0, radius), axis_rotation((0.0, 1.0, 0.0), math.pi / 2))
    chord = math.sqrt(radius**2 - x**2)
    cases: dict[str, tuple[Shape, tuple[Vector, Rotation], float, float, float]] = {
        "ball": (Sphere(radius), below, 0.0, 2 * radius, 0.0),
        "beside ball": (Sphere(radius), below, x, 2 * chord, radius - chord),
        "bar across": (Cylinder(radius, 0.1), across, 0.0, 2 * radius, 0.0),
        "bar along": (Cylinder(radius, 0.02), below, 0.005, 0.02, 0.0),
    }
    solid, pose, shift, thickness, start = cases[case]
    r = probe(solid=solid, pose=pose, x=shift)
    tip = r["slide.s"]
    np.testing.assert_allclose(r["convex.s"], tip - start, atol=1e-9)
    np.testing.assert_allclose(r["convex.s_exit"], np.minimum(tip - start - thickness, r["convex.s"]), atol=1e-9)


def test_a_drill_beside_the_workpiece_is_not_in_contact() -> None:
    for solid, pose in ((Sphere(0.01), ((0.0, 0.0, 0.01), IDENTITY)), (PLATE, MIDDLE)):
        r = probe(solid=solid, pose=pose, x=0.06)
        assert r["convex.s"].max() <= 0.0
        assert r["convex.d_O"].max() == 0.0


def test_mpr_tells_overlap_and_normal() -> None:
    """A tip 4 mm below the face of a thick block overlaps by 4 mm, and the normal points into it."""
    r = probe(solid=HalfSpace(), pose=((0.0, 0.0, 0.0), axis_rotation((1.0, 0.0, 0.0), math.pi)))
    k = int(np.argmin(np.abs(r["slide.s"] - 4e-3)))
    assert r["convex.overlap"][k] == pytest.approx(r["slide.s"][k], abs=1e-9)
    np.testing.assert_allclose(r["convex.normal"][k], UP, atol=1e-9)


class SolidBlock(ThickBlock):
    """`ThickBlock` with the block as a convex body."""

    def build(self) -> None:
        super().build()
        block = ConvexLevel(Box((0.1, 0.1, 0.05)), ((0.0, 0.0, 0.025), IDENTITY), "block")
        self.drill = DrillingForce(level=block, t=0.05, axis_a=UP, k=1e8, d_c=2e4)


@pytest.mark.slow
def test_the_levels_agree_in_the_dynamic_scene() -> None:
    """The depths differ by at most 1e-7 m, and neither takes more steps than the other by a tenth."""
    plate, solid = acausal.simulate(ThickBlock()), acausal.simulate(SolidBlock())
    times = np.linspace(0.0, 40.0, 81)
    np.testing.assert_allclose(solid.at(times, "drill.s"), plate.at(times, "drill.s"), atol=1e-7)
    np.testing.assert_allclose(solid.at(times, "drill.s_tar"), plate.at(times, "drill.s_tar"), atol=1e-7)
    assert solid.stats["steps"] < 1.1 * plate.stats["steps"]  # type: ignore[operator]


@pytest.mark.slow  # a C compiler takes 10 s for the search in the integrator
def test_the_levels_agree_in_generated_c() -> None:
    """The whole integrator as C, the search of MPR in it: through first touch, and the first seconds of drilling."""
    runs = [acausal.simulate(m(), solver="rosenbrock", native=True, stop_time=8.0) for m in (ThickBlock, SolidBlock)]
    times = np.linspace(0.0, 8.0, 41)
    np.testing.assert_allclose(runs[1].at(times, "drill.s"), runs[0].at(times, "drill.s"), atol=1e-7)


@pytest.mark.slow
def test_stacked_plates_account_for_all_work() -> None:
    """A plate that gives way, a gap, two cuts: the residual of the energy is 1e-6 of the work or less."""
    r = acausal.simulate(StackedPlates(), stop_time=18.0, tolerance=1e-8)
    assert r.final("guide.s") > 5e-4
    assert r.final("scene.contacts[1].s_tar") > 1e-3
    assert np.abs(r["balance.residual"]).max() < 1e-6 * r.final("balance.W_source")


@pytest.mark.slow
def test_a_hole_is_found_again_and_another_one_is_new() -> None:
    r = acausal.simulate(HolesSideBySide(n=3))
    first, second = "scene.contacts[drill,plate0].s_tar", "scene.contacts[drill,plate0#1].s_tar"
    before, at_second, after = 5.2, 9.5, 10.95
    shallow = float(np.asarray(r[first])[np.searchsorted(r.time, before)])
    assert shallow == pytest.approx(3e-3, abs=6e-5)
    # the second hole begins anew, and gets as deep by the same motion
    assert np.nanmin(r[second]) == 0.0
    assert r[second][np.searchsorted(r.time, at_second)] == pytest.approx(shallow, abs=1e-8)
    # back in the first, which is as deep as it was; then deeper
    assert r[first][np.searchsorted(r.time, after)] == pytest.approx(shallow, abs=1e-12)
    assert r.final(first) == pytest.approx(6e-3, abs=1.2e-4)
    assert not any("plate1" in name for name in r.names)
    notes: tuple[str, ...] = r.stats["notes"]  # type: ignore[assignment]
    assert not any("AC192" in n for n in notes)  # the holes are 20 mm apart, and the drill has 16
    # over all structures of the run
    assert np.abs(r["balance.residual"]).max() < 1e-6 * r.final("balance.W_source")


class HolesTooNear(HolesSideBySide):
    """The second hole 6 mm beside the first."""

    def build(self) -> None:
        super().build()
        near = 6e-3
        self.across = TimeTable(table=((0.0, 0.0), (5.0, 0.0), (6.0, near), (10.0, near), (15.0, near)))


def test_holes_that_overlap_are_told() -> None:
    """The second is cut as if the first were not there: that is noted, with a code and the names."""
    notes = acausal.simulate(HolesTooNear(n=1), stop_time=10.0).stats["notes"]
    notes = [n for n in notes if n.startswith("AC192")]  # type: ignore[attr-defined]
    assert len(notes) == 1
    assert notes[0].startswith("AC192: two holes of scene.contacts[drill,plate0] overlap, 6 mm apart")


@pytest.mark.slow
def test_a_thousand_workpieces_take_the_steps_of_one() -> None:
    """Those the drill never comes near are in no equation; the time is in benchmarks/contact.py."""
    one, many = (acausal.simulate(HolesSideBySide(n=n), native=False, stop_time=10.0).stats for n in (1, 1000))
    assert many["steps"] == one["steps"]
    assert many["rhs_evaluations"] == one["rhs_evaluations"]
    assert many["states"] == one["states"]


def test_bad_workpieces_are_refused_by_name() -> None:
    with fails_with(DeclarationError, "AC174", match="lid"):
        DrillingForce(level=ConvexLevel(Box((0.1, 0.1, 0.0)), name="lid"), t=0.0, k=1e8, d_c=2e4)


def test_a_drill_that_starts_inside_is_refused() -> None:
    """Also where the pairs are found during the run: 3 mm of steel are not pressed aside."""
    with pytest.raises(EventError, match="the drill starts inside plate0") as caught:
        acausal.simulate(HolesSideBySide(n=2, out=3e-3))
    assert "drill" in str(caught.value)
