"""The penetration depth by comparing directions, and random pairs of shapes: nothing of the function under test."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull as Faces
from scipy.spatial.transform import Rotation

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
from tests.contact.poses import Pose, Vector, contact, directions, plane_heights, pose

HERE = pose((0.0, 0.0, 0.0))
KINDS = ("sphere", "box", "cylinder", "cone", "capsule", "drill", "hull")
PLACES = ("anywhere", "anywhere", "anywhere", "coincident", "right angles", "one axis")

_AROUND = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_RADIAL = np.stack([np.cos(_AROUND), np.sin(_AROUND), np.zeros(24)], axis=1)
_AXIS = np.array([[0.0, 0.0, 1.0]])


def random_shape(kind: str, rng: np.random.Generator, least: float) -> Shape:
    """A shape whose lengths are between `least` and 1 m, evenly in their logarithm."""
    x, y, z = np.exp(rng.uniform(math.log(least), 0, 3)).tolist()
    angle = float(rng.uniform(0.8, 2.8))
    if kind == "hull":
        corners = rng.standard_normal((int(rng.integers(5, 16)), 3)) * [x / 2, y / 2, z / 2]
        return ConvexHull(corners + rng.normal(size=3) * 0.1)
    shapes: dict[str, Shape] = {
        "sphere": Sphere(x / 2),
        "box": Box((x, y, z)),
        "cylinder": Cylinder(x / 2, y),
        "cone": Cone(x / 2, y),
        "capsule": Capsule(x / 2, y),
        "drill": PointedDrill(x / 2, angle, x / 4 / math.tan(angle / 2) + y),
    }
    return shapes[kind]


def random_pose(a: Shape, b: Shape, place: str, rng: np.random.Generator) -> Pose:
    """Where b may be when a is at the origin: anywhere it overlaps or nearly so, or in a place of symmetry."""
    if place == "coincident":
        return np.zeros(3), Rotation.random(random_state=rng).as_matrix()
    if place == "right angles":
        right = np.round(Rotation.create_group("O").as_matrix()[rng.integers(24)])
        if rng.random() < 0.3:
            right = right @ Rotation.from_rotvec([0, 0, np.pi / 4]).as_matrix()
        return (np.zeros(3) if rng.random() < 0.3 else rng.choice([0.0, 0.1, -0.2], size=3)), right
    if place == "one axis":
        turn = np.eye(3)[rng.integers(3)] * rng.uniform(0, 2 * np.pi)
        return (rng.random(3) < 0.5) * rng.normal(size=3) * 0.3, Rotation.from_rotvec(turn).as_matrix()
    R = Rotation.random(random_state=rng).as_matrix()
    away = rng.standard_normal(3)
    inside = a.interior() - R @ b.interior()
    d = directions()[::10]
    reach = plane_heights(a, (np.zeros(3), np.eye(3)), b, (inside, R), d)
    # So far away the first of the planes separates them.
    limit = 1 / float((d @ away / reach).max())
    return inside + away * limit * rng.uniform(0, 1.02), R


def least_overlap(a: Shape, pose_a: Pose, b: Shape, pose_b: Pose, rng: np.random.Generator) -> float:
    """The least overlap over a dense set of directions, each of the lowest followed downhill.

    In the set are all axes of the separating axis theorem (S. Gottschalk, M. C. Lin, D. Manocha, OBBTree, SIGGRAPH
    1996): for two polyhedra they are all that can be least, so that the answer is exact. Downhill leads a pattern
    search with a random orientation in each step (V. Torczon, SIAM J. Optimization 7, 1997), to about 1e-7.
    """
    (normals_a, edges_a), (normals_b, edges_b) = _axes(a), _axes(b)
    sets = [directions(), normals_a @ pose_a[1].T, -(normals_b @ pose_b[1].T)]
    if len(edges_a) and len(edges_b):
        across = np.cross((edges_a @ pose_a[1].T)[:, None], (edges_b @ pose_b[1].T)[None]).reshape(-1, 3)
        across = _units(across[np.linalg.norm(across, axis=1) > 1e-9])
        sets += [across, -across]
    d = np.vstack(sets)
    overlaps = plane_heights(a, pose_a, b, pose_b, d)
    best = float(overlaps.min())
    polyhedra = all(isinstance(s, (Box, ConvexHull)) for s in (a, b))
    # IndependentSystems, the nearest points may be two corners.
    if polyhedra and best > 0.0:
        return best
    n = _spread(d[np.argsort(overlaps)[:3000]])
    value, radius = plane_heights(a, pose_a, b, pose_b, n), np.full(len(n), 0.05)
    rows = np.arange(len(n))
    for _ in range(70):
        angle = rng.uniform(0, 2 * np.pi) + np.arange(6) * np.pi / 3
        one = _units(np.cross(n, [0.3, 0.5, 0.81]))
        two = np.cross(n, one)
        turned = np.cos(angle)[None, :, None] * one[:, None] + np.sin(angle)[None, :, None] * two[:, None]
        tried = _units((n[:, None] + radius[:, None, None] * turned).reshape(-1, 3))
        found = plane_heights(a, pose_a, b, pose_b, tried).reshape(len(n), 6)
        k = found.argmin(axis=1)
        lower = found[rows, k] < value
        n = np.where(lower[:, None], tried.reshape(len(n), 6, 3)[rows, k], n)
        value = np.minimum(value, found[rows, k])
        radius = np.where(lower, radius * 1.3, radius * 0.5)
    return min(best, float(value.min()))


def _spread(d: Vector) -> Vector:
    """The first of the directions, and up to eleven more that are apart from those before."""
    kept: list[Vector] = []
    for row in d:
        if all(row @ other < 0.98 for other in kept):
            kept.append(row)
        if len(kept) == 12:
            break
    return np.array(kept)


@lru_cache(maxsize=8)
def _axes(shape: Shape) -> tuple[Vector, Vector]:
    """Normals of faces and directions of edges, shape (n, 3); of round shapes some of the many."""
    none = np.zeros((0, 3))
    if isinstance(shape, Box):
        return np.vstack([np.eye(3), -np.eye(3)]), np.eye(3)
    if isinstance(shape, ConvexHull):
        points = shape.rings[:, :3]
        hull = Faces(points)
        sides = {tuple(sorted(side)) for face in hull.simplices for side in combinations(face.tolist(), 2)}
        return np.asarray(hull.equations[:, :3]), _units(np.array([points[j] - points[i] for i, j in sorted(sides)]))
    if isinstance(shape, (Sphere, Capsule)):
        return none, (none if isinstance(shape, Sphere) else _AXIS)
    flanks: dict[type, Callable[[Any], tuple[float, float]]] = {
        Cylinder: lambda s: (0.0, 1.0),
        Cone: lambda s: (s.radius, s.length),
        PointedDrill: lambda s: (s.diameter / 2, s.point_length),
    }
    across, along = flanks[type(shape)](shape)
    generators = _units(across * _RADIAL + along * _AXIS)
    normals = _units(along * _RADIAL - across * _AXIS)
    return np.vstack([_AXIS, -_AXIS, _RADIAL, normals]), np.vstack([_AXIS, generators, _RADIAL])


def _units(v: Vector) -> Vector:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def wrong(a: Shape, b: Shape, pose_b: tuple[np.ndarray, np.ndarray], rng: np.random.Generator) -> str | None:
    """What is wrong with the contact of two shapes, if anything."""
    depth, n, p, q = contact(a, HERE, b, pose_b)
    if not np.isfinite([depth, *n, *p, *q]).all():
        return "not finite"
    if abs(np.linalg.norm(n) - 1) > 1e-12:
        return "the normal is no unit vector"
    overlap = float(plane_heights(a, HERE, b, pose_b, n[None])[0])
    if abs(overlap - depth) > 1e-9:
        return f"depth {depth:.9g}, but {overlap:.9g} along its normal"
    if (any(a.way_back)) != (any(b.way_back)):
        return None  # a tool is drawn back, also where another way out is shorter
    least = least_overlap(a, HERE, b, pose_b, rng)
    return f"depth {depth:.9g}, but {least:.9g} is enough" if depth > least + 1e-8 else None
