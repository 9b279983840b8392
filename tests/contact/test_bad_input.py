"""Scenes, shapes and meshes that cannot be are refused with a code and the name of the body."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull as Hull

from acausal.errors import DeclarationError
from acausal.library.contact import Box, ContactBody, ContactScene, ConvexHull, Cylinder, Sphere
from acausal.library.contact.collide.penetration import penetration
from acausal.library.drilling import ConvexLevel, DrillBody, DrillingForce, WorkpieceBody
from tests.expected import fails_with

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = CUBE[Hull(CUBE).simplices]


def scene(shape: Any, **settings: Any) -> ContactScene:
    return ContactScene(bodies=(DrillBody(name="bit"), WorkpieceBody(name="lid", shape=shape, **settings)))


def ball(**settings: Any) -> ContactScene:
    return ContactScene(bodies=(ContactBody(name="ball", shape=Sphere(0.1), **settings),))


def force(level: Any) -> DrillingForce:
    return DrillingForce(level=level, t=0.1, k=1e8, d_c=1e4)


def other(value: Any) -> Any:
    """A value of the wrong type, which type checkers are not to see."""
    return value


CASES: tuple[tuple[Callable[[], object], str, str], ...] = (
    (lambda: scene(Box((0.1, math.nan, 0.1))), "AC174", "lid is not a body: its length in y is nan m"),
    (lambda: scene(Box((0.1, 0.1, 0.0))), "AC174", "lid is not a body: its thickness in z is 0 m"),
    (lambda: scene(Sphere(-1.0)), "AC174", "lid is not a body: its radius is -1 m"),
    (lambda: scene(Sphere(other("big"))), "AC174", "its radius is 'big'"),
    (lambda: scene(Cylinder(0.1, math.inf)), "AC174", "its length is inf m"),
    (lambda: Box(other((0.1, 0.1))), "AC174", "three edge lengths"),
    (lambda: ConvexHull(other("abc")), "AC174", "shape .n, 3., not of 'abc'"),
    (lambda: scene("a box"), "AC174", "the shape of lid is 'a box'"),
    (lambda: penetration(Sphere(0.1), other(None)), "AC174", "the second body"),
    (lambda: scene(Box((1, 1, 1)), pose=((0, 0, 0), np.diag([1, 2, 1]))), "AC179", "the pose of lid has a matrix"),
    (lambda: scene(Box((1, 1, 1)), pose=(0, 0, 0)), "AC179", "the pose of lid is"),
    (lambda: ContactScene(bodies=other(None)), "AC179", "bodies of the scene are None"),
    (lambda: ContactScene(bodies=other((Box((1, 1, 1)),))), "AC179", "are Box"),
    (lambda: ball(reach=((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))), "AC179", "the reach of ball"),
    (lambda: ContactScene(bodies=(), skin=0.0), "AC179", "the skin"),
    (lambda: ContactScene(bodies=(), keep=-1), "AC179", "keep -1 pairs"),
    (lambda: force("mpr"), "AC173", "'mpr'"),
    (lambda: force(ConvexLevel(Sphere(0.1), ((0.0, 0.0, math.nan), IDENTITY), "egg")), "AC179", "the pose of egg"),
)


@pytest.mark.parametrize(("make", "code", "fact"), CASES)
def test_what_cannot_be_is_refused(make: Callable[[], object], code: str, fact: str) -> None:
    with fails_with(DeclarationError, code, match=fact):
        make()


def stl(path: Path, triangles: Any) -> str:
    corners = "".join("outer loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in t) for t in triangles)
    path.write_text(f"solid s\n{corners}endsolid s\n")
    return str(path)


def test_meshes_with_holes_are_refused(tmp_path: Path) -> None:
    """Of the corners of an open box the hull would be a closed one, which is another body."""
    whole = ConvexHull.from_stl(stl(tmp_path / "whole.stl", FACES), scale=0.01, body="lid")
    assert whole.bounding_box()[1] == (0.01, 0.01, 0.01)
    with fails_with(DeclarationError, "AC176", match="the mesh of lid is not closed"):
        ConvexHull.from_stl(stl(tmp_path / "open.stl", FACES[:-1]), body="lid")
    for scale in (0.0, -1.0, math.nan, "mm"):
        with pytest.raises(DeclarationError, match="the mesh of lid is scaled by"):
            ConvexHull.from_stl(str(tmp_path / "whole.stl"), scale=other(scale), body="lid")
    with pytest.raises(DeclarationError, match="the mesh of lid is not an STL file"):
        ConvexHull.from_stl(stl(tmp_path / "empty.stl", []), body="lid")
