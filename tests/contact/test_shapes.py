"""Shapes: support points, boxes around them, meshes from files, and what is refused."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest

from acausal.errors import DeclarationError
from acausal.library.contact.collide.shapes import (
    Box,
    Capsule,
    Cone,
    ConvexHull,
    Cylinder,
    HalfSpace,
    PointedDrill,
    Shape,
    Sphere,
)
from tests.contact.poses import SHAPES, directions, heights
from tests.expected import fails_with

CUBE = np.array([(x, y, z) for x in (0.0, 2.0) for y in (0.0, 3.0) for z in (0.0, 4.0)])
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
TRIANGLES = np.array([[CUBE[f[i]] for i in corners] for f in FACES for corners in ((0, 1, 2), (0, 2, 3))])


def text_stl(triangles: np.ndarray) -> str:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {:g} {:g} {:g}\n".format(*corner) for corner in triangle)
        + "endloop\nendfacet\n"
        for triangle in triangles
    )
    return f"solid cube\n{facets}endsolid cube\n"


def binary_stl(triangles: np.ndarray) -> bytes:
    """The header begins with `solid`, as that of some programs does."""
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    return b"solid, but binary".ljust(80) + struct.pack("<I", len(triangles)) + records


@pytest.mark.parametrize(
    ("shape", "direction", "point"),
    [
        (Sphere(2.0), (0, 3, 4), (0, 1.2, 1.6)),
        (Box((2, 4, 6)), (1, -1, 0.1), (1, -2, 3)),
        (Cylinder(1.0, 4.0), (3, 4, -1), (0.6, 0.8, -2)),
        (Capsule(1.0, 4.0), (0, 0, 1), (0, 0, 3)),
        (Cone(1.0, 2.0), (0.1, 0, -1), (0, 0, 0)),
        (Cone(1.0, 2.0), (1, 0, -0.1), (1, 0, 2)),
        (PointedDrill(2.0, math.radians(90), 5.0), (1, 0, -0.5), (1, 0, 1)),
        (PointedDrill(2.0, math.radians(90), 5.0), (0, 0, -1), (0, 0, 0)),
        (HalfSpace(), (0, 0, 1), (0, 0, 0)),
    ],
    ids=str,
)
def test_support_points(shape: Shape, direction: tuple[float, ...], point: tuple[float, ...]) -> None:
    assert shape.support(direction) == pytest.approx(point, abs=1e-12)


@pytest.mark.parametrize("name", list(SHAPES))
def test_bounding_box_and_interior_agree_with_the_support_points(name: str) -> None:
    """The box is the support along the axes; the interior point is below every support plane."""
    shape = SHAPES[name]
    low, high = shape.bounding_box()
    axes = np.eye(3)
    assert high == pytest.approx([float(shape.support(e) @ e) for e in axes])
    assert low == pytest.approx([float(shape.support(-e) @ e) for e in axes])
    d = directions(500)
    assert (heights(shape, d) - d @ shape.interior()).min() > 0.01


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_meshes_of_both_kinds(kind: str, tmp_path: Path) -> None:
    """Millimetres become metres; the hull of the twelve triangles has the eight corners of the cuboid."""
    file = tmp_path / "cube.stl"
    if kind == "text":
        file.write_text(text_stl(TRIANGLES))
    else:
        file.write_bytes(binary_stl(TRIANGLES))
    hull = ConvexHull.from_stl(str(file), scale=1e-3)
    hull.check("bracket")
    assert len(hull.rings) == 8
    assert hull.bounding_box()[0] == (0.0, 0.0, 0.0)
    assert hull.bounding_box()[1] == pytest.approx((0.002, 0.003, 0.004))
    assert hull.support((1, 1, -1)) == pytest.approx((0.002, 0.003, 0.0))


def test_points_inside_are_left_out() -> None:
    assert len(ConvexHull([*CUBE, (1.0, 1.0, 1.0)]).rings) == 8


def test_a_mesh_that_is_not_convex(tmp_path: Path) -> None:
    """One face is replaced by a dent."""
    apex = np.array([1.0, 1.5, 3.0])
    top = CUBE[[1, 5, 7, 3]]
    dent = np.array([[top[k], top[(k + 1) % 4], apex] for k in range(4)])
    file = tmp_path / "dented.stl"
    file.write_text(text_stl(np.concatenate([TRIANGLES[:10], dent])))
    with fails_with(DeclarationError, "AC176", match="the mesh of bracket is not convex") as caught:
        ConvexHull.from_stl(str(file), body="bracket")
    assert "m below the hull" in caught.value.evidence[0]


@pytest.mark.parametrize("content", [None, b"", b"solid nothing", b"vertex 1 2 x", b"\x00" * 200])
def test_files_that_are_no_meshes(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "part.stl"
    if content is not None:
        file.write_bytes(content)
    with fails_with(DeclarationError, "AC175", match="mesh of bracket"):
        ConvexHull.from_stl(str(file), body="bracket")


@pytest.mark.parametrize(
    ("shape", "what"),
    [
        (Box((0.1, 0.1, 0.0)), "thickness in z is 0 m"),
        (Sphere(-1.0), "radius is -1 m"),
        (Cylinder(0.1, math.nan), "length is nan m"),
        (Cone(0.0, 1.0), "radius is 0 m"),
        (Capsule(0.1, 0.0), "length is 0 m"),
        (PointedDrill(0.01, 4.0, 0.1), "point angle"),
        (PointedDrill(0.01, 1.0, 0.005), "not longer than its point"),
        (ConvexHull([(0, 0, 0), (1, 0, 0), (0, 1, 0)]), "points are 3"),
        (ConvexHull([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]), "zero thickness"),
    ],
    ids=str,
)
def test_bodies_without_volume_are_named(shape: Shape, what: str) -> None:
    with fails_with(DeclarationError, "AC174", what, match="of plate"):
        shape.check("plate")


def test_points_of_a_hull_have_three_coordinates() -> None:
    with fails_with(DeclarationError, "AC174"):
        ConvexHull([(0.0, 1.0), (1.0, 0.0)])


def test_shapes_are_values() -> None:
    """Equal shapes are equal and hash equally: functions are made once for them."""
    assert Box((1, 2, 3)) == Box((1.0, 2.0, 3.0))
    assert hash(ConvexHull(CUBE)) == hash(ConvexHull(CUBE.tolist()))
