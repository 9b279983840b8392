"""Models in do-mpc, rockit and the shape of acados, against closed forms; do-mpc and rockit where they are there."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal import Component, Equations, Real, der, fixed, parameter, sin, time, variable
from acausal.errors import ExportError
from acausal.export.adapters import acados_model, do_mpc_limits, do_mpc_model, identifiers, rockit_stage
from acausal.models.bouncing_ball import BouncingBall
from tests.export.scenes import DrivenSlider, Slider, numbers


class Driven(Component):
    """x' = a sin t."""

    a: Real = parameter(default=2.0)
    x: Real = variable(default=fixed(1.0))

    def equations(self) -> Equations:
        yield der(self.x) == self.a * sin(time)


def test_the_shape_of_acados() -> None:
    """Fields evaluate to the model: i + i^3 = u = 2 has i = 1, so v' = 1; explicit only without algebraic variables."""
    shape = acados_model(acausal.compile(DrivenSlider()).casadi())
    theirs = SimpleNamespace()
    for name, value in vars(shape).items():
        setattr(theirs, name, value)
    assert (theirs.name, theirs.f_expl_expr, theirs.x_labels) == ("DrivenSlider", None, ["mass.s", "mass.v"])
    p = acausal.compile(DrivenSlider()).casadi().p.start
    f = ca.Function("f", [shape.xdot, shape.x, shape.z, shape.u, shape.p], [theirs.f_impl_expr])
    np.testing.assert_allclose(numbers(f([0.3, 1.0], [0.0, 0.3], 1.0, 2.0, p)), 0.0, atol=1e-15)
    explicit = acados_model(acausal.compile(Slider()).casadi())
    g = ca.Function("g", [explicit.x, explicit.u, explicit.p], [explicit.f_expl_expr])
    np.testing.assert_allclose(numbers(g([0.0, 2.0], 3.0, [1.0, 1.0])), [2.0, 3.0])


def test_what_has_no_place_is_refused() -> None:
    timed = acausal.compile(Driven()).casadi()
    ball = acausal.compile(BouncingBall()).casadi(events=True)
    for call in (
        lambda: acados_model(timed),
        lambda: do_mpc_model(timed, None),
        lambda: acados_model(ball),
        lambda: rockit_stage(ball, None),
    ):
        with pytest.raises(ExportError) as caught:
            call()
        assert caught.value.code == "AC614"


@pytest.mark.parametrize("model", [Slider(), DrivenSlider()], ids=["ode", "dae"])
def test_rockit_moves_it_with_least_effort(model: Component) -> None:
    """u = 6 - 12 t costs 12; of forces held in N intervals the best costs 12/(1 - 1/N^2)."""
    rockit = pytest.importorskip("rockit", reason="pip install rockit-meco")
    made = acausal.compile(model).casadi()
    ocp = rockit.Ocp(T=1.0)
    stage = rockit_stage(made, ocp)
    ocp.subject_to(ocp.at_t0(stage.x) == 0)
    ocp.subject_to(ocp.at_tf(stage["mass.s"]) == 1)
    ocp.subject_to(ocp.at_tf(stage["mass.v"]) == 0)
    force = stage["drive.i"] if made.z else stage["u"]
    ocp.add_objective(ocp.integral(force**2))
    ocp.solver("ipopt", {"ipopt.print_level": 0, "ipopt.tol": 1e-10, "print_time": False})
    ocp.method(rockit.DirectCollocation(N=20) if made.z else rockit.MultipleShooting(N=20, intg="rk"))
    solution = ocp.solve()
    assert solution.value(ocp.objective) == pytest.approx(12.0 / (1 - 1 / 400), rel=1e-7)


def test_rockit_knows_the_time() -> None:
    """x(1) = 1 + a (1 - cos 1)."""
    rockit = pytest.importorskip("rockit", reason="pip install rockit-meco")
    made = acausal.compile(Driven()).casadi()
    ocp = rockit.Ocp(T=1.0)
    stage = rockit_stage(made, ocp)
    ocp.subject_to(ocp.at_t0(stage.x) == made.x.start)
    ocp.solver("ipopt", {"ipopt.print_level": 0, "print_time": False})
    ocp.method(rockit.MultipleShooting(N=20, intg="rk"))
    solution = ocp.solve()
    assert solution.value(ocp.at_tf(stage["x"])) == pytest.approx(1 + 2 * (1 - np.cos(1.0)), abs=1e-6)


def test_do_mpc_simulates_and_controls_it() -> None:
    """u = 2 drives i = 1: s = 1/2, v = 1 after one second. Then a controller brings it to rest at 1."""
    do_mpc = pytest.importorskip("do_mpc", reason="pip install do-mpc")
    made = acausal.compile(DrivenSlider()).casadi()
    theirs = do_mpc_model(made, do_mpc.model.Model("continuous", "SX"))
    simulator = do_mpc.simulator.Simulator(theirs)
    simulator.set_param(t_step=0.1, integration_tool="idas", abstol=1e-10, reltol=1e-10)
    given = simulator.get_p_template()
    for name, value in zip(identifiers(made.p), made.p.start, strict=True):
        given[name] = value
    simulator.set_p_fun(lambda t: given)
    simulator.setup()
    simulator.x0, simulator.z0 = np.zeros((2, 1)), np.zeros((1, 1))
    simulator.set_initial_guess()
    for _ in range(10):
        x = simulator.make_step(np.array([[2.0]]))
    np.testing.assert_allclose(x.ravel(), [0.5, 1.0], atol=1e-8)

    controller = do_mpc.controller.MPC(theirs)
    controller.settings.n_horizon, controller.settings.t_step = 10, 0.1
    controller.settings.supress_ipopt_output()
    cost = (theirs.x["mass_s"] - 1) ** 2 + theirs.x["mass_v"] ** 2
    controller.set_objective(mterm=cost, lterm=1e-3 * theirs.u["u"] ** 2)
    controller.set_rterm(u=1e-4)
    do_mpc_limits(made, controller)
    assert float(controller.bounds["upper", "_z", "drive_i"]) == 20.0
    known = controller.get_p_template(1)
    for name, value in zip(identifiers(made.p), made.p.start, strict=True):
        known["_p", 0, name] = value
    controller.set_p_fun(lambda t: known)
    controller.setup()
    controller.x0, controller.z0 = x, np.zeros((1, 1))
    controller.set_initial_guess()
    for _ in range(40):
        x = simulator.make_step(controller.make_step(x))
    np.testing.assert_allclose(x.ravel(), [1.0, 0.0], atol=0.02)
