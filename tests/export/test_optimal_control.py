"""Optimal-control problems with known answers, solved by Opti and ipopt on a model loaded from a file."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component
from acausal.lower.casadi_model import CasadiModel
from tests.export.scenes import DrivenSlider, Slider, radau


def loaded(model: Component, folder: Path, outputs: list[str] | None = None) -> CasadiModel:
    """The model after a way through a file."""
    file = folder / "model.casadi"
    acausal.compile(model).casadi(outputs).save(file)
    return acausal.load_casadi(file)


def test_least_effort_from_rest_to_rest(tmp_path: Path) -> None:
    """Unit mass, unit distance, unit time: u = 6 - 12 t, its square integrates to 12.

    By the Euler-Lagrange equations of the integral of s''**2 the optimum is a cubic in time, s = 3 t**2 - 2 t**3, which
    three Radau points represent exactly.
    """
    model = loaded(Slider(), tmp_path)
    problem = radau(model, 1.0, ca.Opti(), intervals=4)
    s, v = (model.x.position(name) for name in ("mass.s", "mass.v"))
    problem.opti.subject_to(problem.x[s, -1] == 1.0)
    problem.opti.subject_to(problem.x[v, -1] == 0.0)
    effort = problem.integral(problem.u**2)
    problem.opti.minimize(effort)
    solution = problem.solve()
    t = problem.times
    assert solution.value(effort) == pytest.approx(12.0, rel=1e-9)
    np.testing.assert_allclose(solution.value(problem.u).ravel(), 6 - 12 * t, atol=1e-7)
    np.testing.assert_allclose(solution.value(problem.x[s, 1:]).ravel(), 3 * t**2 - 2 * t**3, atol=1e-9)
    # y holds what the model declares itself: here the power u*v.
    assert model.y.names == ("power",)
    np.testing.assert_allclose(solution.value(problem.y).ravel(), (6 - 12 * t) * (6 * t - 6 * t**2), atol=1e-7)


@pytest.mark.parametrize("distance", [0.25, 4.0])
def test_least_time_from_rest_to_rest(tmp_path: Path, distance: float) -> None:
    """|u| <= 1 N on 1 kg: full force to the middle, full brake from there, T = 2 sqrt(distance).

    The first example of Pontryagin et al., The mathematical theory of optimal processes, 1962, chapter 1.

    The switch lies on the border of two intervals, so the discrete optimum is the exact one.
    """
    model = loaded(Slider(), tmp_path)
    opti = ca.Opti()
    horizon = opti.variable()
    opti.subject_to(horizon >= 0.1)
    opti.set_initial(horizon, 1.0)
    problem = radau(model, horizon, opti, intervals=8)
    opti.subject_to(opti.bounded(-1.0, problem.u, 1.0))
    opti.subject_to(problem.x[model.x.position("mass.s"), -1] == distance)
    opti.subject_to(problem.x[model.x.position("mass.v"), -1] == 0.0)
    opti.minimize(horizon)
    solution = problem.solve()
    assert solution.value(horizon) == pytest.approx(2 * np.sqrt(distance), rel=1e-7)
    u = solution.value(problem.u).ravel()
    np.testing.assert_allclose(u, np.where(problem.times < 0.5 + 1e-9, 1.0, -1.0), atol=1e-4)


@pytest.mark.parametrize("reduced", [False, True], ids=["dae", "ode"])
def test_algebraic_variable_in_an_optimal_control_problem(tmp_path: Path, reduced: bool) -> None:
    """The drive's current i is force on 1 kg: least integral of i**2 is again 12 at i = 6 - 12 t, so u = i + i**3.

    With `ode` the current is found inside, by a rootfinder that ipopt differentiates twice.
    """
    model = loaded(DrivenSlider(), tmp_path)
    assert model.z.names == ("drive.i",)
    problem = radau(model, 1.0, ca.Opti(), intervals=4, reduced=reduced)
    opti = problem.opti
    opti.subject_to(problem.x[model.x.position("mass.s"), -1] == 1.0)
    opti.subject_to(problem.x[model.x.position("mass.v"), -1] == 0.0)
    current = problem.y[model.y.position("current"), :]
    opti.minimize(problem.integral(current**2))
    opti.set_initial(problem.u, 1.0)
    solution = problem.solve()
    i = 6 - 12 * problem.times
    assert solution.value(opti.f) == pytest.approx(12.0, rel=1e-8)
    np.testing.assert_allclose(solution.value(problem.u).ravel(), i + i**3, rtol=1e-5, atol=1e-5)
