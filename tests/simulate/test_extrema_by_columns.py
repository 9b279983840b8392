"""Minima and maxima of a column and a number, evaluated by comparisons. Expected values: numpy.fmin and numpy.fmax."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from acausal.simulate.equations.calls.columns import by_columns

ROWS = np.array([-1.0, -0.0, 0.0, 1.0, math.nan, math.inf, -math.inf, 2.5, 3.0])


@pytest.mark.parametrize("number", [2.5, 0.0, -3.0, math.inf, -math.inf, math.nan])
def test_extrema_are_those_of_c(number: float) -> None:
    rows = ROWS[np.isfinite(ROWS)] if math.isnan(number) else ROWS
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    values = ca.vertcat(ca.fmax(x, p), ca.fmin(p, x), ca.fmax(0, x), ca.fmin(x, 0), ca.fmax(x, 2), ca.fmax(x, -x))
    function = by_columns(ca.Function("f", [x, p], [values]), len(rows), [1])
    assert function is not None
    others = (np.fmax, number), (np.fmin, number), (np.fmax, 0.0), (np.fmin, 0.0), (np.fmax, 2.0), (np.fmax, -rows)
    expected = np.column_stack([extremum(rows, other) for extremum, other in others])
    np.testing.assert_array_equal(np.array(function(rows, number)), expected)
