"""Poses and independent answers for tests of collision detection."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from acausal.library.contact.collide.penetration import collision_function
from acausal.library.contact.collide.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    PointedDrill,
    Shape,
    Sphere,
)
from tests.marks import slow_but

Vector = NDArray[np.float64]
Pose = tuple[Vector, Vector]

SHAPES: dict[str, Shape] = {
    "sphere": Sphere(0.3),
    "box": Box((1.0, 0.7, 0.4)),
    "cylinder": Cylinder(0.3, 0.8),
    "cone": Cone(0.35, 0.9),
    "capsule": Capsule(0.2, 0.6),
    "drill": PointedDrill(0.3, 2.0, 1.2),
    "hull": ConvexHull(np.random.default_rng(1).standard_normal((14, 3)) * 0.4),
}
PAIRS = [(a, b) for i, a in enumerate(SHAPES) for b in list(SHAPES)[i:]]
# Each pair has a function of its own, which takes a third of a second to make: the quick tests share a few with
# all shapes.
PAIR_CASES = slow_but(
    PAIRS, ("sphere", "hull"), ("box", "cone"), ("cylinder", "capsule"), ("cone", "cone"), ("cone", "drill")
)


def contact(a: Shape, pose_a: Pose, b: Shape, pose_b: Pose) -> tuple[float, Vector, Vector, Vector]:
    """Depth, normal and both witnesses, by the function under test."""
    depth, *rest = collision_function(a, b)(*pose_a, *pose_b)
    n, p, q = (np.asarray(x).ravel() for x in rest)
    return float(depth), n, p, q


def pose(place: ArrayLike, turn: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
    """A place and a rotation vector."""
    return np.asarray(place, dtype=float), Rotation.from_rotvec(turn).as_matrix()


@lru_cache(maxsize=1)
def directions(count: int = 6000) -> Vector:
    """Unit vectors spread evenly over the sphere, shape (count, 3): a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def heights(shape: Shape, d: Vector) -> Vector:
    """The support function of a shape for directions in its frame, shape (n, 3), from its circles."""
    rings = shape.rings
    reach = d @ rings[:, :3].T + np.hypot(d[:, 0], d[:, 1])[:, None] * rings[:, 3]
    return np.asarray(reach.max(axis=1) + shape.margin * np.linalg.norm(d, axis=1))


def plane_heights(a: Shape, pose_a: Pose, b: Shape, pose_b: Pose, d: Vector) -> Vector:
    """Overlap of the two shapes along each of the directions in world axes."""
    return heights(a, d @ pose_a[1]) + heights(b, -d @ pose_b[1]) + d @ (pose_a[0] - pose_b[0])


def placed(a: Shape, b: Shape, depth: float, rng: np.random.Generator) -> tuple[Pose, Pose]:
    """Random poses at which the shapes overlap by about `depth`: the second is moved outward until they do."""
    turns = [Rotation.from_quat(rng.standard_normal(4)).as_matrix() for _ in range(2)]
    away = rng.standard_normal(3)
    away /= np.linalg.norm(away)
    start = turns[0] @ a.interior() - turns[1] @ b.interior()
    low, high = 0.0, 4.0
    for _ in range(20):
        middle = (low + high) / 2
        overlap = plane_heights(a, (np.zeros(3), turns[0]), b, (start + middle * away, turns[1]), directions()).min()
        low, high = (middle, high) if overlap > depth else (low, middle)
    return (np.zeros(3), turns[0]), (start + low * away, turns[1])


def outside(shape: Shape, pose: Pose, point: Vector) -> float:
    """How far a point in world axes lies outside a shape at least [m]; not above zero for what lies inside."""
    d = directions()
    return float((d @ (pose[1].T @ (point - pose[0])) - heights(shape, d)).max())


def rotated(turn: Any) -> Vector:
    """Rotation matrix of a rotation vector."""
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())
