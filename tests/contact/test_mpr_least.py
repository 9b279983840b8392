"""No plane is lower than the one found, and the depth is the overlap along the normal: random and symmetric pairs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acausal.library.contact.collide.penetration import collision_function
from acausal.library.contact.collide.shapes import Box, Cone, Cylinder, PointedDrill, Shape, Sphere
from tests.contact.least import HERE, KINDS, PLACES, random_pose, random_shape, wrong
from tests.contact.poses import contact, pose


def test_boxes_leave_by_the_lowest_of_two_faces_that_are_nearly_parallel() -> None:
    """The 15 axes of the separating axis theorem: a face of one box and the cross product of two edges, a few degrees
    apart, differ by some percent."""
    rng = np.random.default_rng(23)
    for _ in range(2):
        a, b = random_shape("box", rng, 0.2), random_shape("box", rng, 0.2)
        for _ in range(24):
            assert wrong(a, b, random_pose(a, b, "anywhere", rng), rng) is None


def test_a_rim_next_to_its_disc() -> None:
    """The plane of the drill's end face is lowest among its neighbours, one at the rim 3.6 degrees away is lower."""
    a, b = PointedDrill(0.144, 0.932, 0.897), PointedDrill(0.193, 2.684, 0.546)
    turn = np.array(
        [[0.227218, 0.321475, -0.919253], [-0.399947, -0.829859, -0.389071], [-0.887927, 0.456057, -0.059986]]
    )
    u, _, v = np.linalg.svd(turn)
    assert wrong(a, b, (0.5463 * np.array([0.806913, 0.304861, 1.673485]), u @ v), np.random.default_rng(1)) is None


def test_a_flank_that_is_nearly_flat_on_a_face() -> None:
    """The plane of the cylinder's end, 1.6 degrees from the face of the box, is lower than that face."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.02859824, 0.99959099], [0.0, -0.99959099, 0.02859824]])
    a, b = Box((0.6658, 0.2311, 0.6881)), Cylinder(0.36, 0.829)
    assert wrong(a, b, (np.array([0.0, 0.26665109, 0.0]), turn), np.random.default_rng(1)) is None


@pytest.mark.parametrize(
    ("a", "b", "depth"),
    [
        pytest.param(Sphere(0.2), Sphere(0.1), 0.3, id="balls"),
        pytest.param(Sphere(0.2), Cone(0.3, 0.5), 0.2, id="ball on a tip"),
        pytest.param(Sphere(0.2), Cylinder(0.3, 0.4), 0.4, id="ball in a cylinder"),
        pytest.param(Cylinder(0.5, 0.2), Box((1.0, 1.0, 0.4)), 0.3, id="plates in each other"),
    ],
)
def test_coincident_origins_have_the_depth_of_a_closed_form(a: Shape, b: Shape, depth: float) -> None:
    """Sum of radii and half lengths, for any turn about the axis."""
    for angle in (0.0, 0.3, math.pi / 4, 2.0):
        assert contact(a, HERE, b, pose((0, 0, 0), (0, 0, angle)))[0] == pytest.approx(depth, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("first", KINDS)
def test_random_pairs(first: str) -> None:
    """A hundred poses of each kind of pair, with proportions of up to 1:50; half of them in places of symmetry.

    Making the function of a pair takes as long as its poses. Of 20 000 poses 15 were too deep once.
    """
    rng = np.random.default_rng(KINDS.index(first))
    found = []
    for second in KINDS[KINDS.index(first) :]:
        a, b = (random_shape(kind, rng, 0.02) for kind in rng.permutation([first, second]).tolist())
        for _ in range(100):
            place = str(rng.choice(PLACES))
            pose_b = random_pose(a, b, place, rng)
            text = wrong(a, b, pose_b, rng)
            if text:
                found.append(f"{a}, {b} at {pose_b[0].tolist()}, {pose_b[1].tolist()}, {place}: {text}")
    collision_function.cache_clear()
    assert not found, "\n".join(found)
