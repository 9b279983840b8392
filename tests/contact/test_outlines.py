"""Where all bodies of a scene are, and how far they have moved, against points of their surfaces one by one."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from acausal.library.contact import Box, Capsule, ContactBody, Cylinder, HalfSpace, Shape, Sphere
from acausal.library.contact.scene.outlines import Outlines
from acausal.library.multibody import axis_rotation

Array = NDArray[np.float64]
POSE = (0.1, -0.2, 0.3), axis_rotation((0.0, 1.0, 0.0), 0.7)


def surface(shape: Shape) -> Array:
    """Points of the surface that are farthest from its centre in some direction [m]."""
    rng = np.random.default_rng(1)
    if isinstance(shape, Box):
        return np.array(list(product(*((-s / 2, s / 2) for s in shape.size))))
    way = rng.normal(size=(400, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    if isinstance(shape, Sphere):
        return np.asarray(shape.radius * way)
    assert isinstance(shape, Cylinder | Capsule)
    ends = np.array([[0.0, 0.0, -shape.length / 2], [0.0, 0.0, shape.length / 2]])
    if isinstance(shape, Capsule):
        return np.concatenate([end + shape.radius * way for end in ends])
    around = np.linspace(0.0, 2 * np.pi, 400)
    rim = shape.radius * np.column_stack([np.cos(around), np.sin(around), np.zeros(400)])
    return np.concatenate([end + rim for end in ends])


SHAPES = (Box((0.1, 0.2, 0.3)), Sphere(0.05), Cylinder(0.03, 0.4), Capsule(0.02, 0.3))


def poses(rng: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Random places [m] and rotations."""
    turns = [np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(n)]
    return rng.normal(size=(n, 3)), np.array([q * np.sign(np.linalg.det(q)) for q in turns])


def reach(body: ContactBody, pose: tuple[Array, Array], ways: Array) -> Array:
    """How far the surface of a body in a pose reaches along each direction [m]: it and its support are the same."""
    own = np.array(POSE[0]) + surface(body.shape) @ np.array(POSE[1]).T
    return np.asarray(((pose[0] + own @ pose[1].T) @ ways.T).max(axis=0))


BODIES = [ContactBody(name=f"b{k}", shape=shape, pose=POSE) for k, shape in enumerate(SHAPES)]


def test_nothing_has_moved_farther_and_nothing_is_outside() -> None:
    """Two convex surfaces are as far apart as their supports differ in some direction; rims have 400 points."""
    rng = np.random.default_rng(0)
    ways = np.concatenate([np.eye(3), -np.eye(3), rng.normal(size=(200, 3))])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    outlines, before, others = Outlines.of(BODIES), poses(rng, 4), [poses(rng, 4) for _ in range(5)]
    bounds = outlines.moved(before, np.array([r for r, _ in others]), np.array([R for _, R in others]))
    low, high = outlines.boxes(*before)
    for k, body in enumerate(BODIES):
        there = reach(body, (before[0][k], before[1][k]), ways)
        assert (there[:3] <= high[k] + 1e-12).all()
        assert (there[3:6] <= -low[k] + 1e-12).all()
        for (r, R), bound in zip(others, bounds, strict=True):
            assert np.abs(reach(body, (r[k], R[k]), ways) - there).max() <= bound + 1e-5


def test_what_does_not_turn_has_moved_as_far_as_its_frame() -> None:
    rng = np.random.default_rng(2)
    (r, R), shift = poses(rng, 4), rng.normal(size=(6, 4, 3))
    bounds = Outlines.of(BODIES).moved((r, R), r + shift, np.array([R] * 6))
    np.testing.assert_allclose(bounds, np.linalg.norm(shift, axis=2).max(axis=1), rtol=1e-12)


def test_what_has_no_end_has_moved_anywhere_when_it_has_moved_at_all() -> None:
    outlines = Outlines.of([ContactBody(name="ground", shape=HalfSpace()), ContactBody(name="ball", shape=Sphere(0.1))])
    r, R = np.zeros((2, 3)), np.array([np.eye(3)] * 2)
    later = np.array([r, r])
    later[1, 0, 2] = 1e-9
    assert outlines.moved((r, R), later, np.array([R, R])).tolist() == [0.0, np.inf]
    low, high = outlines.boxes(r, R)
    assert high[0].tolist() == [np.inf, np.inf, 0.0]
    assert low[1].tolist() == [-0.1, -0.1, -0.1]
