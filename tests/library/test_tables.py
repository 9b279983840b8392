"""Tables of one variable against numpy and scipy, and against the properties their names promise."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import Akima1DInterpolator

from acausal import Component, Expr, Real, variable
from acausal.library.blocks.tables import Extrapolation, Smoothness, table
from tests.language.evaluating import value


class Thing(Component):
    """A place for u."""

    u: Real = variable()


U: Expr = Thing().u
SMOOTH = (Smoothness.CONTINUOUS_DERIVATIVE, Smoothness.MONOTONE_CONTINUOUS_DERIVATIVE)
POINTS = ((-1.0, 2.0), (0.0, 0.5), (0.4, 0.5), (2.0, 3.0), (3.5, 3.1))
TABLES = st.lists(
    st.tuples(st.integers(-50, 50), st.integers(-20, 20)), min_size=2, max_size=9, unique_by=lambda p: p[0]
)


def at(points: Any, u: float, *how: Any) -> float:
    return value(table(points, U, *how), {"u": u})


@given(TABLES.map(sorted), st.floats(0.0, 1.0))
def test_straight_segments_are_those_of_numpy(points: list[tuple[int, int]], share: float) -> None:
    x, y = np.array(points, dtype=float).T
    u = x[0] + share * (x[-1] - x[0])
    assert at(points, u) == pytest.approx(np.interp(u, x, y), abs=1e-9)


def test_beyond_the_ends_the_outer_segments_go_on_or_the_last_value_is_held() -> None:
    assert at(POINTS, -3.0) == pytest.approx(2.0 + 2.0 * 1.5)
    assert at(POINTS, 5.0) == pytest.approx(3.1 + 1.5 * 0.1 / 1.5)
    hold = (Smoothness.LINEAR_SEGMENTS, Extrapolation.HOLD_LAST_POINT)
    assert (at(POINTS, -3.0, *hold), at(POINTS, 5.0, *hold)) == (2.0, 3.1)


def test_constant_segments_hold_the_left_point() -> None:
    found = [at(POINTS, u, Smoothness.CONSTANT_SEGMENTS) for u in (-2.0, -0.5, 0.0, 1.9, 2.0, 9.0)]
    assert found == [2.0, 2.0, 0.5, 0.5, 3.0, 3.1]


def test_one_point_is_a_constant() -> None:
    assert table(((0.0, 0.5),), U).op == "const"


@pytest.mark.parametrize("u", np.linspace(-1.0, 3.5, 23))
def test_akima_is_that_of_scipy(u: float) -> None:
    x, y = np.array(POINTS).T
    assert at(POINTS, u, Smoothness.CONTINUOUS_DERIVATIVE) == pytest.approx(float(Akima1DInterpolator(x, y)(u)))


@pytest.mark.parametrize("smoothness", SMOOTH)
def test_smooth_tables_go_through_their_points_with_one_slope(smoothness: Smoothness) -> None:
    step = 1e-7
    for x, y in POINTS:
        left, here, right = (at(POINTS, u, smoothness) for u in (x - step, x, x + step))
        assert here == pytest.approx(y, abs=1e-12)
        assert (right - here) / step == pytest.approx((here - left) / step, abs=1e-5)


@given(st.lists(st.floats(0.01, 5.0), min_size=2, max_size=8), st.lists(st.floats(0.0, 5.0), min_size=8, max_size=8))
def test_the_monotone_table_of_growing_points_grows(gaps: list[float], rises: list[float]) -> None:
    """F. N. Fritsch, J. Butland (1984): no overshoot between points."""
    x = np.cumsum([0.0, *gaps])
    points = list(zip(x, np.cumsum(rises[: len(x)]), strict=False))
    u = np.linspace(points[0][0], points[-1][0], 60)
    found = [at(points, float(k), Smoothness.MONOTONE_CONTINUOUS_DERIVATIVE) for k in u]
    assert all(b - a >= -1e-9 for a, b in itertools.pairwise(found))


def test_a_value_costs_the_logarithm_of_the_number_of_points() -> None:
    """Fifty points: six decisions, not fifty."""
    e = table([(float(k), float(k % 7)) for k in range(50)], U)
    depth = 0
    while e.op == "where":
        depth, e = depth + 1, e.args[1]
    assert depth <= 6
