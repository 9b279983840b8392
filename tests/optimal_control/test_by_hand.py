"""Examples against the same problems written in CasADi for each alone, with equations derived by hand.

The programs are those of benchmarks/optimal_control_by_hand.py: Lagrange's equations, the recursion of Newton and
Euler, Kienzle's law with an algebraic feed per edge. Both sides use Radau points on the same mesh, and share nothing
else.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from acausal.models.optimal_control.cart_pole import swing_up
from acausal.models.optimal_control.plate_drilling import least_time
from acausal.models.optimal_control.robot_arm import point_to_point
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
