"""Calls of CasADi functions on NumPy memory: the same numbers as CasADi's own calls, and its failures."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from acausal.simulate.equations.calls.buffered import rows
from acausal.simulate.equations.calls.raw import Kept


def test_rows_are_the_function_at_each_instant() -> None:
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
    function = ca.Function("f", [ca.SX.sym("t"), x, p], [ca.vertcat(x * p[0], ca.sin(p[1]))])
    points = np.arange(12.0).reshape(4, 3)
    found = rows(function, (np.zeros((4, 1)), points, np.array([2.0, 0.5])))
    np.testing.assert_array_equal(found, np.hstack([2.0 * points, np.full((4, 1), np.sin(0.5))]))


def test_rows_take_transposed_views_and_empty_arguments() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x, ca.SX.sym("z", 0)], [x[0] - x[1]])
    trajectory = np.array([[1.0, 2.0, 3.0], [0.5, 0.5, 0.5]])
    assert rows(function, (trajectory.T, np.zeros((3, 0)))).tolist() == [[0.5], [1.5], [2.5]]


def integrator(end: float = 0.75, **options: float) -> ca.Function:
    """x' = x*x, which is 1/(1 - t) from 1: infinite at t = 1."""
    x, none = ca.SX.sym("x"), ca.SX(0, 1)
    arguments = [ca.SX.sym("t"), x, *(ca.SX.sym(name, 0) for name in "zpu")]
    dae = ca.Function("dae", arguments, [x * x, none, none, none], ["t", *"xzpu"], ["ode", "alg", "quad", "zero"])
    return ca.integrator("run", "cvodes", dae, 0.0, [0.5, end], dict(options))


def test_integrators_give_states_and_statistics() -> None:
    (x, z), stats = Kept(integrator(reltol=1e-10, abstol=1e-12))({"x0": np.ones(1)}, ("xf", "zf"))
    np.testing.assert_allclose(x, [[2.0], [4.0]], rtol=1e-7)
    assert z.shape == (2, 0)
    assert stats["nsteps"] > 10


def test_a_failure_is_a_runtime_error() -> None:
    with pytest.raises(RuntimeError, match="CVode"):
        Kept(integrator(end=2.0, max_num_steps=500))({"x0": np.ones(1)}, ("xf",))
