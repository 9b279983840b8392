"""Derivatives of depth, normal and witnesses: exact, of first and second order, by every way they are used."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from acausal.library.contact.collide.penetration import collision_function
from tests.contact.poses import PAIR_CASES, SHAPES, Pose, Vector, contact, placed
from tests.marks import slow_but

STEP = 1e-5


def along_twist(a: str, b: str) -> tuple[list[Any], Any, Any]:
    """Displacement and poses; outputs by them; and their Jacobian, by small displacements of both bodies.

    A displacement is a translation in world axes and a rotation vector in the frame of the body.
    """
    f = collision_function(SHAPES[a], SHAPES[b])
    q = ca.SX.sym("q", 12)
    poses = [ca.SX.sym("r_a", 3), ca.SX.sym("R_a", 3, 3), ca.SX.sym("r_b", 3), ca.SX.sym("R_b", 3, 3)]

    def turned(w: Any) -> Any:
        s = ca.skew(w)
        return ca.SX.eye(3) + s + s @ s / 2 + s @ s @ s / 6

    y = ca.vertcat(*f(poses[0] + q[:3], poses[1] @ turned(q[3:6]), poses[2] + q[6:9], poses[3] @ turned(q[9:])))
    return [q, *poses], y, ca.jacobian(y, q)


def differences(function: Any, poses: tuple[Any, ...]) -> Vector:
    """Central differences along each displacement, shape (outputs, 12)."""
    steps = np.eye(12) * STEP
    columns = [(function(s, *poses).full() - function(-s, *poses).full()).ravel(order="F") / (2 * STEP) for s in steps]
    return np.stack(columns, axis=1)


def envelope(poses: tuple[Pose, Pose], n: Vector, p: Vector, q: Vector) -> Vector:
    """The normal times the velocities of the witnesses as points of their bodies, shape (12,)."""
    (r_a, R_a), (r_b, R_b) = poses
    return np.concatenate([n, R_a.T @ np.cross(p - r_a, n), -n, -R_b.T @ np.cross(q - r_b, n)])


@pytest.mark.parametrize(("a", "b"), PAIR_CASES)
def test_first_derivatives(a: str, b: str) -> None:
    """Against differences; the depth's is that of the witnesses along the normal (envelope theorem), to rounding."""
    inputs, y, J = along_twist(a, b)
    values, jacobian = ca.Function("y", inputs, [y]), ca.Function("J", inputs, [J])
    depth = 0.01 if (len(a) + len(b)) % 2 else -0.03
    poses = placed(SHAPES[a], SHAPES[b], depth, np.random.default_rng(11))
    arguments = (*poses[0], *poses[1])
    _, n, p, q = contact(SHAPES[a], poses[0], SHAPES[b], poses[1])
    found = jacobian(np.zeros(12), *arguments).full()
    assert found[0] == pytest.approx(envelope(poses, n, p, q), abs=1e-12)
    size = np.abs(found).max()
    assert found == pytest.approx(differences(values, arguments), abs=1e-6 * size**3)


# Second derivatives compile for a second or two: each shape once, with a tip and a rim or with a ball.
SECOND = [("cone", "drill"), ("box", "cone"), ("cylinder", "cone"), ("cone", "hull"), ("sphere", "capsule")]


@pytest.mark.parametrize(("a", "b"), slow_but(SECOND, SECOND[0]))
def test_second_derivatives(a: str, b: str) -> None:
    """Of the depth, where also symmetry tells, and of the normal."""
    inputs, _, J = along_twist(a, b)
    jacobian = ca.Function("J", inputs, [J])
    second = ca.Function("H", inputs, [ca.jacobian(J[k, :].T, inputs[0]) for k in (0, 1)])
    poses = placed(SHAPES[a], SHAPES[b], 0.01, np.random.default_rng(12))
    arguments = (*poses[0], *poses[1])
    rows = [k * 10 + 0 for k in range(12)], [k * 10 + 1 for k in range(12)]
    change = differences(jacobian, arguments)
    for found, row in zip(second(np.zeros(12), *arguments), rows, strict=True):
        size = np.abs(found.full()).max()
        assert found.full() == pytest.approx(change[row], abs=1e-6 * max(size, 1.0) ** 3)
    hessian = second(np.zeros(12), *arguments)[0].full()
    translations = hessian[np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])]
    assert translations == pytest.approx(translations.T, abs=1e-10)


def test_reverse_mode_is_the_transpose_of_forward_mode() -> None:
    f = collision_function(SHAPES["box"], SHAPES["cylinder"])
    r = ca.SX.sym("r", 3)
    poses = placed(SHAPES["box"], SHAPES["cylinder"], 0.01, np.random.default_rng(5))
    y = ca.vertcat(*f(*poses[0], r, poses[1][1]))
    forward = [ca.jtimes(y, r, ca.DM(e)) for e in np.eye(3)]
    reverse = [ca.jtimes(y, r, ca.DM(e), True).T for e in np.eye(10)]
    g = ca.Function("g", [r], [ca.horzcat(*forward), ca.vertcat(*reverse)])
    by_column, by_row = g(poses[1][0])
    assert by_column.full() == pytest.approx(by_row.full(), abs=1e-12)
    assert np.isfinite(by_row.full()).all()
