"""A drill whose cut is no full ring: its force is not known there, and the run says so.

What counts is plain geometry: a cone of point angle sigma at depth s has the radius s tan(sigma / 2), up to d / 2, and
what of it lies in the body is integrated here point by point.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull as Hull

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, structural, time
from acausal.library.blocks import TimeTable
from acausal.library.contact import Box, Capsule, Cone, ConvexHull, Cylinder, Shape, Sphere
from acausal.library.contact.collide.axis.crossing import crossing_function
from acausal.library.contact.collide.axis.edges import edge_distance_function
from acausal.library.contact.collide.axis.engaged import engaged_function
from acausal.library.drilling import (
    TWIST_DRILL_16MM,
    ConvexLevel,
    DrillingForce,
    PlateLevel,
)
from acausal.library.multibody import Prismatic, Revolute, World, axis_rotation
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Position
from acausal.lower.compiled import CompiledModel
from acausal.models.contact_scenes import HolesSideBySide
from tests.marks import slow_but

SLOPE = math.tan(TWIST_DRILL_16MM.sigma / 2)
RADIUS = TWIST_DRILL_16MM.d / 2
FEED = 2e-3
LATE = 1e-3
"""Time [s] in which a cone gets a few thousandths of a millimetre into an edge: less than that is no cut."""
CORNERS = [(x, y, z) for x in (-0.02, 0.02) for y in (-0.03, 0.03) for z in (-0.025, 0.025)]
UPRIGHT = ((0.0, 0.0, 0.025), IDENTITY)


class AtTheEdge(Component):
    """A drill that goes down at 2 mm/s from 1 mm above a face, `x` from the middle, and moves aside at `u`."""

    level: PlateLevel | ConvexLevel = structural(default=PlateLevel("plate"))
    x: Real = parameter(default=0.0, unit="m")
    u: Real = parameter(default=0.0, unit="m/s")
    world: World = World(g=0.0)
    beam: Prismatic = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: DrillingForce = part()
    across: Position = part()
    feed: Position = Position(s_ref=quantity(FEED, "m/s") * time - quantity(1.0, "mm"))
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)

    def build(self) -> None:
        up = (0.0, 0.0, 1.0)
        self.beam, self.slide = Prismatic(n=(1.0, 0.0, 0.0)), Prismatic(n=up)
        self.spindle = Revolute(n=up, phi=fixed(0.0))
        self.drill = DrillingForce(level=self.level, t=0.05, k=1e8, d_c=2e4)
        self.across = Position(s_ref=self.x + self.u * time)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.beam.frame_a, self.drill.frame_w)
        yield connect(self.beam.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.across.flange, self.beam.axis)
        yield connect(self.feed.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


def told(result: acausal.Result) -> list[float]:
    """The instants of the notes about edges."""
    notes: Any = result.stats["notes"]
    return [float(n.split()[2]) for n in notes if "AC191" in n]


@cache
def beside(level: PlateLevel | ConvexLevel) -> CompiledModel:
    """The model beside a body, compiled once for all places of the drill."""
    return acausal.compile(AtTheEdge(level=level))


def run(level: PlateLevel | ConvexLevel, x: float, u: float = 0.0, **options: Any) -> list[float]:
    options = {"stop_time": 3.5, **options}
    return told(acausal.simulate(beside(level), parameters={"x": x, "u": u}, **options))


LEVELS = (PlateLevel("plate"), ConvexLevel(Box((0.1, 0.1, 0.05)), UPRIGHT, "block"))


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
@pytest.mark.parametrize("x", [0.055, -0.052])
def test_a_drill_beside_an_edge_is_told_when_its_cone_reaches_it(level: PlateLevel | ConvexLevel, x: float) -> None:
    """5 or 2 mm beside the plate, where the force is none."""
    reached = (1e-3 + abs(abs(x) - 0.05) / SLOPE) / FEED
    assert run(level, x) == pytest.approx([reached], abs=LATE)


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
def test_nothing_is_told_where_no_edge_is_cut(level: PlateLevel | ConvexLevel) -> None:
    for x in (0.0, 0.05 - 1.01 * RADIUS, 0.05 + 1.01 * RADIUS):
        assert run(level, x) == []


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_every_solver_tells_it_on_the_way_there(solver: str) -> None:
    """From 20 mm beside the plate towards it: the cone is as wide as the gap at 2.601 s."""
    reached = (0.02 + 1e-3 * SLOPE) / (5e-3 + FEED * SLOPE)
    assert run(LEVELS[0], 0.07, -5e-3, solver=solver, output_interval=5.0) == pytest.approx([reached], abs=LATE)


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
def test_a_drill_moved_towards_the_side_of_a_body_is_told_what_will_be_wrong(level: PlateLevel | ConvexLevel) -> None:
    """9 mm deep beside the body the drill has its full radius, which meets the side before the axis does."""
    r = acausal.simulate(beside(level), parameters={"x": 0.08, "u": -4e-3}, start_time=5.0, stop_time=6.0)
    assert told(r) == pytest.approx([(0.03 - RADIUS) / 4e-3], abs=LATE)
    (note,) = [n for n in r.stats["notes"] if "AC191" in n]  # type: ignore[attr-defined]
    assert note.startswith("t = 5.5")
    for word in ("drill.geometry", f"in {level.name}", "there is no force", "move sideways"):
        assert word in note


@pytest.mark.slow
def test_compiled_runs_tell_it() -> None:
    for level in LEVELS:
        assert run(level, 0.055, solver="rosenbrock", native=True) == pytest.approx(
            [(1e-3 + 5e-3 / SLOPE) / FEED], abs=LATE
        )


@pytest.mark.parametrize(
    ("shape", "edge"),
    [
        (Sphere(0.02), 0.02),
        (Cylinder(0.02, 0.05), 0.02),
        (ConvexHull(CORNERS), 0.02),
    ],
    ids=lambda v: type(v).__name__,
)
def test_a_drill_beside_a_body_of_any_shape(shape: Shape, edge: float) -> None:
    """3 mm beside it, within the radius of 8 mm; and 9 mm beside it."""
    level = ConvexLevel(shape, UPRIGHT, "body")
    near, far = run(level, edge + 3e-3, stop_time=20.0), run(level, edge + 9e-3, stop_time=20.0)
    assert len(near) == 1
    assert far == []


def test_distances_of_lines_from_shapes_are_those_of_support_functions() -> None:
    """The largest u . tip - support(u) over directions u across the line, on a fine grid; ten lines for each shape."""
    rng = np.random.default_rng(7)
    corners = rng.normal(size=(30, 3)) * 0.02
    angles = np.linspace(0.0, 2 * math.pi, 1440)
    for shape in (
        Box((0.1, 0.06, 0.02)),
        Sphere(0.01),
        Cylinder(0.02, 0.05),
        Capsule(0.01, 0.05),
        Cone(0.02, 0.05),
        ConvexHull(corners),
    ):
        function = edge_distance_function(shape)
        for k in range(10):
            axis = np.eye(3)[2] if k == 0 else rng.normal(size=3)
            axis, tip = axis / np.linalg.norm(axis), 0.04 * rng.normal(size=3)
            one = np.cross(axis, [1.0, 0.2, 0.0])
            one /= np.linalg.norm(one)
            other = np.cross(axis, one)
            ways = [math.cos(a) * one + math.sin(a) * other for a in angles]
            expected = max(u @ tip - u @ shape.support(u) for u in ways)
            assert float(function(tip, axis)) == pytest.approx(max(expected, 0.0), abs=2e-4)


HOUSE = ConvexHull(
    [(x, y, z) for x in (-0.03, 0.03) for y, z in ((-0.03, 0.01), (0.03, 0.01), (0.0, 0.0))]
    + [(x, y, 0.03) for x in (-0.03, 0.03) for y in (-0.03, 0.03)]
)


def outside(shape: Shape, x: Any) -> Any:
    """How far points (n, 3) are outside of a shape, negative within it [m]; by the faces or the radii."""
    if isinstance(shape, ConvexHull):
        faces = Hull(np.array(shape.points)).equations
        return (x @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    if isinstance(shape, Box):
        return (np.abs(x) - shape.half).max(axis=1)
    across = np.hypot(x[:, 0], x[:, 1])
    if isinstance(shape, Sphere):
        return np.linalg.norm(x, axis=1) - shape.radius
    if isinstance(shape, Cylinder):
        return np.maximum(across - shape.radius, np.abs(x[:, 2]) - shape.length / 2)
    if isinstance(shape, Capsule):
        return np.hypot(across, np.maximum(np.abs(x[:, 2]) - shape.length / 2, 0.0)) - shape.radius
    assert isinstance(shape, Cone)
    return np.maximum(across - x[:, 2] * shape.radius / shape.length, x[:, 2] - shape.length)


def differences(shape: Shape, pose: tuple[Any, Any], x: float, r: acausal.Result) -> tuple[Any, Any]:
    """By how much width and area of the cut differ from the ring of the force: at least, and at most.

    Points of the cone's surface, at 80 radii and 72 angles, are in the body or not; the ring is that of d_O and d_I.
    Differences are parts of the ring while it grows, known to one radius of the 80.
    """
    radii, angles = (np.arange(80) + 0.5) / 80 * RADIUS, np.arange(72) / 72 * 2 * math.pi
    on = np.array([[rho * math.cos(a), rho * math.sin(a), -rho / SLOPE] for rho in radii for a in angles])
    known, most, low, high = np.array([RADIUS, 2 * RADIUS**2]) / 80, np.zeros(2), [], []
    for d_O, d_I, z in zip(r["drill.geometry.d_O"], r["drill.geometry.d_I"], r["slide.s"], strict=True):
        points = (on + np.array([x, 0.0, float(z)]) - np.array(pose[0])) @ np.array(pose[1])
        share = (outside(shape, points) < 0.0).reshape(80, 72).mean(axis=1)
        real = np.array([share.sum(), 2 * (share * radii).sum()]) * RADIUS / 80
        ring = np.array([(d_O - d_I) / 2, (d_O**2 - d_I**2) / 4])
        most = np.maximum(most, ring) if d_O < 2 * RADIUS else most
        low.append(((np.abs(real - ring) - known) / np.maximum(most, 1e-9)).max())
        high.append(((np.abs(real - ring) + known) / np.maximum(most, 1e-9)).max())
    return np.array(low), np.array(high)


TURNED = axis_rotation((0.0, 1.0, 0.0), math.radians(35.0))
CUTS: dict[str, tuple[Shape, tuple[Any, Any], float, bool]] = {
    "roof": (HOUSE, ((0.0, 0.0, 0.0), IDENTITY), 0.0, True),
    "roof from within": (HOUSE, ((0.0, 0.0, 0.03), axis_rotation((1.0, 0.0, 0.0), math.pi)), 0.0, True),
    "inclined box": (Box((0.1, 0.1, 0.03)), ((0.0, 0.0, 0.042), TURNED), 0.0294, True),
    "inclined face": (Box((0.1, 0.1, 0.02)), ((0.0, 0.0, 0.015), axis_rotation((0.0, 1.0, 0.0), 0.2)), 0.0, True),
    "edge that hardly counts": (Box((0.1, 0.1, 0.05)), UPRIGHT, 0.0425, False),
    "nearly upright face": (
        Box((0.1, 0.1, 0.02)),
        ((0.0, 0.0, 0.015), axis_rotation((0.0, 1.0, 0.0), 0.05)),
        0.0,
        False,
    ),
    "small ball": (Sphere(0.02), ((0.0, 0.0, 0.025), IDENTITY), 0.0, True),
}


@pytest.mark.parametrize("name", slow_but(CUTS, "roof", "nearly upright face", "small ball"))
def test_a_cut_that_is_no_ring_is_told_and_no_other(name: str) -> None:
    """Of what lies in the body, integrated over the cone: a note from the instant where 5 % are passed."""
    shape, pose, x, tells = CUTS[name]
    level = ConvexLevel(shape, pose, "body")
    r = acausal.simulate(AtTheEdge(level=level), parameters={"x": x}, stop_time=24.0, output_interval=0.2)
    (least, most), notes = differences(shape, pose, x, r), told(r)
    assert (least.max() > 0.05) == bool(notes) == tells
    if notes:
        assert notes[0] <= r.time[least > 0.055][0]
        assert notes[0] >= r.time[most > 0.05][0] - 0.2


def test_any_cut_in_any_shape_is_judged_as_its_integral_says() -> None:
    """Random drills through all shapes, half of them along z: width and area by points of the cone.

    Cuts that differ by 3 to 8 % are not asked, as the points and the lines of the cone know only so much.
    """
    rng, seen = np.random.default_rng(3), {True: 0, False: 0}
    radii, angles = (np.arange(80) + 0.5) / 80 * RADIUS, np.arange(72) / 72 * 2 * math.pi
    shapes = (HOUSE, Box((0.06, 0.1, 0.03)), Sphere(0.3), Cylinder(0.02, 0.05), Capsule(0.02, 0.05), Cone(0.03, 0.02))
    for k in range(180):
        shape, e = shapes[k % 6], rng.normal(size=3) if k % 2 else np.array([0.0, 0.0, -1.0])
        e = e / np.linalg.norm(e)
        one = np.cross(e, [0.6, 0.8, 0.1]) / np.linalg.norm(np.cross(e, [0.6, 0.8, 0.1]))
        tip = rng.uniform(-0.015, 0.015, 3) - shape.support(-e) @ e * e + e * rng.uniform(0.0, 0.02)
        depth, beyond, beside, _ = (np.array(v).ravel()[0] for v in crossing_function(shape).call([tip, e]))
        if beside or depth < 1e-3:
            continue
        ways = [math.cos(a) * one + math.sin(a) * np.cross(e, one) for a in angles]
        points = np.array([tip + rho * (way - e / SLOPE) for rho in radii for way in ways])
        share = (outside(shape, points) < 0.0).reshape(80, 72).mean(axis=1)
        real = np.array([share.sum(), 2 * (share * radii).sum()]) * RADIUS / 80
        cone = RADIUS / SLOPE
        ring, most = (
            np.array([SLOPE * (o - i), SLOPE**2 * (o**2 - i**2)])
            for o, i in (
                np.clip([depth, beyond], 0.0, cone),
                (min(depth, cone), max(min(depth, cone) - depth + beyond, 0)),
            )
        )
        gap = (np.abs(real - ring) / most).max()
        clear = float(engaged_function(shape)(tip, e, depth, beyond, 2 * RADIUS, SLOPE)) > 0
        if not 0.03 < gap < 0.08:
            assert clear == (gap < 0.05), (shape, tip, e)
            seen[clear] += 1
    assert min(seen.values()) > 10


class HoleAtTheEdge(HolesSideBySide):
    """The second hole 5 mm beside the plate, 15 mm before the next one."""

    def build(self) -> None:
        super().build()
        aside = 0.055
        self.across = TimeTable(table=((0.0, 0.0), (5.0, 0.0), (6.0, aside), (15.0, aside)))


@pytest.mark.slow
def test_a_scene_tells_it_of_each_workpiece() -> None:
    """Down to 3 mm at 7/3 mm/s from 6 s on: the cone reaches the edge at depth 5 mm / tan(sigma / 2) = 3.004 mm, which
    the first way down just misses and the second, to 6 mm from 11 s on in 3 s, does not."""
    r = acausal.simulate(HoleAtTheEdge(n=2))
    rate = 10e-3 / 3.0
    assert told(r)[0] == pytest.approx(11.0 + (4e-3 + 5e-3 / SLOPE) / rate, abs=LATE)
    notes: Any = r.stats["notes"]
    assert any("in plate0 " in n for n in notes)
    assert not any("in plate1 " in n for n in notes)
