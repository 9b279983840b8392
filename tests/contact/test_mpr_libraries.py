"""MPR against two independent collision libraries, as judges: coal (GJK and EPA) and python-fcl."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from acausal.library.contact.collide.shapes import Box, Capsule, Cone, Cylinder, Shape, Sphere
from tests.contact.poses import PAIRS, SHAPES, Pose, Vector, contact, placed, plane_heights
from tests.marks import slow_but

# Their cones point to +z and are centred.
TURNED = np.diag([1.0, -1.0, -1.0])
# Neither library knows drills; both have hulls, python-fcl with faces only.
KNOWN = [p for p in PAIRS if "drill" not in p]
PLAIN = [p for p in KNOWN if "hull" not in p]
# What coal computes in closed form, or with flat faces only: there its normals are exact.
EXACT = {"sphere", "box", "capsule", "hull"}


def frame(shape: Shape, pose: Pose) -> tuple[Vector, Vector]:
    """Rotation and place of the judge's frame of a shape."""
    place, turn = pose
    if isinstance(shape, Cone):
        return turn @ TURNED, place + turn @ np.array([0.0, 0.0, shape.length / 2])
    return turn, place


def coal_answer(a: Shape, pose_a: Pose, b: Shape, pose_b: Pose) -> tuple[float, Vector]:
    """Signed depth, and normal from a to b."""
    coal = pytest.importorskip("coal", reason="coal is not installed: pip install acausal[test]")

    def geometry(shape: Shape) -> Any:
        if isinstance(shape, Sphere):
            return coal.Sphere(shape.radius)
        if isinstance(shape, Box):
            return coal.Box(*shape.size)
        if isinstance(shape, Cylinder | Capsule | Cone):
            return getattr(coal, type(shape).__name__)(shape.radius, shape.length)
        points = coal.StdVec_Vec3s()
        for point in shape.rings[:, :3]:
            points.append(point.copy())
        return coal.Convex.convexHull(points, False, "Qt")

    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    arguments = [x for s, p in ((a, pose_a), (b, pose_b)) for x in (geometry(s), coal.Transform3s(*frame(s, p)))]
    return -float(coal.distance(*arguments, request, result)), np.asarray(result.normal).ravel()


@pytest.mark.parametrize(("a", "b"), slow_but(KNOWN, *KNOWN[::3]))
def test_coal_finds_the_same(a: str, b: str) -> None:
    """Depth to 1e-9 for all pairs; the normal to 1e-9 where coal does not end at the square root of its tolerance.

    A way out as deep as another is not unique; random poses have none.
    """
    rng = np.random.default_rng(2)
    judged = 0
    for depth in (0.01, 0.004, 0.001, -0.03, 0.05, 0.1):
        pose_a, pose_b = placed(SHAPES[a], SHAPES[b], depth, rng)
        d, n, _, _ = contact(SHAPES[a], pose_a, SHAPES[b], pose_b)
        expected, normal = coal_answer(SHAPES[a], pose_a, SHAPES[b], pose_b)
        if abs(expected) > 1e3:
            continue  # coal gave up: its EPA may run out of faces on round shapes
        if d < expected - 1e-6:  # coal ended on a higher face: both are ways out
            assert d == pytest.approx(plane_heights(SHAPES[a], pose_a, SHAPES[b], pose_b, n[None])[0], abs=1e-12)
            continue
        judged += 1
        assert d == pytest.approx(expected, abs=1e-9)
        assert n == pytest.approx(normal, abs=1e-9 if {a, b} <= EXACT else 1e-4)
    assert judged >= 2


@pytest.mark.parametrize(("a", "b"), PLAIN)
def test_fcl_agrees_on_who_touches(a: str, b: str) -> None:
    """python-fcl's depth is that of published MPR and differs; whether shapes overlap does not."""
    fcl = pytest.importorskip("fcl", reason="python-fcl is not installed: pip install acausal[test]")

    def geometry(shape: Shape) -> Any:
        if isinstance(shape, Sphere):
            return fcl.Sphere(shape.radius)
        if isinstance(shape, Box):
            return fcl.Box(*shape.size)
        assert isinstance(shape, Cylinder | Capsule | Cone)
        return getattr(fcl, type(shape).__name__)(shape.radius, shape.length)

    rng = np.random.default_rng(8)
    for depth in (0.02, 0.002, -0.002, -0.02):
        poses = placed(SHAPES[a], SHAPES[b], depth, rng)
        d, *_ = contact(SHAPES[a], poses[0], SHAPES[b], poses[1])
        bodies = [
            fcl.CollisionObject(geometry(SHAPES[name]), fcl.Transform(*frame(SHAPES[name], pose)))
            for name, pose in zip((a, b), poses, strict=True)
        ]
        touching = fcl.collide(*bodies, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
        assert touching == (d > 0)
