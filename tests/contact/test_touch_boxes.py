"""Points of contact of two boxes at any pose, against coal."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import acausal
from acausal import Component, Equations, Real, as_expr, connect, der, fixed, parameter, part, signal_output, variable
from acausal.library.contact import Box, ContactBody, ContactScene, Coulomb, HuntCrossley, Surfaces
from acausal.library.contact.manifold.point import deepest
from acausal.library.contact.manifold.touch import touches
from acausal.library.drilling import EnergyBalance
from acausal.library.multibody import Body, World
from tests.contact.test_mpr_libraries import coal_answer

A, B = Box((0.1, 0.06, 0.04)), Box((0.05, 0.08, 0.12))
ORIGIN = np.zeros(3), np.eye(3)


class Pair(Component):
    """All points of two boxes, the second at a pose given by parameters."""

    r: Real = parameter(default=(0.0, 0.0, 0.1), unit="m", shape=3)
    R: Real = parameter(default=np.eye(3), shape=(3, 3))
    x: Real = variable(default=fixed(0.0))
    depth: Real = signal_output(unit="m", shape=9)
    share: Real = signal_output(shape=9)
    normal: Real = signal_output(shape=(9, 3))
    deepest: Real = signal_output(unit="m")

    def equations(self) -> Equations:
        points = touches(A, B)(as_expr(np.zeros(3)), as_expr(np.eye(3)), self.r, self.R)
        yield der(self.x) == 0.0
        yield self.depth == as_expr([p.depth for p in points])
        yield self.share == as_expr([1.0 if p.share is None else p.share for p in points])
        yield self.normal == as_expr([[p.normal[k] for k in range(3)] for p in points])
        yield self.deepest == deepest(points)


@cache
def compiled() -> Any:
    return acausal.compile(Pair())


def points(r: Any, R: Any) -> tuple[Any, Any, Any]:
    """Depth, share and normal of all points."""
    found = acausal.simulate(compiled(), stop_time=1e-3, output_interval=1e-3, parameters={"r": r, "R": R})
    return found["depth"][0], found["share"][0], found["normal"][0]


def overlapping(direction: Any, R: Any, depth: float) -> Any:
    """The place of the second box along a direction at which the boxes overlap by a depth, by coal."""
    low, high = 0.0, 0.3
    for _ in range(40):
        middle = (low + high) / 2
        deep = coal_answer(A, ORIGIN, B, (direction * middle, R))[0] > depth
        low, high = (middle, high) if deep else (low, middle)
    return direction * low


def test_the_deepest_point_is_that_of_coal() -> None:
    """At random poses, corners on faces and edges across edges: the depth, and the normal of what counts most."""
    pytest.importorskip("coal", reason="coal is not installed: pip install acausal[test]")
    rng = np.random.default_rng(3)
    kinds = {"edges": 0, "corner": 0}
    for depth in rng.uniform(-1e-4, 6e-3, 30):
        R, away = Rotation.from_quat(rng.normal(size=4)).as_matrix(), rng.normal(size=3)
        r = overlapping(away / np.linalg.norm(away), R, depth)
        expected, normal = coal_answer(A, ORIGIN, B, (r, R))
        depths, shares, normals = points(r, R)
        if 0.0 < shares[0] < 1.0:
            continue  # edges overlap nearly as much as faces: both count
        best = int(np.argmax(np.where(shares > 0.5, depths, -1.0)))
        n = normals[best]
        if min(np.abs(n).max(), np.abs(R.T @ n).max()) > np.cos(np.radians(10.0)):
            continue  # a face on a face, whose corners are moved to the edges
        # The overlap along a direction, which is never less than the depth.
        assert depths[best] == pytest.approx(A.half @ np.abs(n) + B.half @ np.abs(R.T @ n) - n @ r, abs=1e-12)
        if depths[best] < expected - 1e-6:
            continue  # coal ended on a higher face
        kinds["edges" if best == 0 else "corner"] += 1
        assert depths[best] == pytest.approx(expected, abs=1e-9)
        assert normals[best] == pytest.approx(normal, abs=1e-9)
    assert min(kinds.values()) >= 5


def overlaps(r: Any, R: Any) -> tuple[float, float]:
    """The least overlap along the normals of faces [m], and across two edges: separating axes of Gottschalk et al."""

    def least(axes: Any) -> float:
        units = [n / np.linalg.norm(n) for n in axes if np.linalg.norm(n) > 1e-2]
        return float(min(A.half @ np.abs(n) + B.half @ np.abs(R.T @ n) - np.abs(n @ r) for n in units))

    return least([*np.eye(3), *R.T]), least([np.cross(u, v) for u in np.eye(3) for v in R.T])


def test_the_depth_is_that_of_the_deepest_point_that_counts() -> None:
    """At random poses, tilted by more than 10 degrees: the least overlap, that of faces or of edges.

    Corners that do not count were up to 0.04 m behind faces.
    """
    rng = np.random.default_rng(1)
    kinds = {"edges": 0, "corner": 0, "apart": 0}
    for wanted in rng.uniform(-6e-3, 6e-3, 60):
        R, away = Rotation.from_quat(rng.normal(size=4)).as_matrix(), rng.normal(size=3)
        if np.abs(R).max() > np.cos(np.radians(10.0)):
            continue
        low, high = 0.0, float(0.5 / np.linalg.norm(away))
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if min(overlaps(away * middle, R)) > wanted else (low, middle)
        faces, edges = overlaps(away * low, R)
        found = acausal.simulate(compiled(), stop_time=1e-3, output_interval=1e-3, parameters={"r": away * low, "R": R})
        depth = float(found["deepest"][0])
        if min(faces, edges) < 0.0:
            kinds["apart"] += 1
            assert depth < 0.0
        elif edges < 0.9 * faces:  # from there edges have all of the contact
            kinds["edges"] += 1
            assert depth == pytest.approx(edges, abs=1e-9)
        elif edges < faces:  # both may count: the corner, where it is not beside the other box
            assert edges - 1e-9 < depth < faces + 1e-9
        else:
            kinds["corner"] += 1
            assert depth == pytest.approx(faces, abs=1e-9)
    assert min(kinds.values()) >= 5


def test_edges_that_are_apart_do_not_push() -> None:
    """Two bars across each other on their edges, 1 um apart: corners behind the faces of the other do not count."""
    turn = Rotation.from_euler("xyz", [45, 0, 0], degrees=True)
    across = turn.as_matrix().T @ Rotation.from_euler("xyz", [0, 45, 0], degrees=True).as_matrix()
    # Seen from the first bar its edge is above: half diagonals of both, along its own diagonal.
    up = turn.as_matrix().T @ np.array([0.0, 0.0, 1.0])
    height = np.abs(up) @ A.half + np.abs(across.T @ up) @ B.half
    for gap in (1e-6, -1e-6):
        depths, shares, normals = points(up * (height + gap), across)
        deepest = np.where(shares > 0.0, depths, -1.0).max()
        assert deepest == pytest.approx(-gap, abs=1e-12)
        assert normals[int(np.argmax(shares))] == pytest.approx(up, abs=1e-12)


class Tumbling(Component):
    """A box that falls on another one, turned and turning."""

    world: World = part()
    box: Body = part()
    scene: ContactScene = part()
    balance: EnergyBalance = part()
    by_rate: EnergyBalance = part()

    def build(self) -> None:
        self.world = World(n=(0.0, 0.0, -1.0))
        half = 0.2
        self.box = Body(
            m=1.0,
            I_11=1e-3,
            I_22=1e-3,
            I_33=1e-3,
            r_0=fixed((0.004, 0.002, 0.095)),
            v_0=fixed((0.1, 0.0, 0.0)),
            Q=fixed((0.6 * math.sin(half), 0.8 * math.sin(half), 0.0, math.cos(half))),
            w_a=fixed((0.0, 1.0, 0.5)),
        )
        self.scene = ContactScene(
            bodies=(
                ContactBody(name="table", shape=Box((0.3, 0.3, 0.1)), at_rest=True),
                ContactBody(name="box", shape=Box((0.06, 0.04, 0.05))),
            ),
            surfaces=Surfaces(law=HuntCrossley(k=1e5, n=1.5, e=0.5, v_0=0.5), friction=Coulomb(mu=0.3)),
        )
        self.balance = EnergyBalance(
            P_source=self.box.m * (self.world.g_0 @ self.box.v_0),
            P_cutting=0.0,
            P_friction=self.scene.power_friction,
            P_compliant=self.scene.power_normal,
            E_compliant=self.scene.energy,
            E=self.box.m / 2 * (self.box.v_0 @ self.box.v_0)
            + self.box.I_11 / 2 * (self.box.w_a @ self.box.w_a)
            + self.scene.energy,
        )
        self.by_rate = EnergyBalance(P_source=0.0, P_cutting=0.0, P_damping=self.scene.power_damping)

    def equations(self) -> Equations:
        yield connect(self.box.frame_a, self.scene.frame("box"))


@pytest.mark.slow
def test_a_tumbling_box_accounts_for_its_energy() -> None:
    """From corner to edge to face: what points take that fade is part of the losses, and small.

    Losses are what went in and is not stored, or the integral of their power: the same.
    """
    r = acausal.simulate(Tumbling(), stop_time=0.3, tolerance=1e-8, solver="idas")
    assert r["box.r_0"][-1][2] < 0.08
    work = float(r.final("balance.W_source"))
    assert np.abs(r["balance.residual"]).max() < 1e-6 * work
    assert r["balance.W_damping"] == pytest.approx(r["by_rate.W_damping"], abs=1e-6 * work)
    assert r.final("balance.W_damping") > 0.1 * work
    steps = np.diff(r.time)
    fading = r["scene.contacts[0].power_fading"]
    assert np.abs(np.sum((fading[1:] + fading[:-1]) / 2 * steps)) < 0.1 * work
