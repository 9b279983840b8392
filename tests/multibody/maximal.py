"""Rigid mechanisms in maximal coordinates, independent of the compiler: what its loops are compared with.

Every body has the position of its centre of mass, a quaternion (scalar part first) and two velocities in world axes.
Constraints are built of three primitives (E. Haug, Computer Aided Kinematics and Dynamics of Mechanical Systems, 1989,
chapter 9): points that coincide, directions at right angles, and an offset at right angles to a direction. Motion
follows from the equations of motion bordered by the second derivatives of the constraints; positions and velocities
are put back onto the constraints as it goes. Mechanisms of one kind are integrated together: all arrays have them as
their first axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Vector = NDArray[np.float64]
Pose = tuple[Vector, Vector, Vector, Vector]
"""Positions (m, n, 3), quaternions (m, n, 4), velocities and angular velocities (m, n, 3) of n bodies each."""
GROUND = -1
_PIECE = 0.05  # seconds after which positions and velocities are put back onto the constraints


@dataclass(frozen=True)
class Primitive:
    """One constraint between bodies `a` and `b`: points `p`, `q` and directions `u`, `v` are fixed in them.

    "point": both points coincide; "normal": u is at right angles to v; "offset": the way from q to p is at right
    angles to u.
    """

    kind: str
    a: int
    b: int
    p: Vector = field(default_factory=lambda: np.zeros(3))
    q: Vector = field(default_factory=lambda: np.zeros(3))
    u: Vector = field(default_factory=lambda: np.zeros(3))
    v: Vector = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Mechanism:
    """Bodies with masses [kg] and inertia tensors [kg.m2] about their centres, and independent constraints."""

    masses: Vector
    inertias: Vector
    constraints: tuple[Primitive, ...]


class Mechanisms:
    """Mechanisms of one kind: the same constraints between the same bodies, with other numbers."""

    def __init__(self, members: Sequence[Mechanism], gravity: Vector) -> None:
        self.masses = np.array([m.masses for m in members])
        self.inertias = np.array([m.inertias for m in members])
        self.gravity = gravity
        self.groups: list[tuple[str, NDArray[np.intp], NDArray[np.intp], Vector]] = []
        for kind in ("point", "normal", "offset"):
            own = [[c for c in m.constraints if c.kind == kind] for m in members]
            if own[0]:
                a, b = (np.array([getattr(c, side) for c in own[0]]) for side in "ab")
                self.groups.append((kind, a, b, np.array([[(c.p, c.q, c.u, c.v) for c in row] for row in own])))

    def motion(self, pose: Pose, time: float, rtol: float = 1e-8) -> Pose:
        """The pose after `time` [s]."""
        pieces = max(1, int(np.ceil(time / _PIECE)))
        sizes = np.cumsum([part.size for part in pose])[:-1]
        for _ in range(pieces):
            pose = self.projected(pose)
            y0 = np.concatenate([part.ravel() for part in pose])
            done = solve_ivp(self._rates, (0.0, time / pieces), y0, "DOP853", rtol=rtol, atol=rtol, args=(sizes,))
            if not done.success:
                raise RuntimeError(done.message)
            pose = self._parts(done.y[:, -1], sizes)
        return self.projected(pose)

    def gaps(self, pose: Pose) -> tuple[Vector, Vector]:
        """How far positions, and velocities, are off the constraints; shapes (m,)."""
        g, J, _ = self._constraints(pose)
        return np.abs(g).max(axis=1), np.abs(_times(J, _joined(pose[2], pose[3]))).max(axis=1)

    def energies(self, pose: Pose) -> Vector:
        """Kinetic and potential energies [J], shape (m,)."""
        r, Q, v, w = pose
        tensors = self._tensors(rotations(Q))
        kinetic = 0.5 * np.sum(self.masses * np.sum(v * v, axis=2), axis=1) + 0.5 * np.sum(
            w * _times(tensors, w), (1, 2)
        )
        return np.asarray(kinetic - np.sum(self.masses * (r @ self.gravity), axis=1))

    def projected(self, pose: Pose) -> Pose:
        """Positions, then velocities, put onto the constraints by the shortest way."""
        r, Q, v, w = pose
        shape = (*r.shape[:2], 6)
        for _ in range(3):
            Q = Q / np.linalg.norm(Q, axis=2, keepdims=True)
            g, J, _ = self._constraints((r, Q, v, w))
            step = _shortest(J, -g).reshape(shape)
            r, Q = r + step[..., :3], Q + _spun(Q, step[..., 3:])
        Q = Q / np.linalg.norm(Q, axis=2, keepdims=True)
        _, J, _ = self._constraints((r, Q, v, w))
        step = _shortest(J, -_times(J, _joined(v, w))).reshape(shape)
        return r, Q, v + step[..., :3], w + step[..., 3:]

    def _parts(self, y: Vector, sizes: Vector) -> Pose:
        m, n = self.masses.shape
        r, Q, v, w = (part.reshape(m, n, -1) for part in np.split(y, sizes))
        return r, Q, v, w

    def _rates(self, _: float, y: Vector, sizes: Vector) -> Vector:
        pose = self._parts(y, sizes)
        Q, v, w = pose[1:]
        acceleration = self._accelerations(pose)
        parts = (v, _spun(Q, w), acceleration[..., :3], acceleration[..., 3:])
        return np.concatenate([part.ravel() for part in parts])

    def _tensors(self, R: Vector) -> Vector:
        return np.asarray(R @ self.inertias @ R.swapaxes(2, 3))

    def _accelerations(self, pose: Pose) -> Vector:
        m, n = self.masses.shape
        tensors, w = self._tensors(rotations(pose[1])), pose[3]
        turned = np.asarray(np.linalg.inv(tensors), dtype=float)
        free = np.concatenate(
            [np.broadcast_to(self.gravity, (m, n, 3)), _times(turned, -np.cross(w, _times(tensors, w)))], axis=2
        )
        _, J, gamma = self._constraints(pose)
        blocks = J.reshape(m, -1, n, 6)
        linear = blocks[..., :3] / self.masses[:, None, :, None]
        angular = np.einsum("mknj,mnji->mkni", blocks[..., 3:], turned)
        mobile = np.concatenate([linear, angular], axis=3).reshape(J.shape)
        force = np.linalg.solve(mobile @ J.swapaxes(1, 2), (gamma - _times(J, free.reshape(m, -1)))[..., None])
        return np.asarray(free + (mobile.swapaxes(1, 2) @ force).reshape(m, n, 6))

    def _constraints(self, pose: Pose) -> tuple[Vector, Vector, Vector]:
        """Values g (m, k), Jacobians J (m, k, 6n) by (v, w) of all bodies, and gamma (m, k) with J a = gamma."""
        r, Q, v, w = (_grounded(part) for part in pose)
        Q[:, -1, 0] = 1.0
        R = rotations(Q)
        m, n = r.shape[:2]
        found: list[list[Vector]] = [[], [], []]
        for kind, a, b, own in self.groups:
            sides = _Sides(a, b, own, r, R, v, w)
            g, first, second, gamma = getattr(sides, kind)()
            width = g.shape[2]
            J = np.zeros((m, len(a), width, n, 6))
            each = np.arange(len(a))
            J[:, each, :, a] += first.swapaxes(0, 1)
            J[:, each, :, b] += second.swapaxes(0, 1)
            found[0].append(g.reshape(m, -1))
            found[1].append(J[..., :-1, :].reshape(m, len(a) * width, -1))
            found[2].append(gamma.reshape(m, -1))
        return tuple(np.concatenate(parts, axis=1) for parts in found)  # type: ignore[return-value]


class _Sides:
    """Points and directions of constraints in world axes, with their rates; shapes (m, k, 3)."""

    def __init__(
        self,
        a: NDArray[np.intp],
        b: NDArray[np.intp],
        own: Vector,
        r: Vector,
        R: Vector,
        v: Vector,
        w: Vector,
    ) -> None:
        p, q, u, d = (own[:, :, k] for k in range(4))
        self.wa, self.wb = w[:, a], w[:, b]
        self.p, self.q, self.u, self.v = _times(R[:, a], p), _times(R[:, b], q), _times(R[:, a], u), _times(R[:, b], d)
        self.d = r[:, a] + self.p - r[:, b] - self.q
        dp, dq = np.cross(self.wa, self.p), np.cross(self.wb, self.q)
        self.rate = v[:, a] + dp - v[:, b] - dq
        self.centripetal = np.cross(self.wa, dp) - np.cross(self.wb, dq)

    def point(self) -> tuple[Vector, Vector, Vector, Vector]:
        one = np.broadcast_to(np.eye(3), (*self.p.shape, 3))
        first = np.concatenate([one, -_skew(self.p)], axis=3)
        return self.d, first, np.concatenate([-one, _skew(self.q)], axis=3), -self.centripetal

    def normal(self) -> tuple[Vector, Vector, Vector, Vector]:
        u, v = self.u, self.v
        n = np.cross(u, v)
        moved = np.cross(np.cross(self.wa, u), v) + np.cross(u, np.cross(self.wb, v))
        row = np.concatenate([np.zeros_like(n), n], axis=2)[:, :, None]
        return _dot(u, v), row, -row, -_dot(self.wa - self.wb, moved)

    def offset(self) -> tuple[Vector, Vector, Vector, Vector]:
        u, d = self.u, self.d
        du = np.cross(self.wa, u)
        first = np.concatenate([u, np.cross(self.p, u) + np.cross(u, d)], axis=2)[:, :, None]
        second = -np.concatenate([u, np.cross(self.q, u)], axis=2)[:, :, None]
        rest = _dot(self.wa, np.cross(du, d) + np.cross(u, self.rate)) + _dot(du, self.rate)
        return _dot(u, d), first, second, -rest - _dot(u, self.centripetal)


def _grounded(part: Vector) -> Vector:
    """With the ground as the last body, at rest."""
    return np.concatenate([part, np.zeros((len(part), 1, part.shape[2]))], axis=1)


def _times(matrices: Vector, vectors: Vector) -> Vector:
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _joined(v: Vector, w: Vector) -> Vector:
    return np.asarray(np.concatenate([v, w], axis=2).reshape(len(v), -1), dtype=float)


def _dot(a: Vector, b: Vector) -> Vector:
    return np.asarray(np.sum(a * b, axis=2, keepdims=True))


def _shortest(J: Vector, right: Vector) -> Vector:
    across = J.swapaxes(1, 2)
    return np.asarray((across @ np.linalg.solve(J @ across, right[..., None]))[..., 0])


def _skew(a: Vector) -> Vector:
    x, y, z = np.moveaxis(a, -1, 0)
    o = np.zeros_like(x)
    return np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), (0, 1), (-2, -1))


def _spun(Q: Vector, w: Vector) -> Vector:
    """Rates of quaternions at angular velocities in world axes."""
    scalar = -np.sum(Q[..., 1:] * w, axis=-1, keepdims=True)
    return 0.5 * np.concatenate([scalar, Q[..., :1] * w + np.cross(w, Q[..., 1:])], axis=-1)


def rotations(Q: Vector) -> Vector:
    """Rotation matrices from body to world, shape (..., 3, 3), of quaternions of any length, shape (..., 4)."""
    s, x, y, z = np.moveaxis(Q / np.linalg.norm(Q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - s * z), 2 * (x * z + s * y)],
        [2 * (x * y + s * z), 1 - 2 * (x * x + z * z), 2 * (y * z - s * x)],
        [2 * (x * z - s * y), 2 * (y * z + s * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion(R: Vector) -> Vector:
    """The quaternion, scalar part first, of a rotation matrix from body to world (I. Bar-Itzhack, 2000)."""
    vectors = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
        ]
    )
    found = np.linalg.eigh(vectors)[1][:, -1]
    return np.array([found[3], *found[:3]])
