"""Constant rotations: closed forms and group properties."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acausal import Expr, variable
from acausal.errors import DeclarationError
from acausal.language.declarations.declaration import Declaration
from acausal.language.expressions.expression import Symbol
from acausal.library.multibody.orientation import (
    IDENTITY,
    across,
    axes_rotation,
    axis_rotation,
    quaternion,
    rotation_sequence,
    unit_vector,
)
from acausal.library.multibody.rotations import planar_rotation
from tests.expected import fails_with

angle = st.floats(-3.0, 3.0)
triple = st.tuples(*[st.floats(-2.0, 2.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1)


def rotation_of(q: tuple[float, ...]) -> np.ndarray:
    """Textbook matrix of a unit quaternion (Diebel 2006, equation 125, transposed to turn frame to world)."""
    x, y, z, s = q
    S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + 2 * s * S + 2 * S @ S)


def test_quarter_turn_about_z_turns_x_into_y() -> None:
    np.testing.assert_allclose(np.array(axis_rotation((0, 0, 2), math.pi / 2)) @ [1, 0, 0], [0, 1, 0], atol=1e-16)


@given(triple, angle)
def test_axis_rotation_is_a_rotation_that_keeps_its_axis(n: tuple[float, float, float], phi: float) -> None:
    R = np.array(axis_rotation(n, phi))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(R @ n, n, atol=1e-14)
    assert np.trace(R) == pytest.approx(1 + 2 * math.cos(phi), abs=1e-14)


@given(st.tuples(angle, angle, angle))
def test_sequence_turns_about_new_axes(angles: tuple[float, float, float]) -> None:
    x, y, z = (np.array(axis_rotation(np.eye(3)[k], a)) for k, a in enumerate(angles))
    np.testing.assert_allclose(np.array(rotation_sequence(angles)), x @ y @ z, atol=1e-14)


@given(triple, angle)
def test_quaternion_gives_the_rotation_back(n: tuple[float, float, float], phi: float) -> None:
    R = axis_rotation(n, phi)
    np.testing.assert_allclose(rotation_of(quaternion(R)), np.array(R), atol=1e-13)


def test_quaternion_of_half_turns() -> None:
    for k in range(3):
        q = quaternion(axis_rotation(np.eye(3)[k], math.pi))
        np.testing.assert_allclose(np.abs(q), np.eye(4)[k], atol=1e-15)
    assert quaternion(IDENTITY) == (0.0, 0.0, 0.0, 1.0)


def test_axes_rotation_has_the_axes_as_columns() -> None:
    R = np.array(axes_rotation((0, 2, 0), (0, 1, 3)))
    np.testing.assert_allclose(R, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)


@given(triple)
def test_across_is_a_right_handed_triad(n: tuple[float, float, float]) -> None:
    e = unit_vector(n)
    u, v = across(e)
    np.testing.assert_allclose(np.cross(u, v), e, atol=1e-14)


@pytest.mark.parametrize("n", [(0.0, 0.0, 0.0), (1.0, 2.0), (math.nan, 0.0, 1.0), (math.inf, 0.0, 0.0)])
def test_no_direction(n: tuple[float, ...]) -> None:
    with fails_with(DeclarationError, "AC130"):
        unit_vector(n)


def test_parallel_axes_give_no_frame() -> None:
    with pytest.raises(DeclarationError, match="cross"):
        axes_rotation((1, 0, 0), (2, 0, 0))


def test_a_literal_axis_keeps_zeros_and_ones_literal() -> None:
    declaration = variable(unit="rad")
    assert isinstance(declaration, Declaration)
    phi: Expr = Symbol(None, "phi", declaration)
    R = planar_rotation((0.0, 0.0, 1.0), phi)
    assert [[e.op for e in row.args] for row in R.args[:2]] == [["cos", "neg", "const"], ["sin", "cos", "const"]]
    assert R.args[2].payload == (0.0, 0.0, 1.0)
