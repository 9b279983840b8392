"""Triangle meshes of simple shapes, lengths in m, triangles counter-clockwise seen from outside."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_AROUND = 32
"""Corners of a circle."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Positions and unit normals, shape (n, 3); triangles, shape (m, 3), as rows of positions."""

    positions: Array
    normals: Array
    triangles: NDArray[np.int64]

    def placed(self, r: ArrayLike = (0.0, 0.0, 0.0), R: ArrayLike | None = None) -> Mesh:
        """Turned by `R` and then moved by `r`."""
        turned = np.eye(3) if R is None else np.asarray(R, dtype=float)
        return Mesh(self.positions @ turned.T + np.asarray(r, dtype=float), self.normals @ turned.T, self.triangles)

    def inside_out(self) -> Mesh:
        """Seen from inside only."""
        return Mesh(self.positions, -self.normals, self.triangles[:, ::-1])


def along(direction: ArrayLike) -> Array:
    """A rotation whose third column is the direction, of any length; shape (..., 3) to (..., 3, 3)."""
    e = np.asarray(direction, dtype=float)
    length = np.linalg.norm(e, axis=-1, keepdims=True)
    z = np.where(length > 0.0, e / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
    # use the axis farthest from the direction, the same for all rows, so that a slowly turning frame does not jump
    least = np.argmin(np.abs(z).reshape(-1, 3).max(axis=0))
    x = np.cross(np.eye(3)[least], z)
    size = np.linalg.norm(x, axis=-1, keepdims=True)
    x = np.where(size > 1e-9, x / np.where(size > 1e-9, size, 1.0), np.cross(np.eye(3)[(least + 1) % 3], z))
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """All in one."""
    starts = np.cumsum([0, *(len(m.positions) for m in meshes)])
    return Mesh(
        np.concatenate([m.positions for m in meshes]),
        np.concatenate([m.normals for m in meshes]),
        np.concatenate([m.triangles + start for m, start in zip(meshes, starts, strict=False)]),
    )


def revolved(profile: Sequence[tuple[float, float]], smooth: bool = False) -> Mesh:
    """Surface of revolution of a line of points (radius, z) about z; its outer side is on the right, going up.

    `smooth` rounds the shading over the corners of the line.
    """
    points = np.array(profile, dtype=float)
    steps = np.diff(points, axis=0)
    flat = np.stack([steps[:, 1], -steps[:, 0]], axis=1)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    below, above = flat, flat
    if smooth:
        mean = np.concatenate([[flat[0]], flat[:-1] + flat[1:], [flat[-1]]])
        mean[[0, -1]] = [[0.0, -1.0], [0.0, 1.0]]
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        below, above = mean[:-1], mean[1:]
    angle = np.linspace(0.0, 2.0 * math.pi, _AROUND + 1)
    round_ = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    positions: list[Array] = []
    normals: list[Array] = []
    triangles: list[NDArray[np.int64]] = []
    for k in range(len(steps)):
        start = sum(len(p) for p in positions)
        for (radius, z), (across, up) in ((points[k], below[k]), (points[k + 1], above[k])):
            positions.append(np.column_stack([radius * round_, np.full(len(round_), z)]))
            normals.append(np.column_stack([across * round_, np.full(len(round_), up)]))
        a = start + np.arange(_AROUND)
        d = a + _AROUND + 1
        # for a point on the axis, one of the two triangles vanishes
        if points[k, 0] > 0.0:
            triangles.append(np.stack([a, a + 1, d + 1], axis=1))
        if points[k + 1, 0] > 0.0:
            triangles.append(np.stack([a, d + 1, d], axis=1))
    return Mesh(np.concatenate(positions), np.concatenate(normals), np.concatenate(triangles))


def cylinder(radius: float, length: float, bore: float = 0.0) -> Mesh:
    """A cylinder from z = 0 to `length`, with a bore of radius `bore`."""
    outside = [(bore, 0.0), (radius, 0.0), (radius, length), (bore, length)]
    return revolved([*outside, (bore, 0.0)] if bore > 0.0 else outside)


def cone(radius: float, length: float) -> Mesh:
    """A cone with its base at z = 0 and its tip at `length`."""
    return revolved([(0.0, 0.0), (radius, 0.0), (0.0, length)])


def sphere(radius: float) -> Mesh:
    """A sphere around the origin."""
    return capsule(radius, 0.0)


def capsule(radius: float, length: float) -> Mesh:
    """A cylinder of `length` along z, around the origin, with hemispheres at its ends."""
    angle = np.linspace(-math.pi / 2, math.pi / 2, 18)
    r, z = radius * np.cos(angle), radius * np.sin(angle) + np.where(angle > 0.0, length / 2, -length / 2)
    r[[0, -1]] = 0.0
    return revolved(list(zip(r.tolist(), z.tolist(), strict=True)), smooth=True)


def box(size: ArrayLike) -> Mesh:
    """A box with edges `size`, shape (3,), around the origin."""
    half = np.asarray(size, dtype=float) / 2
    positions: list[Array] = []
    normals: list[Array] = []
    triangles: list[tuple[int, int, int]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            n = side * np.eye(3)[axis]
            u = np.eye(3)[(axis + 1) % 3]
            v = np.cross(n, u)
            corners = [n - u - v, n + u - v, n + u + v, n - u + v]
            k = len(positions)
            positions += [c * half for c in corners]
            normals += [n] * 4
            triangles += [(k, k + 1, k + 2), (k, k + 2, k + 3)]
    return Mesh(np.array(positions), np.array(normals), np.array(triangles))


def hull(points: ArrayLike) -> Mesh:
    """The convex hull of points, shape (n, 3), with flat faces."""
    from scipy.spatial import ConvexHull

    given = np.asarray(points, dtype=float)
    found = ConvexHull(given)
    corners = given[found.simplices]
    normals = found.equations[:, :3]
    turned = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normals) < 0
    corners[turned] = corners[turned][:, ::-1]
    return Mesh(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), np.arange(3 * len(corners)).reshape(-1, 3))


def arrow(radius: float, length: float = 1.0) -> Mesh:
    """An arrow along z from the origin."""
    neck = 0.8 * length
    return revolved([(0.0, 0.0), (radius, 0.0), (radius, neck), (2.2 * radius, neck), (0.0, length)])


def coil(radius: float, turns: int = 8) -> Mesh:
    """A spring along z, of length 1."""
    steps = 16 * turns
    u = np.linspace(0.0, 1.0, steps + 1)
    angle = 2 * math.pi * turns * u
    # narrow at its ends, where it is attached
    wide = radius * np.clip(np.minimum(u, 1.0 - u) / 0.08, 0.0, 1.0)
    line = np.column_stack([wide * np.cos(angle), wide * np.sin(angle), u])
    return tube(line, radius / 6)


def tube(line: Array, radius: float, corners: int = 6) -> Mesh:
    """A tube around a line of points [m], shape (n, 3), open at its ends."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frames = along(tangent)
    angle = np.linspace(0.0, 2 * math.pi, corners, endpoint=False)
    normals = (
        np.cos(angle)[None, :, None] * frames[:, None, :, 0] + np.sin(angle)[None, :, None] * frames[:, None, :, 1]
    )
    positions = line[:, None, :] + radius * normals
    k, j = np.meshgrid(np.arange(len(line) - 1), np.arange(corners), indexing="ij")
    a, b = k * corners + j, k * corners + (j + 1) % corners
    triangles = np.concatenate(
        [np.stack([a, b, b + corners], -1).reshape(-1, 3), np.stack([a, b + corners, a + corners], -1).reshape(-1, 3)]
    )
    return Mesh(positions.reshape(-1, 3), normals.reshape(-1, 3), triangles)


def drill(diameter: float, point_angle: float, length: float) -> tuple[Mesh, Mesh]:
    """(Body of a twist drill, tip at the origin, shank towards -z; its two flutes, which make its rotation visible)."""
    r = diameter / 2
    h = r / math.tan(point_angle / 2)
    body = revolved([(0.0, -length), (r, -length), (r, -h), (0.0, 0.0)])
    ground = -0.75 * length

    def radius(z: Array) -> Array:
        return 1.02 * r * np.minimum(1.0, -z / h)

    return body, merged([_strip(radius, ground, -0.02 * h, start, 4.5 * diameter) for start in (0.0, math.pi)])


def _strip(radius: Callable[[Array], Array], low: float, high: float, start: float, lead: float) -> Mesh:
    """A helical ribbon on a surface of revolution."""
    n, across = 60, 8
    z = np.linspace(low, high, n)[:, None]
    angle = start + 2 * math.pi * z / lead + np.linspace(0.0, 1.1, across)[None, :]
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    positions = np.stack([*np.moveaxis(normals[..., :2], -1, 0) * radius(z), np.broadcast_to(z, angle.shape)], axis=-1)
    k, j = np.meshgrid(np.arange(n - 1), np.arange(across - 1), indexing="ij")
    a = k * across + j
    triangles = [np.stack([a, a + 1, a + across + 1], -1), np.stack([a, a + across + 1, a + across], -1)]
    return Mesh(positions.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate(triangles).reshape(-1, 3))
