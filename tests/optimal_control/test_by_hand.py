"""Examples against the same problems written in CasADi for each alone, with equations derived by hand."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

import acausal
from acausal.models.optimal_control.cart_pole import swing_up
from acausal.models.optimal_control.plate_drilling import least_time
from acausal.models.optimal_control.robot_arm import LIMITS, RobotArm, point_to_point
from acausal.optimal_control import Problem
from benchmarks.optimal_control_by_hand import arm_by_hand, drilling_by_hand, swing_up_by_hand


@pytest.mark.parametrize(
    ("stated", "by_hand"),
    [
        (swing_up, swing_up_by_hand),
        pytest.param(lambda: least_time(5), drilling_by_hand, marks=pytest.mark.slow),
        pytest.param(lambda: least_time(8), lambda: drilling_by_hand(8), marks=pytest.mark.slow),
        (lambda: point_to_point(2), lambda: arm_by_hand(2)),
        (lambda: point_to_point(3, price=0.1, intervals=8), lambda: arm_by_hand(3, 8, 0.1)),
    ],
    ids=["swing-up", "drilling", "drilling, finer", "two joints", "three joints"],
)
def test_optimum_is_that_of_a_program_by_hand(stated: Callable[[], Problem], by_hand: Callable[[], object]) -> None:
    best, hand = stated().solve(), by_hand()
    assert best.objective == pytest.approx(vars(hand)["objective"], rel=1e-6)


GOAL = (1.2, -0.8, 1.0)


def by_hand(joints: int, intervals: int) -> float:
    """Least time with torques constant in each interval: Radau IIA with three points, all unknowns as they are."""
    arm = acausal.free(RobotArm(joints=joints), *(f"motor[{k}].u" for k in range(joints)))
    model = acausal.compile(arm).casadi([])
    tau = ca.collocation_points(3, "radau")
    slopes = ca.collocation_coeff(tau)[0]
    opti, n = ca.Opti(), 3 * intervals
    T = opti.variable()
    x, u = opti.variable(len(model.x), n + 1), opti.variable(joints, intervals)
    limits = ca.DM(LIMITS[:joints])
    torque = limits * u @ ca.kron(ca.DM.eye(intervals), ca.DM.ones(1, 3))
    p = ca.repmat(ca.DM(model.p.start), 1, n)
    rate = model.dae.map(n)(x[:, 1:], ca.DM(0, n), torque, p)[0]  # autonomous: without the time
    for k in range(intervals):
        opti.subject_to(x[:, 3 * k : 3 * k + 4] @ slopes == T / intervals * rate[:, 3 * k : 3 * k + 3])
    opti.subject_to(opti.bounded(-1, ca.vec(u), 1))
    opti.subject_to(x[:, 0] == 0)
    for k in range(joints):
        angle = model.x.position(f"axis[{k}].phi")
        opti.subject_to(x[angle, -1] == GOAL[k])
        opti.subject_to(x[model.x.position(f"axis[{k}].w"), -1] == 0)
        opti.set_initial(x[angle, :], np.linspace(0.0, GOAL[k], n + 1))
    opti.subject_to(T >= 0.1)
    opti.set_initial(T, 1.0)
    opti.minimize(T)
    opti.solver("ipopt", {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9}, "print_time": False})
    return float(opti.solve().value(T))


@pytest.mark.slow
def test_three_joints_in_the_least_time_as_by_hand() -> None:
    best = point_to_point(3, price=0.0, intervals=10).solve(control=0, tolerance=1e-9)
    assert best.objective == pytest.approx(by_hand(3, 10), rel=1e-6)
    # As many torques at a limit as there are joints, but for the interval of a switch: Pontryagin's principle.
    for k in range(3):
        assert best.multipliers[f"{-LIMITS[k]:g} <= motor[{k}].u <= {LIMITS[k]:g}"].active.mean() >= 0.6


@pytest.mark.slow
def test_time_and_effort_of_six_joints_replayed() -> None:
    best = point_to_point().solve()
    replay = best.replay()
    assert max(best.error(replay).values()) < 1e-3
    for k in range(6):
        assert replay.final(f"axis[{k}].w") == pytest.approx(0.0, abs=5e-3)
        assert np.abs(replay[f"motor[{k}].u"]).max() <= LIMITS[k] * (1 + 1e-9)


def test_one_joint_is_a_double_integrator() -> None:
    """About a vertical axis nothing weighs: J = 14.3 + 1.16 + m r**2 of the load, T = 2 sqrt(J phi/tau)."""
    problem: Problem = point_to_point(1, price=0.0, intervals=8)
    x, z = 0.1 + 0.0, 0.1 + 0.3
    inertia = 14.3 + 1.16 + 15.0 * (x**2 + z**2) + 0.001
    assert problem.solve().objective == pytest.approx(2 * np.sqrt(inertia * GOAL[0] / LIMITS[0]), rel=1e-5)
