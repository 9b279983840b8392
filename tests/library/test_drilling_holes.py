"""Which hole a drill is in, and which holes overlap: plain geometry of lines, cylinders and cones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Result, connect, fixed, part, structural, time
from acausal.library.blocks import TimeTable
from acausal.library.contact import Box, ContactScene, HuntCrossley, Sphere, Surfaces
from acausal.library.contact.scene.bodies import PoseValue
from acausal.library.drilling import TWIST_DRILL_16MM, DrillBody, DrillingForce, Workpiece, WorkpieceBody
from acausal.library.drilling.holes import Hole
from acausal.library.multibody import Body, FixedTranslation, Prismatic, Revolute, World, axis_rotation
from acausal.library.multibody.orientation import IDENTITY
from acausal.library.rotational import Speed
from acausal.library.translational import Position
from acausal.result.result import Signal
from tests.marks import slow_but

DOWN, UP = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
CONE = TWIST_DRILL_16MM.d / 2 / math.tan(TWIST_DRILL_16MM.sigma / 2)
PLATE = WorkpieceBody(name="plate", shape=Box((0.1, 0.1, 0.02)), at_rest=True)
BALL = WorkpieceBody(name="ball", shape=Sphere(0.03), at_rest=True)
STILL: PoseValue = np.zeros(3), np.eye(3)
TURNED: PoseValue = np.zeros(3), np.array(axis_rotation((1.0, 0.0, 0.0), math.pi))


def hole(x: float, depth: float, axis: tuple[float, float, float] = DOWN, name: str = "drill") -> Hole:
    """Of a drill of 16 mm that enters the plate of 20 mm through the face at z = -10 mm, or from behind."""
    entry = np.array([x, 0.0, -math.copysign(0.01, axis[2])])
    return Hole(name, TWIST_DRILL_16MM.d, TWIST_DRILL_16MM.sigma, entry, np.array(axis), depth, min(depth, 0.02))


@pytest.mark.parametrize(
    ("one", "other", "is_told"),
    [
        pytest.param(hole(0.0, 0.015), hole(0.0159, 0.015), True, id="side by side, nearer than the diameter"),
        pytest.param(hole(0.0, 0.015), hole(0.0161, 0.015), False, id="side by side, farther"),
        pytest.param(hole(0.0, 0.5 * CONE), hole(0.0081, 0.5 * CONE), False, id="half cones, a radius apart"),
        pytest.param(hole(0.0, 0.5 * CONE), hole(0.0079, 0.5 * CONE), True, id="half of the cones that meet"),
        pytest.param(hole(0.0, 0.0099), hole(0.0, 0.01, UP), False, id="from both sides, 0.1 mm left between the tips"),
        pytest.param(hole(0.0, 0.0101), hole(0.0, 0.01, UP), True, id="from both sides, through each other"),
        pytest.param(hole(0.0, 0.5), hole(0.0, 0.001, UP), True, id="a drill that has gone on behind the plate"),
        pytest.param(hole(0.0, 0.015), hole(0.0, 0.015, name="other"), True, id="one after the other"),
    ],
)
def test_holes_that_have_material_in_common_are_told(one: Hole, other: Hole, is_told: bool) -> None:
    assert one.overlaps(other) == other.overlaps(one) == is_told


def test_holes_that_cross_each_other_are_told_where_they_are_deep_enough() -> None:
    """The second is inclined by 45 degrees and enters 30 mm beside the first: their axes meet 30 mm deep."""
    axis = np.array([-1.0, 0.0, 1.0]) / math.sqrt(2.0)
    inclined = replace(hole(0.03, 0.05), axis=axis, inside=0.05)
    for depth, is_told in ((0.015, False), (0.03, True)):
        assert replace(hole(0.0, depth), inside=depth).overlaps(inclined) == is_told


def moved(x: float, z: float) -> PoseValue:
    return np.array([x, 0.0, z]), np.eye(3)


def test_a_hole_is_found_again_beside_it_and_from_behind_there_is_another() -> None:
    """By the drill, and by the plate, which is turned over: then the hole is deep where nothing was cut yet."""
    drill = DrillBody(name="drill")
    holes, first = drill.site(PLATE, moved(0.0, 0.0), STILL, [], 0, True)
    assert holes[first] == pytest.approx(np.array([[0.0, 0.0, -0.01], DOWN]), abs=1e-9)
    assert drill.site(PLATE, moved(0.003, -0.02), STILL, holes, 0, True)[1] == 0
    assert drill.site(PLATE, moved(0.005, -0.02), STILL, holes, 0, True)[1] == 1
    assert drill.site(PLATE, moved(0.0, -0.02), TURNED, holes, 0, True)[1] == 1
    other = DrillBody(name="drill", axis_a=UP)
    assert other.site(PLATE, moved(0.0, 0.02), STILL, holes, 0, True)[1] == 1


def test_a_hole_keeps_its_place_while_the_drill_gets_deeper() -> None:
    drill = DrillBody(name="drill")
    for z in (-0.005, 0.009, 0.05):
        holes, _ = drill.site(PLATE, moved(0.001, z), STILL, [np.array([[0.0, 0.0, -0.01], DOWN])], 0, True)
        assert holes[0] == pytest.approx(np.array([[0.001, 0.0, -0.01], DOWN]), abs=1e-9)


def test_a_drill_beside_a_round_body_has_left_its_hole() -> None:
    """24 mm from the middle the ball begins at z = -18 mm: a tip 2 mm before it is within its box, not in it."""
    drill = DrillBody(name="drill")
    holes, _ = drill.site(BALL, moved(0.0, -0.02), STILL, [], 0, True)
    assert drill.site(BALL, moved(0.024, -0.020), STILL, holes, 0, True)[1] == 1
    assert drill.site(BALL, moved(0.0, -0.020), STILL, holes, 0, True)[1] == 0


def test_pose_of_the_shape_counts() -> None:
    """A block whose shape lies 25 mm behind the frame of the body, turned over by its pose."""
    turn = axis_rotation((1.0, 0.0, 0.0), math.pi)
    block = WorkpieceBody(name="block", shape=Box((0.1, 0.1, 0.05)), pose=((0.0, 0.0, 0.025), turn), at_rest=True)
    holes, _ = DrillBody(name="drill").site(block, moved(0.01, -0.005), STILL, [], 0, True)
    assert holes[0] == pytest.approx(np.array([[0.01, 0.0, 0.025], UP]), abs=1e-9)


class Gantry(Component):
    """A drill that comes from the side, drills 3 mm deep, and goes 4.1 mm aside to do it again, without a scene."""

    world: World = World(g=0.0)
    beam: Prismatic = Prismatic(n=(1.0, 0.0, 0.0))
    slide: Prismatic = Prismatic(n=DOWN)
    spindle: Revolute = Revolute(n=DOWN, phi=fixed(0.0))
    drill: DrillingForce = DrillingForce(t=0.05, k=1e8, d_c=2e4)
    across: TimeTable = TimeTable(table=((0.0, -0.02), (1.0, 0.0), (4.0, 0.0), (5.0, 0.0041), (7.0, 0.0041)))
    down: TimeTable = TimeTable(
        table=((0.0, -1e-3), (1.0, -1e-3), (3.0, 3e-3), (4.0, -1e-3), (5.0, -1e-3), (7.0, 3e-3))
    )
    beam_drive: Position = Position()
    feed_drive: Position = Position()
    speed: Speed = Speed(w_ref=2 * math.pi * 9.28)

    def equations(self) -> Equations:
        yield connect(self.world.frame_b, self.beam.frame_a, self.drill.frame_w)
        yield connect(self.beam.frame_b, self.slide.frame_a)
        yield connect(self.slide.frame_b, self.spindle.frame_a)
        yield connect(self.spindle.frame_b, self.drill.frame_a)
        yield connect(self.across.y, self.beam_drive.s_ref)
        yield connect(self.down.y, self.feed_drive.s_ref)
        yield connect(self.beam_drive.flange, self.beam.axis)
        yield connect(self.feed_drive.flange, self.slide.axis)
        yield connect(self.speed.flange, self.spindle.axis)


def test_a_force_that_has_one_hole_tells_where_it_comes_down_beside_it() -> None:
    """However slow it was on the way, and with one output a second; 1 mm above the plate it comes down at 5.5 s."""
    r = acausal.simulate(Gantry(), stop_time=7.0, output_interval=1.0)
    assert r.at(3.0, "drill.thrust") > 3000.0
    notes: tuple[str, ...] = r.stats["notes"]  # type: ignore[assignment]
    (told,) = [n for n in notes if "AC194" in n]
    assert told.startswith("t = 5.50000015 s: drill: AC194: the drill comes down 4.1 mm beside its hole")


def recorded(rows: list[tuple[float, float]], tilt: float = 0.0) -> Result:
    """A run of a drill of 16 mm, upright but in the last row, with a row (place along x, depth of the tip) a second."""
    x, s = (np.array(v) for v in zip(*rows, strict=True))
    zero, ground = np.zeros(len(s)), np.maximum(np.maximum.accumulate(s), 0.0)
    lean = np.where(np.arange(len(s)) < len(s) - 1, 0.0, tilt)
    columns = {
        **{"s": s, "s_tar": ground, "geometry.s_exit": s - 0.05, "d": zero + 0.016, "sigma": zero + math.radians(118)},
        **{f"geometry.tip[{k}]": v for k, v in enumerate((x + s * np.sin(lean), zero, s * np.cos(lean)))},
        **{f"geometry.axis[{k}]": v for k, v in enumerate((np.sin(lean), zero, np.cos(lean)))},
    }
    signals = {f"drill.{name}": Signal(f"drill.{name}", column=k) for k, name in enumerate(columns)}
    return Result("Recorded", np.arange(len(s), dtype=float), np.stack(list(columns.values()), axis=1), signals)


@pytest.mark.parametrize(
    ("rows", "tilt", "told"),
    [
        pytest.param([(0.0, -1e-3), (0.0, 3e-3), (0.03, -1e-3), (0.03, 1e-6)], 0.0, "comes down 30 mm", id="elsewhere"),
        pytest.param([(0.0, 3e-3), (0.0039, -1e-3), (0.0039, 1e-3)], 0.0, "", id="less than a quarter of 16 mm"),
        pytest.param([(0.0, 3e-3), (0.03, -1e-3), (0.0, 4e-3)], 0.0, "", id="to and fro in the air"),
        pytest.param([(0.0, 1e-5), (0.03, -1e-3), (0.03, 4e-3)], 0.0, "", id="touched there and drilled here"),
        pytest.param([(0.0, 3e-3), (0.01, 3e-3)], 0.0, "is moved 10 mm", id="within the hole"),
        pytest.param([(0.0, 3e-3), (0.0, -1e-3), (0.0, 1e-3)], 0.2, "comes down across its hole", id="inclined"),
        pytest.param([(0.0, 3e-3), (0.0, -1e-3), (0.0, 1e-3)], 0.05, "", id="a little inclined"),
    ],
)
def test_where_a_drill_is_beside_its_hole(rows: list[tuple[float, float]], tilt: float, told: str) -> None:
    notes = DrillingForce.review(recorded(rows, tilt), ["drill"], {})
    assert len(notes) == bool(told)
    assert all(f"drill: AC194: the drill {told}" in n for n in notes)


class Machine(Component):
    """Two drills of 16 mm in two faces of one plate, on a table that moves with the drills, without a scene."""

    apart: float = structural(default=0.015, doc="Distance of the axes [m]")

    world: World = part()
    slides: list[Prismatic] = part()
    spindles: list[Revolute] = part()
    places: list[FixedTranslation] = part()
    drills: list[DrillingForce] = part()
    feeds: list[Position] = part()
    speeds: list[Speed] = part()
    down: TimeTable = part()
    table: Prismatic = part()
    faces: list[Workpiece] = part()
    travel: Position = part()

    def build(self) -> None:
        self.world = World(g=0.0)
        self.places = [FixedTranslation(r=(x, 0.0, 0.0)) for x in (0.0, self.apart)]
        self.slides = [Prismatic(n=DOWN) for _ in self.places]
        self.spindles = [Revolute(n=DOWN, phi=fixed(0.0)) for _ in self.places]
        self.drills = [DrillingForce(t=0.05, k=1e8, d_c=2e4) for _ in self.places]
        self.down = TimeTable(table=((0.0, -1e-3), (3.0, 8e-3)))
        self.feeds = [Position() for _ in self.places]
        self.speeds = [Speed(w_ref=2 * math.pi * 9.28) for _ in self.places]
        self.table = Prismatic(n=(0.0, 1.0, 0.0))
        self.travel = Position(s_ref=0.02 * time)
        turns = (0.3, 1.2)  # angles of the axes of the faces about their normal [rad]
        self.faces = [
            Workpiece(t=0.05, r=p.r, R_rel=axis_rotation(DOWN, a)) for p, a in zip(self.places, turns, strict=True)
        ]

    def equations(self) -> Equations:
        parts = self.places, self.faces, self.slides, self.spindles, self.drills, self.feeds, self.speeds
        yield connect(self.world.frame_b, self.table.frame_a)
        yield connect(self.travel.flange, self.table.axis)
        for place, face, slide, spindle, drill, feed, speed in zip(*parts, strict=True):
            yield connect(self.table.frame_b, place.frame_a, face.frame_a)
            yield connect(face.frame_b, drill.frame_w)
            yield connect(place.frame_b, slide.frame_a)
            yield connect(slide.frame_b, spindle.frame_a)
            yield connect(spindle.frame_b, drill.frame_a)
            yield connect(self.down.y, feed.s_ref)
            yield connect(feed.flange, slide.axis)
            yield connect(speed.flange, spindle.axis)


@pytest.mark.parametrize(("apart", "is_told"), slow_but([(0.0159, True), (0.0161, False)], (0.0159, True)))
def test_holes_of_forces_outside_of_scenes_are_told_where_they_overlap(apart: float, is_told: bool) -> None:
    r = acausal.simulate(Machine(apart=apart), stop_time=3.0)
    notes: tuple[str, ...] = r.stats["notes"]  # type: ignore[assignment]
    told = [n for n in notes if "AC192: holes of drills[0] and drills[1] overlap, 15.9 mm apart" in n]
    assert len(told) == is_told == any("AC192" in n for n in notes)


class TwoInAScene(Component):
    """A drill with one hole in a plate, and one that comes from the side when the first has been drawn out."""

    world: World = World(g=0.0)
    scene: ContactScene = part()
    beams: list[Prismatic] = part()
    slides: list[Prismatic] = part()
    spindles: list[Revolute] = part()
    bodies: list[Body] = part()
    across: list[TimeTable] = part()
    down: list[TimeTable] = part()
    ways: list[Position] = part()
    feeds: list[Position] = part()
    speeds: list[Speed] = part()

    def build(self) -> None:
        self.across = [
            TimeTable(table=((0.4, -0.03), (0.5, 0.0), (1.0, 0.0))),
            TimeTable(table=((0.4, 1.9e-3), (0.5, 1.9e-3))),
        ]
        self.down = [
            TimeTable(table=((0.0, -1e-3), (0.5, -1e-3), (0.7, 6e-4))),
            TimeTable(table=((0.0, -1e-3), (0.2, 6e-4), (0.4, -0.15))),
        ]
        self.beams, self.slides = ([Prismatic(n=n) for _ in range(2)] for n in ((1.0, 0.0, 0.0), DOWN))
        self.spindles = [Revolute(n=DOWN, phi=fixed(0.0)) for _ in range(2)]
        self.bodies = [Body(m=5.0) for _ in range(2)]
        self.ways, self.feeds = ([Position() for _ in range(2)] for _ in range(2))
        self.speeds = [Speed(w_ref=2 * math.pi * 9.28) for _ in range(2)]
        plate = replace(PLATE, pose=((0.0, 0.0, 0.01), IDENTITY))
        self.scene = ContactScene(
            bodies=(DrillBody(name="free"), DrillBody(name="still", wanders=False), plate),
            surfaces=Surfaces(law=HuntCrossley(k=1e8, e=0.5, v_0=0.1)),
        )

    def equations(self) -> Equations:
        parts = self.beams, self.slides, self.spindles, self.bodies, self.across, self.ways, self.feeds, self.speeds
        for k, (beam, slide, spindle, body, across, way, feed, speed) in enumerate(zip(*parts, strict=True)):
            yield connect(self.world.frame_b, beam.frame_a)
            yield connect(beam.frame_b, slide.frame_a)
            yield connect(slide.frame_b, spindle.frame_a)
            yield connect(spindle.frame_b, body.frame_a, self.scene.frames[k])
            yield connect(across.y, way.s_ref)
            yield connect(way.flange, beam.axis)
            yield connect(self.down[k].y, feed.s_ref)
            yield connect(feed.flange, slide.axis)
            yield connect(speed.flange, spindle.axis)


@pytest.mark.slow
def test_holes_of_drills_that_wander_and_that_do_not_are_told_where_they_overlap() -> None:
    """Cones 0.58 mm deep have a radius of 0.58 mm tan(59 deg) = 0.97 mm: their axes are 1.9 mm apart."""
    notes: tuple[str, ...] = acausal.simulate(TwoInAScene(), stop_time=0.7, tolerance=1e-3).stats["notes"]  # type: ignore[assignment]
    (told,) = [n for n in notes if "AC192" in n]
    assert "holes of scene.contacts[still,plate] and scene.contacts[free,plate] overlap, 1.9 mm apart" in told


def test_forces_that_share_no_workpiece_have_holes_in_one_place() -> None:
    """Two scenes in one model, each with a world of its own, as a model and its variant: BreakthroughSurge."""
    rows = recorded([(0.0, 3e-3), (0.0, 4e-3)])
    signals = {name.replace("drill", own): s for own in ("a", "b") for name, s in rows.signals.items()}
    two = Result("Two", rows.time, rows.matrix, signals)
    for frames, told in (({"a.frame_w.r_0": 0, "b.frame_w.r_0": 3}, 0), ({"a.frame_w.r_0": 0, "b.frame_w.r_0": 0}, 1)):
        assert len(DrillingForce.review(two, ["a", "b"], frames)) == told
