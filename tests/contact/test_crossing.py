"""MPR with a line as its ray: where an axis enters and leaves a shape, against closed forms."""

from __future__ import annotations

import subprocess
from pathlib import Path
from shutil import which
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from acausal.library.contact import Box, Capsule, Cone, ConvexHull, Cylinder, HalfSpace, Shape, Sphere
from acausal.library.contact.collide.axis.crossing import crossing_function

Array = NDArray[np.float64]
GRAZING = 0.03


def cloud(n: int, *extent: float) -> ConvexHull:
    return ConvexHull(np.random.default_rng(n).normal(size=(n, 3)) * (extent or 0.05))


SHAPES: dict[str, Shape] = {
    "plate": Box((0.1, 0.1, 0.01)),
    "sheet": Box((0.1, 0.07, 1e-5)),
    "bar": Box((0.001, 0.02, 3.0)),
    "hull of 8": cloud(8, 0.05, 0.01, 0.1),
    "hull of 60": cloud(60),
    "ball": Sphere(0.03),
    "shaft": Cylinder(0.02, 0.1),
    "disc": Cylinder(0.05, 0.002),
    "capsule": Capsule(0.02, 0.05),
    "cone": Cone(0.03, 0.06),
}


def answer(shape: Shape, p: Any, e: Any) -> tuple[float, float, bool, Array]:
    """depth, beyond, beside, normal."""
    found = [np.asarray(x.full()).ravel() for x in crossing_function(shape).call([ca.DM(p), ca.DM(e)])]
    return float(found[0][0]), float(found[1][0]), bool(found[2][0]), found[3]


def lines(shape: Shape, n: int) -> list[tuple[Array, Array]]:
    """Lines through the middle half of the shape's bounds, and beside it, with a point before, in or behind it."""
    rng = np.random.default_rng(5)
    low, high = (np.array(c) for c in shape.bounding_box())
    turns = rng.normal(size=(n, 3))
    units = turns / np.linalg.norm(turns, axis=1)[:, None]
    places = (low + high) / 2 + (high - low) * rng.uniform(-0.7, 0.7, size=(n, 3))
    return [(p + t * e * (high - low).max(), e) for p, e, t in zip(places, units, rng.uniform(-1, 1, n), strict=True)]


def clipped(faces: Array, p: Array, e: Array) -> tuple[float, float]:
    """Depth behind entry and exit of a line in an intersection of half-spaces n x + d <= 0: closed form."""
    slope, height = faces[:, :3] @ e, faces[:, :3] @ p + faces[:, 3]
    ways = height / slope
    return float(ways[slope < 0].min()), float(ways[slope > 0].max())


def half_spaces(shape: Shape) -> Array:
    if isinstance(shape, ConvexHull):
        return np.array(shape._hull[1])
    assert isinstance(shape, Box)
    return np.array([[*row, -h] for row, h in zip([*np.eye(3), *-np.eye(3)], [*shape.half] * 2, strict=True)])


@pytest.mark.parametrize("name", ["plate", "sheet", "bar", "hull of 8", "hull of 60"])
def test_flat_faces_are_the_clipped_line(name: str) -> None:
    """Exact to rounding, wherever the point is on the line; a line that misses is beside."""
    shape = SHAPES[name]
    faces, met = half_spaces(shape), 0
    for p, e in lines(shape, 300):
        depth, beyond = clipped(faces, p, e)
        got = answer(shape, p, e)
        if np.abs(faces[:, :3] @ e).min() < GRAZING:
            continue
        assert got[2] == (beyond > depth)
        if not got[2]:
            met += 1
            assert got[0] == pytest.approx(depth, abs=1e-12)
            assert got[1] == pytest.approx(beyond, abs=1e-12)
    assert met > 30


def off_surface(shape: Shape, x: Array) -> float:
    """How far a point is outside of a round shape, negative inside, and 0 on its surface [m]."""
    across = float(np.hypot(x[0], x[1]))
    if isinstance(shape, Sphere):
        return float(np.linalg.norm(x)) - shape.radius
    if isinstance(shape, Cylinder):
        return float(max(across - shape.radius, abs(x[2]) - shape.length / 2))
    if isinstance(shape, Capsule):
        return float(np.hypot(across, max(abs(x[2]) - shape.length / 2, 0.0))) - shape.radius
    assert isinstance(shape, Cone)
    return float(max(across - x[2] * shape.radius / shape.length, x[2] - shape.length))


@pytest.mark.parametrize("name", ["ball", "shaft", "disc", "capsule", "cone"])
def test_round_shapes_are_entered_and_left_on_their_surface(name: str) -> None:
    """Two points of a line on a convex surface are all there are; a line that misses stays outside."""
    shape, met = SHAPES[name], 0
    for p, e in lines(shape, 300):
        depth, beyond, beside, normal = answer(shape, p, e)
        if beside:
            along = np.linspace(-0.3, 0.3, 601)
            inside = -min(off_surface(shape, p + t * e) for t in along)
            assert inside < 1e-3, "a line that is beside may graze"
            continue
        met += 1
        assert off_surface(shape, p - depth * e) == pytest.approx(0.0, abs=1e-12)
        assert off_surface(shape, p - beyond * e) == pytest.approx(0.0, abs=1e-12)
        assert depth > beyond
        assert normal @ e < 0
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
    assert met > 50


def test_corners_and_edges_that_are_hit_exactly() -> None:
    """Any of the faces that meet there will do."""
    box = SHAPES["plate"]
    for p in ((0.05, 0.05, 0.005), (0.05, 0.0, 0.005), (0.0, -0.05, 0.005)):
        inward = -np.array([np.sign(x) for x in p]) - (0.1, 0.2, 0.0)
        assert answer(box, p, inward / np.linalg.norm(inward))[0] == pytest.approx(0.0, abs=1e-10)
    depth, beyond, beside, normal = answer(box, (0.0, 0.0, 0.001), (0.0, 0.0, 1.0))
    assert depth == 0.006
    assert beyond == pytest.approx(-0.004)
    assert not beside
    np.testing.assert_allclose(normal, (0.0, 0.0, -1.0), atol=1e-15)


def test_beside_counts_from_where_the_shape_begins() -> None:
    depth, _, beside, _ = answer(Box((0.1, 0.1, 0.02)), (0.2, 0.0, -0.05), (0.0, 0.0, 1.0))
    assert beside
    assert depth == pytest.approx(-0.04)
    ground = answer(HalfSpace(), (0.0, 0.3, -0.002), (0.0, 0.6, -0.8))
    assert ground[0] == pytest.approx(0.002 / 0.8)
    assert not ground[2]


@pytest.mark.parametrize("name", ["plate", "hull of 60", "ball", "shaft", "capsule", "cone"])
def test_derivatives_are_those_of_differences(name: str) -> None:
    """Gradients of depth and normal, and second derivatives of the depth, by central differences."""
    f = crossing_function(SHAPES[name])
    x = ca.SX.sym("x", 6)
    y = ca.vertcat(*f.call([x[:3], x[3:]]))
    value, slope = ca.Function("y", [x], [y]), ca.Function("dy", [x], [ca.jacobian(y, x)])
    gradient, hessian = (ca.Function("g", [x], [d]) for d in reversed(ca.hessian(y[0], x)))
    h, seen = 1e-6, 0
    for p, e in lines(SHAPES[name], 40):
        at, steps = np.hstack([p, e]), h * np.eye(6)
        result = np.asarray(value(at)).ravel()
        if result[2] or abs(result[3:] @ e) < 0.3:
            continue
        sides = [[np.asarray(g(at + s * d)).ravel() for s in (1, -1) for d in steps] for g in (value, gradient)]
        first, second = (np.array(rows[:6]).T - np.array(rows[6:]).T for rows in sides)
        if np.abs(first).max() > 1e-3:  # over an edge
            continue
        seen += 1
        np.testing.assert_allclose(np.asarray(slope(at)), first / (2 * h), atol=1e-5)
        scale = max(1.0, np.abs(second).max() / (2 * h))
        np.testing.assert_allclose(np.asarray(hessian(at)) / scale, second / (2 * h) / scale, atol=1e-5)
    assert seen > 3


@pytest.mark.skipif(which("gcc") is None, reason="no C compiler")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["plate", "hull of 60", "cone"])
def test_generated_c_says_the_same(name: str, tmp_path: Path) -> None:
    f = crossing_function(SHAPES[name])
    generator = ca.CodeGenerator("crossing.c")
    generator.add(f)
    (tmp_path / "crossing.c").write_text(generator.dump())
    library = tmp_path / "crossing.so"
    subprocess.run(["gcc", "-O1", "-shared", "-fPIC", tmp_path / "crossing.c", "-o", library, "-lm"], check=True)
    in_c = ca.external("crossing", str(library))
    for p, e in lines(SHAPES[name], 60):
        for one, other in zip(f.call([ca.DM(p), ca.DM(e)]), in_c.call([ca.DM(p), ca.DM(e)]), strict=True):
            np.testing.assert_allclose(np.asarray(one), np.asarray(other), atol=1e-12)
