"""A drill at the edge of a workpiece: its force is not known there, and the run says so.

What counts is plain geometry: a cone of point angle sigma at depth s has the radius s tan(sigma / 2), up to d / 2, and
the edge is as far from the axis as its place says.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, connect, fixed, parameter, part, quantity, structural, time
from acausal.library.blocks import TimeTable
from acausal.library.contact import Box, Capsule, Cone, ConvexHull, Cylinder, Shape, Sphere
from acausal.library.contact.collide.axis.edges import FAR, edge_distance_function
from acausal.library.drilling import (
    TWIST_DRILL_16MM,
    ConvexLevel,
    DrillingForce,
    PlateLevel,
)
from acausal.library.multibody import Prismatic, Revolute, World
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Position
from acausal.lower.compiled import CompiledModel
from acausal.models.contact_scenes import HolesSideBySide

SLOPE = math.tan(TWIST_DRILL_16MM.sigma / 2)
RADIUS = TWIST_DRILL_16MM.d / 2
FEED = 2e-3
CORNERS = [(x, y, z) for x in (-0.02, 0.02) for y in (-0.03, 0.03) for z in (-0.025, 0.025)]
UPRIGHT = ((0.0, 0.0, 0.025), IDENTITY)


class AtTheEdge(Component):
    """A drill that goes down at 2 mm/s from 1 mm above a face, `x` from the middle, and moves aside at `u`."""

    level: PlateLevel | ConvexLevel = structural(default=PlateLevel("plate"))
    x: Real = parameter(default=0.0, unit="m")
    u: Real = parameter(default=0.0, unit="m/s")
    world: World = part()
    beam: Prismatic = part()
    slide: Prismatic = part()
    spindle: Revolute = part()
    drill: DrillingForce = part()
    across: Position = part()
    feed: Position = part()
    speed: Speed = part()

    def build(self) -> None:
        up = (0.0, 0.0, 1.0)
        self.world = World(g=0.0)
        self.beam, self.slide = Prismatic(n=(1.0, 0.0, 0.0)), Prismatic(n=up)
        self.spindle = Revolute(n=up, phi=fixed(0.0))
        self.drill = DrillingForce(level=self.level, t=0.05, k=1e8, d_c=2e4)
        self.across = Position(s_ref=self.x + self.u * time)
        self.feed = Position(s_ref=quantity(FEED, "m/s") * time - quantity(1.0, "mm"))
        self.speed = Speed(w_ref=2 * math.pi * 9.28)

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
    return [float(n.split()[2]) for n in notes if "lies within the cut" in n]


@cache
def beside(level: PlateLevel | ConvexLevel) -> CompiledModel:
    """The model beside a body, compiled once for all places of the drill."""
    return acausal.compile(AtTheEdge(level=level))


def run(level: PlateLevel | ConvexLevel, x: float, u: float = 0.0, **options: Any) -> list[float]:
    options = {"stop_time": 3.5, **options}
    return told(acausal.simulate(beside(level), parameters={"x": x, "u": u}, **options))


LEVELS = (PlateLevel("plate"), ConvexLevel(Box((0.1, 0.1, 0.05)), UPRIGHT, "block"))


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
@pytest.mark.parametrize("x", [0.055, -0.052, 0.046])
def test_a_drill_whose_cone_reaches_an_edge_is_told_when_it_does(level: PlateLevel | ConvexLevel, x: float) -> None:
    """5 or 2 mm beside the plate, or 4 mm inside of its edge."""
    reached = (1e-3 + abs(abs(x) - 0.05) / SLOPE) / FEED
    assert run(level, x) == pytest.approx([reached], abs=1e-5)


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
def test_nothing_is_told_where_no_edge_is_cut(level: PlateLevel | ConvexLevel) -> None:
    for x in (0.0, 0.05 - 1.01 * RADIUS, 0.05 + 1.01 * RADIUS):
        assert run(level, x) == []


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "erk"])
def test_every_solver_tells_it_on_the_way_there(solver: str) -> None:
    """From 20 mm beside the plate towards it: the cone is as wide as the gap at 2.601 s."""
    reached = (0.02 + 1e-3 * SLOPE) / (5e-3 + FEED * SLOPE)
    assert run(LEVELS[0], 0.07, -5e-3, solver=solver, output_interval=5.0) == pytest.approx([reached], abs=1e-5)


@pytest.mark.parametrize("level", LEVELS, ids=["plate", "box"])
def test_a_drill_moved_towards_the_side_of_a_body_is_told_what_will_be_wrong(level: PlateLevel | ConvexLevel) -> None:
    """9 mm deep beside the body the drill has its full radius, which meets the side before the axis does."""
    r = acausal.simulate(beside(level), parameters={"x": 0.08, "u": -4e-3}, start_time=5.0, stop_time=6.0)
    assert told(r) == pytest.approx([(0.03 - RADIUS) / 4e-3], abs=1e-5)
    (note,) = [n for n in r.stats["notes"] if "AC191" in n]  # type: ignore[attr-defined]
    assert note.startswith("t = 5.5")
    for word in ("drill.geometry", f"an edge of {level.name}", "full contact", "radius"):
        assert word in note


@pytest.mark.slow
def test_compiled_runs_tell_it() -> None:
    for level in LEVELS:
        assert run(level, 0.055, solver="rosenbrock", native=True) == pytest.approx(
            [(1e-3 + 5e-3 / SLOPE) / FEED], abs=1e-5
        )


@pytest.mark.parametrize(
    ("shape", "edge"),
    [
        (Sphere(0.02), 0.02),
        (Cylinder(0.02, 0.05), 0.02),
        pytest.param(Capsule(0.02, 0.01), 0.02, marks=pytest.mark.slow),
        pytest.param(ConvexHull(CORNERS), 0.02, marks=pytest.mark.slow),
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
    box = Box((0.1, 0.06, 0.02))
    angles = np.linspace(0.0, 2 * math.pi, 1440)
    for shape in (box, Sphere(0.01), Cylinder(0.02, 0.05), Capsule(0.01, 0.05), Cone(0.02, 0.05), ConvexHull(corners)):
        function = edge_distance_function(shape)
        for k in range(10):
            axis = np.eye(3)[2] if k == 0 else rng.normal(size=3)
            axis, tip = axis / np.linalg.norm(axis), 0.04 * rng.normal(size=3)
            one = np.cross(axis, [1.0, 0.2, 0.0])
            one /= np.linalg.norm(one)
            other = np.cross(axis, one)
            ways = [math.cos(a) * one + math.sin(a) * other for a in angles]
            expected = max(u @ tip - u @ shape.support(u) for u in ways)
            outside, inside = (float(v) for v in function(tip, axis))
            assert outside == pytest.approx(max(expected, 0.0), abs=2e-4)
            assert inside == (pytest.approx(-expected, abs=2e-4) if shape is box and expected < 0 else inside)
            assert shape is box or inside == FAR


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
    assert told(r)[0] == pytest.approx(11.0 + (4e-3 + 5e-3 / SLOPE) / rate, abs=1e-4)
    notes: Any = r.stats["notes"]
    assert any("an edge of plate0 lies" in n for n in notes)
    assert not any("an edge of plate1 lies" in n for n in notes)
