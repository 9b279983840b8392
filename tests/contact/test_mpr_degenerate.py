"""Poses of symmetry: axes that cross, centres on corners, lines on discs; the depth is that of a closed form."""

from __future__ import annotations

import math

import pytest

from acausal.library.contact.collide.shapes import Box, Capsule, Cone, Cylinder, Shape, Sphere
from tests.contact.poses import contact, plane_heights, pose

HERE = pose((0.0, 0.0, 0.0))
ACROSS = (math.pi / 2, 0.0, 0.0)


@pytest.mark.parametrize(
    ("a", "b", "place", "turn", "depth"),
    [
        pytest.param(Sphere(0.3), Capsule(0.2, 0.6), (0, 0, 0.1), (0, 0, 0), 0.5, id="centre on an axis"),
        pytest.param(Capsule(0.2, 1.0), Capsule(0.1, 0.8), (0, 0, 0.1), ACROSS, 0.3, id="axes that cross"),
        pytest.param(Capsule(0.2, 1.0), Capsule(0.1, 0.8), (0, 0, 0.1), (0, 0, 0), 0.3, id="axes on each other"),
        pytest.param(Sphere(0.3), Box((1.0, 0.7, 0.4)), (0.5, 0.35, 0), (0, 0, 0), 0.3, id="centre on an edge"),
        pytest.param(Sphere(0.3), Box((1.0, 0.7, 0.4)), (0.5, 0.35, 0.2), (0, 0, 0), 0.3, id="centre on a corner"),
        pytest.param(Cylinder(0.3, 0.8), Cylinder(0.3, 0.8), (0, 0.1, 0.6), ACROSS, 0.1, id="flank on a cap"),
        pytest.param(Box((1.0, 1.0, 1.0)), Box((1.0, 1.0, 1.0)), (0, 0, 0.9), (0, 0, 0), 0.1, id="equal faces"),
        pytest.param(Box((1.0, 0.8, 0.6)), Box((1.0, 0.8, 0.6)), (0, 0, 0), (0, 0, 0), 0.6, id="in each other"),
        pytest.param(Sphere(0.3), Sphere(0.2), (0, 0, 0), (0, 0, 0), 0.5, id="concentric"),
        pytest.param(Cone(0.3, 0.5), Box((1.0, 1.0, 0.2)), (0, 0, -0.05), (0, 0, 0), 0.05, id="tip above a face"),
    ],
)
def test_depth_is_exact(a: Shape, b: Shape, place: tuple[float, ...], turn: tuple[float, ...], depth: float) -> None:
    """Sums of radii and half lengths; which normal, where there are many, is not asked."""
    d, n, _, _ = contact(a, HERE, b, pose(place, turn))
    assert d == pytest.approx(depth, abs=1e-9)
    assert float(plane_heights(a, HERE, b, pose(place, turn), n[None])[0]) == pytest.approx(d, abs=1e-9)
