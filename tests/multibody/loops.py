"""Closed loops of joints, random in shape, mass and start, as a model and as its maximal coordinates.

All frames are parallel to the world in the pose a plan is drawn in; joint coordinates are zero there. A run starts from
another pose: the coordinates of its drives are given, all others are only guessed to be zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acausal import Component, Equations, Real, connect, fixed, guess, parameter, part, structural
from acausal.library.multibody import (
    Body,
    Fixed,
    FixedTranslation,
    Prismatic,
    Revolute,
    RevolutePlanarLoopConstraint,
    Spherical,
    Universal,
    World,
)
from acausal.result.result import Result
from tests.multibody.maximal import GROUND, Mechanism, Pose, Primitive, quaternion

Vector = NDArray[np.float64]
Joint = Revolute | Prismatic | Spherical | Universal | RevolutePlanarLoopConstraint
Axis = tuple[float, float, float]
Z: Axis = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Tie:
    """A joint between two bodies at a place; `start` gives coordinate and velocity where the joint is a drive."""

    kind: str
    a: int
    b: int
    place: tuple[float, ...]
    axis: Axis = Z
    second: Axis = Z
    start: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plan:
    """Centres and masses of bodies, joints between them, and which bodies hang on ball joints only."""

    centres: tuple[tuple[float, ...], ...]
    masses: tuple[float, ...]
    ties: tuple[Tie, ...]
    free: tuple[int, ...] = ()

    @property
    def drives(self) -> list[Tie]:
        """Joints whose coordinates are given at the start."""
        return [tie for tie in self.ties if tie.start is not None]

    @property
    def inertias(self) -> tuple[tuple[float, ...], ...]:
        """Principal moments of inertia about the centres, along the axes of the world."""
        return tuple((0.04 * m, 0.05 * m, 0.06 * m) for m in self.masses)


class Assembly(Component):
    """The mechanism of a plan."""

    plan: Plan = structural()
    world: World = World()
    bodies: list[Body] = part()
    grounds: list[Fixed] = part()
    arms: list[FixedTranslation] = part()
    joints: list[Joint] = part()
    slides: list[Prismatic] = part()
    turns: Real = parameter(default=(0.0,) * 6, unit="rad", shape=6, doc="Start angles of drives")
    spins: Real = parameter(default=(0.0,) * 6, unit="rad/s", shape=6, doc="Start speeds of drives")
    ways: Real = parameter(default=(0.0,) * 6, unit="m", shape=6, doc="Start lengths of drives")
    speeds: Real = parameter(default=(0.0,) * 6, unit="m/s", shape=6, doc="Start velocities of drives")

    def build(self) -> None:
        plan = self.plan
        self.bodies, self.grounds, self.arms, self.joints, self.slides = [], [], [], [], []
        for k, (centre, m, (xx, yy, zz)) in enumerate(zip(plan.centres, plan.masses, plan.inertias, strict=True)):
            at: dict[str, Any] = {"r_0": guess(centre)} if k in plan.free else {}
            self.bodies.append(Body(m=m, I_11=xx, I_22=yy, I_33=zz, **at))
        for tie in plan.ties:
            for body in (tie.a, tie.b):
                if body == GROUND:
                    self.grounds.append(Fixed(r=tie.place))
                else:
                    reach = np.subtract(tie.place, plan.centres[body])
                    self.arms.append(FixedTranslation(r=tuple(map(float, reach))))
            self.joints.append(self._joint(tie, plan.drives.index(tie) if tie in plan.drives else None))
            if tie.kind == "cylindrical":
                self.slides.append(Prismatic(n=tie.axis))

    def _joint(self, tie: Tie, drive: int | None) -> Joint:
        if tie.kind in ("revolute", "cylindrical"):
            if drive is not None:
                return Revolute(n=tie.axis, phi=fixed(self.turns[drive]), w=fixed(self.spins[drive]))
            return Revolute(n=tie.axis)
        if tie.kind == "prismatic":
            if drive is not None:
                return Prismatic(n=tie.axis, s=fixed(self.ways[drive]), v=fixed(self.speeds[drive]))
            return Prismatic(n=tie.axis)
        if tie.kind == "closing":
            return RevolutePlanarLoopConstraint(n=tie.axis)
        return Universal(n_a=tie.axis, n_b=tie.second) if tie.kind == "universal" else Spherical()

    def equations(self) -> Equations:
        grounds, arms, slides = iter(self.grounds), iter(self.arms), iter(self.slides)
        for tie, joint in zip(self.plan.ties, self.joints, strict=True):
            ends = []
            for body in (tie.a, tie.b):
                if body == GROUND:
                    ends.append(next(grounds).frame_b)
                else:
                    arm = next(arms)
                    yield connect(self.bodies[body].frame_a, arm.frame_a)
                    ends.append(arm.frame_b)
            yield connect(ends[0], joint.frame_a)
            if tie.kind == "cylindrical":
                slide = next(slides)
                yield connect(joint.frame_b, slide.frame_a)
                yield connect(slide.frame_b, ends[1])
            else:
                yield connect(joint.frame_b, ends[1])


def parameters(plan: Plan) -> dict[str, float]:
    """The numbers of a plan, by the names of an assembly's parameters."""
    found: dict[str, float] = {}
    for k, (m, moments) in enumerate(zip(plan.masses, plan.inertias, strict=True)):
        found[f"bodies[{k}].m"] = m
        found |= {f"bodies[{k}].I_{i}{i}": moment for i, moment in enumerate(moments, start=1)}
    grounds = arms = 0
    for tie in plan.ties:
        for body in (tie.a, tie.b):
            reach = np.subtract(tie.place, plan.centres[body]) if body != GROUND else np.array(tie.place)
            name = f"arms[{arms}]" if body != GROUND else f"grounds[{grounds}]"
            found |= {f"{name}.r[{i}]": float(reach[i]) for i in range(3)}
            arms, grounds = arms + (body != GROUND), grounds + (body == GROUND)
    for k, tie in enumerate(plan.drives):
        assert tie.start is not None
        turns = tie.kind in ("revolute", "cylindrical")
        found[f"{'turns' if turns else 'ways'}[{k}]"] = tie.start[0]
        found[f"{'spins' if turns else 'speeds'}[{k}]"] = tie.start[1]
    return found


def shaken(plan: Plan, random: np.random.Generator) -> Plan:
    """Another plan with the same axes: places, masses and starts change."""

    def moved(place: tuple[float, ...]) -> tuple[float, ...]:
        by = random.uniform(-0.06, 0.06, 3) * (1.0 if any(p[2] for p in plan.centres) else np.array([1.0, 1.0, 0.0]))
        return _at(np.array(place) + by)

    ties = [replace(tie, place=moved(tie.place)) for tie in plan.ties]
    starts = [None if t.start is None else (t.start[0] + random.uniform(-0.03, 0.03), -t.start[1]) for t in ties]
    masses = tuple(float(m * random.uniform(0.7, 1.4)) for m in plan.masses)
    moved_ties = tuple(replace(tie, start=start) for tie, start in zip(ties, starts, strict=True))
    return replace(plan, centres=tuple(map(moved, plan.centres)), masses=masses, ties=moved_ties)


def maximal(plan: Plan) -> Mechanism:
    """The same in maximal coordinates."""
    found: list[Primitive] = []
    for tie in plan.ties:
        place, axis = np.array(tie.place), np.array(tie.axis) / np.linalg.norm(tie.axis)
        p, q = (place - (plan.centres[k] if k != GROUND else np.zeros(3)) for k in (tie.a, tie.b))
        x = np.cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.8 else (0.0, 1.0, 0.0))
        x /= np.linalg.norm(x)
        y = np.cross(axis, x)
        sides = tie.a, tie.b, p, q
        if tie.kind in ("revolute", "spherical", "universal"):
            found.append(Primitive("point", *sides))
        if tie.kind in ("prismatic", "cylindrical", "closing"):
            found += [Primitive("offset", *sides, u=u) for u in (x, y)]
        if tie.kind in ("revolute", "prismatic", "cylindrical"):
            found += [Primitive("normal", *sides, u=u, v=axis) for u in (x, y)]
        if tie.kind == "prismatic":
            found.append(Primitive("normal", *sides, u=x, v=y))
        if tie.kind == "universal":
            found.append(Primitive("normal", *sides, u=axis, v=np.array(tie.second) / np.linalg.norm(tie.second)))
    inertias = np.array([np.diag(moments) for moments in plan.inertias])
    return Mechanism(np.array(plan.masses), inertias, tuple(found))


GRAVITY = np.array([0.0, -9.80665, 0.0])


def pose(plan: Plan, result: Result, row: int) -> Pose:
    """Positions, quaternions, velocities and angular velocities in world axes of all bodies, at a row of a run."""
    n = len(plan.centres)
    r, Q, v, w = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(n):
        body = f"bodies[{k}]"
        r[k] = [result[f"{body}.r_0[{i}]"][row] for i in range(3)]
        v[k] = [result[f"{body}.v_0[{i}]"][row] for i in range(3)]
        R = np.array([[result[f"{body}.frame_a.R[{i},{j}]"][row] for j in range(3)] for i in range(3)])
        w[k] = R @ [result[f"{body}.w_a[{i}]"][row] for i in range(3)]
        Q[k] = quaternion(R)
    return r, Q, v, w


def _middle(*points: Vector) -> tuple[float, ...]:
    return tuple(map(float, np.mean(points, axis=0)))


def _at(point: Vector) -> tuple[float, ...]:
    return tuple(map(float, point))


@dataclass
class _Draft:
    """A plan that is being drawn."""

    random: np.random.Generator
    centres: list[tuple[float, ...]] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    free: list[int] = field(default_factory=list)

    def body(self, *points: Vector, free: bool = False) -> int:
        self.centres.append(_middle(*points))
        if free:
            self.free.append(len(self.centres) - 1)
        return len(self.centres) - 1

    def tie(
        self, kind: str, a: int, b: int, place: Vector, axis: Vector | tuple[float, ...] = Z, **more: object
    ) -> None:
        self.ties.append(Tie(kind, a, b, _at(place), _at(np.asarray(axis)), **more))  # type: ignore[arg-type]

    def drive(self, most: float = 0.3) -> tuple[float, float]:
        return float(self.random.uniform(-most, most)), float(self.random.uniform(-3.0, 3.0))

    def direction(self) -> Vector:
        found = self.random.standard_normal(3)
        return np.asarray(found / np.linalg.norm(found))

    def near(self, *at: float, spread: float = 0.2) -> Vector:
        return np.array(at) + self.random.uniform(-spread, spread, 3)

    def flat(self, *at: float, spread: float = 0.2) -> Vector:
        return np.append(np.array(at) + self.random.uniform(-spread, spread, 2), 0.0)

    def plan(self) -> Plan:
        masses = tuple(map(float, self.random.uniform(0.3, 2.0, len(self.centres))))
        return Plan(tuple(self.centres), masses, tuple(self.ties), tuple(self.free))


def planar_chain(random: np.random.Generator, links: int) -> Plan:
    """A loop of `links` moving links on the ground, with one drive per degree of freedom."""
    draft = _Draft(random)
    points = [draft.flat(0.0, 0.0)]
    for k in range(links - 1):
        turn = np.pi * (1.0 - (k + 1.0) / links) + random.uniform(-0.4, 0.4)
        points.append(points[-1] + random.uniform(0.3, 1.2) * np.array([np.cos(turn), np.sin(turn), 0.0]))
    points.append(draft.flat(float(points[-1][0]) + 0.7, -0.2))
    before = GROUND
    for k in range(links):
        body = draft.body(points[k], points[k + 1])
        draft.tie("revolute", before, body, points[k], start=draft.drive() if k < links - 2 else None)
        before = body
    draft.tie("closing", before, GROUND, points[links])
    return draft.plan()


def four_bar(random: np.random.Generator) -> Plan:
    """A planar loop of four joints, one degree of freedom."""
    return planar_chain(random, 3)


def five_bar(random: np.random.Generator) -> Plan:
    """A planar loop of five joints, two degrees of freedom."""
    return planar_chain(random, 4)


def six_bar(random: np.random.Generator) -> Plan:
    """Stephenson's six-bar: a four-bar whose coupler drives two more links to the ground."""
    draft = _Draft(random)
    p = [draft.flat(0.0, 0.0), draft.flat(0.1, 0.5), draft.flat(1.0, 0.9), draft.flat(1.1, 0.0)]
    e, f, g = draft.flat(0.6, 1.3), draft.flat(1.6, 1.4), draft.flat(1.9, 0.1)
    crank, coupler, rocker = draft.body(p[0], p[1]), draft.body(p[1], p[2], e), draft.body(p[2], p[3])
    rod, lever = draft.body(e, f), draft.body(f, g)
    draft.tie("revolute", GROUND, crank, p[0], start=draft.drive())
    draft.tie("revolute", crank, coupler, p[1])
    draft.tie("revolute", coupler, rocker, p[2])
    draft.tie("closing", rocker, GROUND, p[3])
    draft.tie("revolute", coupler, rod, e)
    draft.tie("revolute", rod, lever, f)
    draft.tie("closing", lever, GROUND, g)
    return draft.plan()


def rssr(random: np.random.Generator) -> Plan:
    """Crank and rocker about skew axes, coupled by a rod on two ball joints (which may turn about itself)."""
    draft = _Draft(random)
    a, b, c, d = draft.near(0, 0, 0), draft.near(0, 0.5, 0.2), draft.near(1, 0.8, 0.4), draft.near(1.1, 0, 0.1)
    crank, rod, rocker = draft.body(a, b), draft.body(b, c, free=True), draft.body(c, d)
    draft.tie("revolute", GROUND, crank, a, draft.direction(), start=draft.drive())
    draft.tie("spherical", crank, rod, b)
    draft.tie("spherical", rod, rocker, c)
    draft.tie("revolute", GROUND, rocker, d, draft.direction())
    return draft.plan()


def rscr(random: np.random.Generator) -> Plan:
    """Crank, coupler on a ball joint and in a cylindrical joint, rocker."""
    draft = _Draft(random)
    a, b, c, d = draft.near(0, 0, 0), draft.near(0, 0.5, 0.2), draft.near(1, 0.8, 0.4), draft.near(1.1, 0, 0.1)
    crank, coupler, rocker = draft.body(a, b), draft.body(b, c), draft.body(c, d)
    draft.tie("revolute", GROUND, crank, a, draft.direction(), start=draft.drive())
    draft.tie("revolute", GROUND, rocker, d, draft.direction())
    draft.tie("cylindrical", rocker, coupler, c, draft.direction())
    draft.tie("spherical", crank, coupler, b)
    return draft.plan()


def three_rrr(random: np.random.Generator) -> Plan:
    """A planar platform on three legs of two links each."""
    draft = _Draft(random)
    turns = np.array([0.3, 2.4, 4.5]) + random.uniform(-0.2, 0.2, 3)
    corners = [np.array([0.3 * np.cos(t), 0.3 * np.sin(t), 0.0]) for t in turns]
    platform = draft.body(*corners)
    for k, (t, corner) in enumerate(zip(turns, corners, strict=True)):
        foot = np.array([1.3 * np.cos(t), 1.3 * np.sin(t), 0.0])
        knee = 0.5 * (foot + corner) + random.uniform(0.3, 0.5) * np.array([-np.sin(t), np.cos(t), 0.0])
        lower, upper = draft.body(foot, knee), draft.body(knee, corner)
        draft.tie("revolute", GROUND, lower, foot, start=draft.drive(0.15))
        draft.tie("revolute", lower, upper, knee)
        draft.tie("closing" if k else "revolute", upper, platform, corner)
    return draft.plan()


def three_rps(random: np.random.Generator) -> Plan:
    """A platform on three legs, each on a hinge, of variable length, with a ball joint at the top."""
    draft = _Draft(random)
    turns = np.array([0.0, 2.1, 4.2]) + random.uniform(-0.2, 0.2, 3)
    corners = [np.array([0.4 * np.cos(t), 0.9, 0.4 * np.sin(t)]) + random.uniform(-0.1, 0.1, 3) for t in turns]
    platform = draft.body(*corners, free=True)
    for t, corner in zip(turns, corners, strict=True):
        foot = np.array([0.8 * np.cos(t), 0.0, 0.8 * np.sin(t)])
        hinge = np.array([-np.sin(t), random.uniform(-0.1, 0.1), np.cos(t)])
        way = corner - foot
        lower, upper = draft.body(foot, foot + 0.4 * way), draft.body(foot + 0.6 * way, corner)
        draft.tie("revolute", GROUND, lower, foot, hinge)
        draft.tie("prismatic", lower, upper, foot + 0.5 * way, way, start=draft.drive(0.08))
        draft.tie("spherical", upper, platform, corner)
    return draft.plan()


def stewart(random: np.random.Generator) -> Plan:
    """Stewart's platform: six legs of variable length between universal and ball joints."""
    draft = _Draft(random)
    turns = np.array([0.1, 1.9, 2.2, 4.0, 4.3, 6.1]) + random.uniform(-0.1, 0.1, 6)
    feet = turns + np.array([0.8, -0.8, 0.8, -0.8, 0.8, -0.8])
    corners = [np.array([0.4 * np.cos(t), 0.9, 0.4 * np.sin(t)]) + random.uniform(-0.05, 0.05, 3) for t in turns]
    platform = draft.body(*corners, free=True)
    for t, corner in zip(feet, corners, strict=True):
        foot = np.array([0.8 * np.cos(t), 0.0, 0.8 * np.sin(t)])
        way = corner - foot
        first = np.cross(way, draft.direction())
        second = np.cross(way, first)
        lower, upper = draft.body(foot, foot + 0.4 * way), draft.body(foot + 0.6 * way, corner)
        draft.tie("universal", GROUND, lower, foot, first, second=_at(second))
        draft.tie("prismatic", lower, upper, foot + 0.5 * way, way, start=draft.drive(0.05))
        draft.tie("spherical", upper, platform, corner)
    return draft.plan()


KINDS: tuple[Callable[[np.random.Generator], Plan], ...] = (
    four_bar,
    five_bar,
    six_bar,
    rssr,
    rscr,
    three_rrr,
    three_rps,
    stewart,
)
