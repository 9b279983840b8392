"""Constant rotations as tuples of numbers, for structural arguments and start values.

A rotation here is `R` with `v_a == R v_b`: components in the turned frame b to components in frame a. Its columns
are the axes of b seen from a.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from acausal.errors import DeclarationError

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
Quaternion = tuple[float, float, float, float]

IDENTITY: Rotation = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def unit_vector(n: Sequence[float], name: str = "n") -> Vector:
    """`n` divided by its length, shape (3,); exact if `n` is along a coordinate axis.

    Raises
    ------
    DeclarationError
        AC130 if `n`, shape (3,), is not three finite numbers or is zero; `name` is its name in the message.
    """
    length = math.hypot(*n) if len(n) == 3 else 0.0
    if not 0.0 < length < math.inf:
        raise DeclarationError(
            "AC130",
            f"{name} = {tuple(n)} does not define a direction",
            help=f"give three numbers that are not all zero: {name}=(0, 0, 1)",
        )
    return (n[0] / length, n[1] / length, n[2] / length)


def checked_rotation(R: Sequence[Sequence[float]], name: str = "R_rel") -> Rotation:
    """`R`, shape (3, 3), if it is a rotation: its columns form a right-handed orthonormal frame.

    Raises
    ------
    DeclarationError
        AC130 if it is not; `name` is its name in the message.
    """
    rows = [tuple(map(float, row)) for row in R]
    if [len(row) for row in rows] != [3, 3, 3]:
        raise _no_rotation(R, name, "it is not three rows of three numbers")
    products = [math.fsum(rows[k][i] * rows[k][j] for k in range(3)) for i in range(3) for j in range(3)]
    off = max(abs(p - (k % 4 == 0)) for k, p in enumerate(products))
    if not off <= _ROUNDING:
        raise _no_rotation(R, name, f"its columns are not perpendicular unit vectors: R.T @ R is off by {off:.2g}")
    right_handed = sum(a * b for a, b in zip(_cross(rows[0], rows[1]), rows[2], strict=True)) > 0.0
    if not right_handed:
        raise _no_rotation(R, name, "it is a reflection: its determinant is -1")
    return (_row(rows[0]), _row(rows[1]), _row(rows[2]))


_ROUNDING = 1e-8


def _no_rotation(R: object, name: str, why: str) -> DeclarationError:
    return DeclarationError(
        "AC130",
        f"{name} = {R} is not a rotation",
        cause=why,
        help=f"make it: {name}=axis_rotation((0, 0, 1), angle), axes_rotation(n_x, n_y) or rotation_sequence(angles)",
    )


def axis_rotation(n: Sequence[float], angle: float) -> Rotation:
    """Rotation by `angle` [rad] about the axis `n` (Rodrigues).

    >>> axis_rotation((0, 0, 1), 0.0) == IDENTITY
    True
    """
    e = unit_vector(n)
    c, s = math.cos(angle), math.sin(angle)
    cross = ((0.0, -e[2], e[1]), (e[2], 0.0, -e[0]), (-e[1], e[0], 0.0))
    x, y, z = (tuple(e[i] * e[j] + ((i == j) - e[i] * e[j]) * c + cross[i][j] * s for j in range(3)) for i in range(3))
    return (_row(x), _row(y), _row(z))


def rotation_sequence(angles: Sequence[float], axes: Sequence[int] = (0, 1, 2)) -> Rotation:
    """Rotation by `angles[0]` [rad] about axis `axes[0]`, then about the *new* axis `axes[1]`, and so on.

    Axes are 0, 1, 2 for x, y, z. The Modelica library counts from 1: its sequence {1, 2, 3} is `(0, 1, 2)` here.
    """
    total = IDENTITY
    for axis, angle in zip(axes, angles, strict=True):
        total = product(total, axis_rotation([float(k == axis) for k in range(3)], angle))
    return total


def axes_rotation(n_x: Sequence[float], n_y: Sequence[float]) -> Rotation:
    """Rotation to the frame whose x axis is along `n_x` and whose y axis is nearest to `n_y`, both given in frame a."""
    x = unit_vector(n_x, "n_x")
    z = unit_vector(_cross(x, unit_vector(n_y, "n_y")), "cross(n_x, n_y)")
    y = _cross(z, x)
    return ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))


def across(e: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors perpendicular to the unit vector `e` and to each other, all of shape (3,)."""
    # The coordinate axis least parallel to e gives the best conditioned cross product.
    least = min(range(3), key=lambda k: abs(e[k]))
    R = axes_rotation(e, [float(k == least) for k in range(3)])
    return ((R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2]))


def product(a: Rotation, b: Rotation) -> Rotation:
    """Matrix product: first `b`, then `a`."""
    rows = [_row([math.fsum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)]) for i in range(3)]
    return (rows[0], rows[1], rows[2])


def quaternion(R: Rotation) -> Quaternion:
    """Unit quaternion (vector part first) of a rotation, the start value `Q` of a free body.

    The largest of the four components is computed first, since dividing by a small one would lose digits
    (Shepperd, Journal of Guidance and Control 1 (1978) 223).
    """
    trace = R[0][0] + R[1][1] + R[2][2]
    squares = [R[k][k] for k in range(3)] + [trace]
    largest = squares.index(max(squares))
    if largest == 3:
        q = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1], 1.0 + trace]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = [0.0] * 4
        q[i] = 1.0 + R[i][i] - R[j][j] - R[k][k]
        q[j] = R[i][j] + R[j][i]
        q[k] = R[i][k] + R[k][i]
        q[3] = R[k][j] - R[j][k]
    length = math.hypot(*q)
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def _cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _row(values: Sequence[float]) -> Vector:
    return (values[0], values[1], values[2])
