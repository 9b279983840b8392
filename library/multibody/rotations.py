"""Rotations as expressions, for the equations of joints, bodies and sensors.

A rotation `R` transforms components in frame b into components in frame a, as `Frame.R` does for the world. Entries
that are zero or one for a literal axis stay literal, so that the equations of a joint about z are those of a plane
rotation.
"""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import TYPE_CHECKING

from acausal import Expr, as_expr, atan2, cos, cross, dot, sin, sqrt

if TYPE_CHECKING:
    from acausal.library.multibody.frames import Frame
    from acausal.library.multibody.orientation import Vector


def planar_rotation(e: Vector, phi: Expr) -> Expr:
    """Rotation by `phi` [rad] about the literal unit vector `e`, shape (3,), as a 3x3 expression (Rodrigues).

    The result has shape (3, 3).
    """
    c, s = cos(phi), sin(phi)
    turned = ((0.0, -e[2], e[1]), (e[2], 0.0, -e[0]), (-e[1], e[0], 0.0))
    return as_expr([[_entry(e[i] * e[j], float(i == j), turned[i][j], c, s) for j in range(3)] for i in range(3)])


def _entry(along: float, diagonal: float, turned: float, c: Expr, s: Expr) -> Expr:
    terms = [f if k == 1.0 else -f if k == -1.0 else k * f for k, f in ((diagonal - along, c), (turned, s)) if k]
    if along or not terms:
        terms.append(as_expr(along))
    return reduce(add, terms)


def resolve_in_frame(frame: Frame, v_0: Expr) -> Expr:
    """Components in `frame` of a vector given in world axes."""
    return frame.R.T @ v_0


def resolve_in_world(frame: Frame, v: Expr) -> Expr:
    """World components of a vector given in `frame`."""
    return frame.R @ v


def relative_rotation(frame_a: Frame, frame_b: Frame) -> Expr:
    """Rotation from components in `frame_b` to components in `frame_a`."""
    return frame_a.R.T @ frame_b.R


def quaternion_rotation(Q: Expr) -> Expr:
    """Rotation of a quaternion of any non-zero length, vector part first.

    It is divided by the squared length, so that the drift of the length of an integrated quaternion has no effect.
    """
    x, y, z, s = Q
    xx, yy, zz, ss = x * x, y * y, z * z, s * s
    matrix = as_expr(
        (
            (ss + xx - yy - zz, 2 * (x * y - s * z), 2 * (x * z + s * y)),
            (2 * (x * y + s * z), ss - xx + yy - zz, 2 * (y * z - s * x)),
            (2 * (x * z - s * y), 2 * (y * z + s * x), ss - xx - yy + zz),
        )
    )
    return matrix / (xx + yy + zz + ss)


def quaternion_rates(Q: Expr, w: Expr) -> Expr:
    """Time derivative of a quaternion for an angular velocity `w` [rad/s] resolved in the turned frame."""
    v = as_expr((Q[0], Q[1], Q[2]))
    vector = Q[3] * w + cross(v, w)
    return as_expr((vector[0] / 2, vector[1] / 2, vector[2] / 2, -dot(v, w) / 2))


def cardan_angles(R: Expr) -> Expr:
    """Angles [rad] about x, then the new y, then the new z that give `R`; singular at 90 degrees about y."""
    return as_expr(
        (
            atan2(-R[1, 2], R[2, 2]),
            atan2(R[0, 2], sqrt(R[0, 0] * R[0, 0] + R[0, 1] * R[0, 1])),
            atan2(-R[0, 1], R[0, 0]),
        )
    )
