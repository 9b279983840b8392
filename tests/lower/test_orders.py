"""Mechanisms: the operations per body do not grow, and the accelerations are those of the model's own equations."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

import acausal
from acausal import Component
from acausal.analyse.blocks.elimination import distances
from acausal.models.pendulum_chain import PendulumChain
from tests.lower.mechanisms import Balls, Tree

Vector = NDArray[np.float64]


def operations(compiled: Any) -> int:
    """Operations of the right-hand side with parameters as numbers."""
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(compiled.states))
    ode, _ = compiled.rhs(t, x, [], [], compiled.parameter_values, [])
    return int(ca.Function("f", [t, x], [ode]).n_instructions())


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        PendulumChain,
        pytest.param(lambda n: Tree(n=n, arms=1), marks=pytest.mark.slow),
        pytest.param(lambda n: Tree(n=n), marks=pytest.mark.slow),
    ],
    ids=["chain", "one arm", "arms"],
)
def test_operations_per_body_do_not_grow(model: Any) -> None:
    """The articulated-body algorithm costs the same for every body (Featherstone 2008, table 10.1).

    What is next to the ground costs less, so that the share of each still grows a little: from 16 bodies to 48, where a
    mass matrix solved densely would cost nine times as much per body, and Markowitz's order twice as much.
    """
    few, many = (acausal.compile(model(n=n), cache=False) for n in (16, 48))
    assert few.algebraic == many.algebraic == ()
    assert operations(many) / 48 < 1.3 * operations(few) / 16


def rates(compiled: Any, x: Vector) -> Vector:
    """Rates of the states; algebraic variables, which are linear here, by one dense Newton step."""
    nz = len(compiled.algebraic)
    z = ca.SX.sym("z", nz)
    p = compiled.parameter_values
    rhs = ca.Function("f", [z], list(compiled.rhs(0.0, x, z, [], p, [])))
    if nz:
        jacobian = ca.Function("J", [z], [ca.jacobian(compiled.rhs(0.0, x, z, [], p, [])[1], z)])
        solved = np.zeros(nz)
        for _ in range(2):  # once more, against rounding
            solved = solved - np.linalg.solve(np.array(jacobian(solved)), np.array(rhs(solved)[1]).ravel())
        return np.array(rhs(solved)[0]).ravel()
    return np.array(rhs(np.zeros(0))[0]).ravel()


@pytest.mark.parametrize(
    "model",
    [Tree(n=9, springs=2), Tree(n=9, arms=1), Tree(n=12, arms=3), Balls(n=3)],
    ids=["tree with springs", "chain", "three arms", "ball joints"],
)
def test_accelerations_are_those_of_the_whole_system(model: Component) -> None:
    """Against the same equations with no block solved, as one dense linear system."""
    solved = acausal.compile(model, cache=False)
    whole = acausal.compile(model, formulation="dae", cache=False)
    assert solved.algebraic == ()
    assert solved.states == whole.states
    assert len(whole.algebraic) > 20
    random = np.random.default_rng(4)
    for _ in range(3):
        x = random.standard_normal(len(solved.states))
        expected = rates(whole, x)
        np.testing.assert_allclose(rates(solved, x), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_links_on_ball_joints_keep_their_energy() -> None:
    """Released at rest from the horizontal: as much kinetic energy as height lost, by links of 1 kg and 0.5 m."""
    n = 3
    run = acausal.simulate(Balls(n=n), stop_time=1.0, tolerance=1e-9)
    energy = 0.0
    for k in range(n):
        v = np.array([run[f"links[{k}].v_0[{i}]"] for i in range(3)])
        w = np.array([run[f"links[{k}].w_a[{i}]"] for i in range(3)])
        R = np.array([[run[f"links[{k}].frame_a.R[{i},{j}]"] for j in range(3)] for i in range(3)])
        arm = 0.25 * R[:, 0]
        v = v + np.einsum("ij...,j...->i...", R, 0.25 * np.array([0.0 * w[0], w[2], -w[1]]))
        height = run[f"links[{k}].r_0[1]"] + arm[1]
        spin = 0.01 * w[0] ** 2 + 0.02 * w[1] ** 2 + 0.02 * w[2] ** 2
        energy = energy + 0.5 * (v**2).sum(axis=0) + 0.5 * spin + 9.80665 * height
    assert np.abs(energy).max() < 1e-5


def test_distances_are_those_of_the_graph() -> None:
    """Rows 0-1-2 in a line by variables 5 and 6, and row 3 apart."""
    found = distances([{5}, {5, 6}, {6, 7}, {8}], 0)
    assert found.rows == (0, 2, 4, 0)
    assert found.variables == {5: 1, 6: 3, 7: 5, 8: 0}
    assert found.furthest == 2
    assert found.out(1, 6) == 2
