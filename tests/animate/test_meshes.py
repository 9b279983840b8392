"""Volumes and normals of meshes against the formulas of solid geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acausal.animate import meshes
from acausal.animate.meshes import Mesh
from acausal.library.contact import Box, Capsule, Cone, ConvexHull, Cylinder, Sphere
from acausal.library.contact.collide.shapes import Shape
from acausal.library.contact.looks import shape_mesh


def volume(mesh: Mesh) -> float:
    """By the divergence theorem: positive when triangles are counter-clockwise from outside."""
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    return float(np.sum(np.cross(a, b) * c) / 6.0)


# A circle of 32 corners has this part of the area of a circle.
ROUND = 32 / (2 * math.pi) * math.sin(2 * math.pi / 32)


@pytest.mark.parametrize(
    ("mesh", "expected"),
    [
        (meshes.box((1.0, 2.0, 3.0)), 6.0),
        (meshes.cylinder(0.5, 2.0), ROUND * math.pi * 0.5),
        (meshes.cylinder(0.5, 2.0, 0.25), ROUND * math.pi * 0.375),
        (meshes.cone(0.5, 3.0), ROUND * math.pi * 0.25),
        (meshes.arrow(0.1, 1.0), ROUND * math.pi * (0.01 * 0.8 + 0.0484 * 0.2 / 3)),
    ],
)
def test_flat_solids_have_their_volume(mesh: Mesh, expected: float) -> None:
    assert volume(mesh) == pytest.approx(expected, rel=1e-12)
    assert volume(mesh.inside_out()) == pytest.approx(-expected, rel=1e-12)


def test_round_solids_have_nearly_their_volume() -> None:
    assert volume(meshes.sphere(2.0)) == pytest.approx(4 / 3 * math.pi * 8, rel=0.02)
    assert volume(meshes.capsule(1.0, 2.0)) == pytest.approx(4 / 3 * math.pi + 2 * math.pi, rel=0.02)


@pytest.mark.parametrize(
    "mesh",
    [meshes.sphere(1.0), meshes.coil(0.1), *meshes.drill(0.016, math.radians(118), 0.1), meshes.cylinder(1, 2, 0.5)],
)
def test_normals_are_units_and_point_to_where_triangles_are_seen_from(mesh: Mesh) -> None:
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-9)
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles], 1, 0)
    face = np.cross(b - a, c - a)
    shading = mesh.normals[mesh.triangles].sum(axis=1)
    solid = np.linalg.norm(face, axis=1) > 1e-14
    assert np.all(np.sum(face * shading, axis=1)[solid] > 0.0)


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.2, 0.3)),
        Sphere(0.1),
        Cylinder(0.1, 0.4),
        Capsule(0.1, 0.4),
        Cone(0.1, 0.3),
        ConvexHull(np.random.default_rng(1).normal(size=(30, 3))),
    ],
)
def test_contact_shapes_are_drawn_where_they_touch(shape: Shape) -> None:
    """Support points, which the contact uses, are those of the mesh but for its corners."""
    mesh = shape_mesh(shape, 1.0)
    assert volume(mesh) > 0.0
    low, high = (np.array(c) for c in shape.bounding_box())
    assert np.allclose(mesh.positions.min(axis=0), low, atol=0.02 * np.linalg.norm(high - low))
    assert np.allclose(mesh.positions.max(axis=0), high, atol=0.02 * np.linalg.norm(high - low))


def test_directions_turn_z_there() -> None:
    directions = np.array([[0, 0, 1], [0, 0, -2], [1, 0, 0], [0.3, -0.4, 0.5], [0, 1e-12, 0]], dtype=float)
    for e in directions:
        R = meshes.along(e)
        assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert np.allclose(R[:, 2], e / np.linalg.norm(e))
    swinging = np.array([[math.sin(a), 0.0, math.cos(a)] for a in np.linspace(0, 6, 500)])
    turned = meshes.along(swinging)
    assert np.abs(np.diff(turned, axis=0)).max() < 0.02
